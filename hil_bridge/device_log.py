"""What robot and sensor tell besides their answers and frames: notices, bytes, events of the link."""

from typing import Any, Protocol

from hil_bridge.transports import Direction
from protocol.wrench import WrenchFrame


class DeviceLog(Protocol):
    """Where the devices of a run put what they tell; must not block. A device is "robot" or "sensor"."""

    def frame(self, frame: WrenchFrame) -> None:
        """A complete frame of the sensor has arrived."""

    def notice(self, kind: str, text: str) -> None:
        """Something worth a line in the record: a repeat, a time-out, noise, a spontaneous message."""

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Bytes, CAN frames or datagrams have just gone over a device's wire."""

    def link_event(self, device: str, text: str) -> None:
        """Something happened on a device's link: a bid, an acknowledgement, a repetition."""


class Silence:
    """A log that keeps nothing, for tools that look at a device without recording it."""

    def frame(self, frame: WrenchFrame) -> None:
        """Forget it."""

    def notice(self, kind: str, text: str) -> None:
        """Forget it."""

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Forget it."""

    def link_event(self, device: str, text: str) -> None:
        """Forget it."""
