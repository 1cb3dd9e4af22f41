"""Live terminal view of a run. This module holds its content; `live` draws it and is separate because its
imports take long.
"""

from hil_bridge.show.terminal.model import REFRESH_SECONDS, Health, Scene, Snapshot, ViewEvent, ViewModel

__all__ = ["REFRESH_SECONDS", "Health", "Scene", "Snapshot", "ViewEvent", "ViewModel"]
