"""Log of what robot and sensor report besides answers and frames: notices, traffic, link events."""

from collections.abc import Callable
from typing import Any, Protocol

from hil_bridge.transports import Direction
from protocol.wrench import WrenchFrame


class DeviceLog(Protocol):
    """Log of the devices of a run; must not block. A device is "robot" or "sensor"."""

    verbose: bool
    """Whether every link event is to be logged, including routine ones."""

    def frame(self, frame: WrenchFrame) -> None:
        """Log a complete frame of the sensor."""

    def notice(self, kind: str, text: str) -> None:
        """Log an event for the recording: a repeat, a time-out, noise, an unsolicited message."""

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Log bytes, CAN frames or datagrams that were just sent or received by a device."""

    def link_event(self, device: str, text: str) -> None:
        """Log an event on a device's link: a bid, an acknowledgement, a repetition."""


class NullLog:
    """Log that discards everything."""

    verbose = False

    def frame(self, frame: WrenchFrame) -> None:
        """Discard it."""

    def notice(self, kind: str, text: str) -> None:
        """Discard it."""

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Discard it."""

    def link_event(self, device: str, text: str) -> None:
        """Discard it."""


class CallbackLog(NullLog):
    """Log that passes frames and notices to callbacks and discards the rest."""

    def __init__(
        self,
        frame: Callable[[WrenchFrame], object] | None = None,
        notice: Callable[[str, str], object] | None = None,
    ) -> None:
        self._frame, self._notice = frame, notice

    def frame(self, frame: WrenchFrame) -> None:
        """Pass it on."""
        if self._frame is not None:
            self._frame(frame)

    def notice(self, kind: str, text: str) -> None:
        """Pass it on."""
        if self._notice is not None:
            self._notice(kind, text)
