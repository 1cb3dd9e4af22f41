"""Log of events that robot and sensor report in addition to answers and frames: notices, traffic, link events."""

from collections.abc import Callable
from typing import Any, Protocol

from hil_bridge.transports import Direction
from protocol.wrench import WrenchFrame


class DeviceLog(Protocol):
    """Log of the devices of a run. `device` is "robot" or "sensor". The methods must not block."""

    verbose: bool
    """Whether traffic and every link event are to be logged, including routine events. If not, the wires of the
    devices do not report their traffic.
    """

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
        """Discard the frame."""

    def notice(self, kind: str, text: str) -> None:
        """Discard the notice."""

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Discard the traffic."""

    def link_event(self, device: str, text: str) -> None:
        """Discard the link event."""


class CallbackLog(NullLog):
    """Log that passes frames and notices to callbacks and discards the rest."""

    def __init__(
        self,
        frame: Callable[[WrenchFrame], object] | None = None,
        notice: Callable[[str, str], object] | None = None,
    ) -> None:
        self._frame, self._notice = frame, notice

    def frame(self, frame: WrenchFrame) -> None:
        """Pass the frame to its callback."""
        if self._frame is not None:
            self._frame(frame)

    def notice(self, kind: str, text: str) -> None:
        """Pass the notice to its callback."""
        if self._notice is not None:
            self._notice(kind, text)
