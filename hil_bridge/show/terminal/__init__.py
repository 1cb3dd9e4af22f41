"""The live view of a run in a terminal. This module says what it shows; `live` draws it and is apart because its
imports take long.
"""

from hil_bridge.show.terminal.model import REFRESH_SECONDS, Health, Scene, Snapshot, Told, ViewModel

__all__ = ["REFRESH_SECONDS", "Health", "Scene", "Snapshot", "Told", "ViewModel"]
