"""What robot and sensor tell besides their answers and frames: notices, bytes, events of the link."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from hil_bridge.transports import Direction


class DeviceLog(Protocol):
    """Where the devices of a run put what they tell; must not block. A device is "robot" or "sensor"."""

    def frame(self, frame: Any) -> object:
        """A complete frame of the sensor has arrived."""

    def notice(self, kind: str, text: str) -> object:
        """Something worth a line in the record: a repeat, a time-out, noise, a spontaneous message."""

    def traffic(self, device: str, direction: Direction, data: Any) -> object:
        """Bytes, CAN frames or datagrams have just gone over a device's wire."""

    def link_event(self, device: str, text: str) -> object:
        """Something happened on a device's link: a bid, an acknowledgement, a repetition."""


def _forget(*_: Any) -> None:
    return None


@dataclass(frozen=True, slots=True)
class LogTo:
    """A log that hands to functions what a command wants to hear, and forgets the rest."""

    frame: Callable[[Any], object] = _forget
    """As of `DeviceLog`, like all the others."""
    notice: Callable[[str, str], object] = _forget
    traffic: Callable[[str, Direction, Any], object] = _forget
    link_event: Callable[[str, str], object] = _forget
