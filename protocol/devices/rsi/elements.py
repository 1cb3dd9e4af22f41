"""Elements of telegrams as a usual configuration of the controller names them: meaning and units, by name.

An element's numbers are its attributes: X Y Z A B C of a pose, A1 … A6 of axes. Decoding does not need this table, for
a configuration may name any channel; monitor, `decode` and the client's own tags come from it.
"""

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

POSE_AXES = ("X", "Y", "Z", "A", "B", "C")
"""Attributes of a Cartesian value in the vendor's order: mm, then degrees."""
AXES = ("A1", "A2", "A3", "A4", "A5", "A6")
"""Attributes of a value of the robot's axes."""


class Content(Enum):
    """Content of an element."""

    POSE = "pose"
    """X Y Z in mm, A B C in degrees."""
    ANGLES = "angles"
    """Degrees."""
    NUMBER = "number"
    TEXT = "text"


class Element(NamedTuple):
    """One element."""

    meaning: str
    content: Content = Content.NUMBER

    def unit(self, attribute: str) -> str:
        """Return the unit of the number in an attribute; empty without any."""
        if self.content is Content.POSE and attribute in POSE_AXES:
            return "mm" if attribute in POSE_AXES[:3] else "°"
        return "°" if self.content is Content.ANGLES else ""


ELEMENTS: Mapping[str, Element] = {
    "RIst": Element("actual pose of the tool", Content.POSE),
    "RSol": Element("set pose, without correction", Content.POSE),
    "RKorr": Element("Cartesian correction: added, or the whole of it, by the mode of RSI_ON", Content.POSE),
    "AIPos": Element("actual axes", Content.ANGLES),
    "ASPos": Element("set axes", Content.ANGLES),
    "EIPos": Element("actual external axes"),
    "ESPos": Element("set external axes"),
    "AK": Element("correction of the axes", Content.ANGLES),
    "AKorr": Element("correction of the axes", Content.ANGLES),
    "EK": Element("correction of external axes"),
    "EKorr": Element("correction of external axes"),
    "MACur": Element("motor current"),
    "MECur": Element("motor current of an external axis"),
    "GearTorque": Element("torque at an axis, N·m"),
    "OvPro": Element("program override, %"),
    "Delay": Element("late cycles since RSI_ON"),
    "EStr": Element("message for the controller's panel", Content.TEXT),
    "ProgStatus": Element("state of the program: 3 runs, 4 stopped"),
}
"""By name; the names of corrections and of further channels are those of a usual configuration."""
CHANNEL = Element("channel of the configuration")
"""Every other one."""


def pose_tags(element: str) -> tuple[str, ...]:
    """Tags of a Cartesian element, as `RIst` or `RKorr`, in the vendor's order."""
    return tuple(f"{element}.{axis}" for axis in POSE_AXES)


def axis_tags(element: str) -> tuple[str, ...]:
    """Tags of an element of the robot's axes, as `AIPos` or `AK`, axis 1 first."""
    return tuple(f"{element}.{axis}" for axis in AXES)
