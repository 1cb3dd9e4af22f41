"""The live view of a run in a terminal."""

from hil_bridge.view.live import REFRESH_SECONDS, LiveView
from hil_bridge.view.model import Health, Snapshot, ViewModel

__all__ = ["REFRESH_SECONDS", "Health", "LiveView", "Snapshot", "ViewModel"]
