"""Reports of robot and sensor besides their answers and frames: notices, bytes, events of the link."""

from collections.abc import Callable
from typing import Any, Protocol

from hil_bridge.transports import Direction
from protocol.wrench import WrenchFrame


class DeviceLog(Protocol):
    """Where the devices of a run put what they tell; must not block. A device is "robot" or "sensor"."""

    verbose: bool
    """Every event of a link is wanted, also the usual ones."""

    def frame(self, frame: WrenchFrame) -> None:
        """A complete frame of the sensor has arrived."""

    def notice(self, kind: str, text: str) -> None:
        """Something worth a line in the record: a repeat, a time-out, noise, a spontaneous message."""

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Bytes, CAN frames or datagrams have just gone over a device's wire."""

    def link_event(self, device: str, text: str) -> None:
        """Something happened on a device's link: a bid, an acknowledgement, a repetition."""


class NullLog:
    """A log that keeps nothing."""

    verbose = False

    def frame(self, frame: WrenchFrame) -> None:
        """Forget it."""

    def notice(self, kind: str, text: str) -> None:
        """Forget it."""

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Forget it."""

    def link_event(self, device: str, text: str) -> None:
        """Forget it."""


class CallbackLog(NullLog):
    """A log that hands frames and notices to functions, where they are wanted, and forgets the rest."""

    def __init__(
        self,
        frame: Callable[[WrenchFrame], object] | None = None,
        notice: Callable[[str, str], object] | None = None,
    ) -> None:
        self._frame, self._notice = frame, notice

    def frame(self, frame: WrenchFrame) -> None:
        """Hand it on."""
        if self._frame is not None:
            self._frame(frame)

    def notice(self, kind: str, text: str) -> None:
        """Hand it on."""
        if self._notice is not None:
            self._notice(kind, text)
