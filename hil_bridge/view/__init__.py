"""The live view of a run in a terminal: here what it shows, and in `live`, apart from it for what that needs takes long
to import, how it is drawn.
"""

from hil_bridge.view.model import REFRESH_SECONDS, Health, Snapshot, ViewModel

__all__ = ["REFRESH_SECONDS", "Health", "Snapshot", "ViewModel"]
