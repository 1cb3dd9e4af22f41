"""Live terminal view of a run. This package has its contents; the module `live`, which imports slowly, draws it."""

from hil_bridge.show.terminal.model import REFRESH_SECONDS, Health, Scene, Snapshot, ViewEvent, ViewModel

__all__ = ["REFRESH_SECONDS", "Health", "Scene", "Snapshot", "ViewEvent", "ViewModel"]
