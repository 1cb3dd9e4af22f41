"""Meaning and units of the telegram elements in a common configuration of the controller, by name.

An element's numbers are its attributes: X Y Z A B C of a pose, A1 … A6 of axes. Decoding does not need this table,
because a configuration may use any name. The monitor, `decode` and the client's own tags use it.
"""

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

POSE_AXES = ("X", "Y", "Z", "A", "B", "C")
"""Attributes of a Cartesian value in the vendor's order; the first three are in mm, the others in degrees."""
AXES = ("A1", "A2", "A3", "A4", "A5", "A6")
"""Attributes of a value for the robot's axes."""


class Content(Enum):
    """Kind of values that an element contains."""

    POSE = "pose"
    """X Y Z in mm, A B C in degrees."""
    ANGLES = "angles"
    """Angles in degrees."""
    NUMBER = "number"
    TEXT = "text"


class Element(NamedTuple):
    """Meaning and contents of an element."""

    meaning: str
    content: Content = Content.NUMBER

    def unit(self, attribute: str) -> str:
        """Return the unit of the number in an attribute; empty if it has no unit."""
        if self.content is Content.POSE and attribute in POSE_AXES:
            return "mm" if attribute in POSE_AXES[:3] else "°"
        return "°" if self.content is Content.ANGLES else ""


ELEMENTS: Mapping[str, Element] = {
    "RIst": Element("actual pose of the tool", Content.POSE),
    "RSol": Element("set pose, without correction", Content.POSE),
    "RKorr": Element("Cartesian correction: increment or total, by the mode of RSI_ON", Content.POSE),
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
"""Known elements by name. The names of the corrections and of further channels are from a common configuration."""
CHANNEL = Element("channel of the configuration")
"""Description of any element that is not in `ELEMENTS`."""


def pose_tags(element: str) -> tuple[str, ...]:
    """Return the tags of a Cartesian element, such as `RIst` or `RKorr`, in the vendor's order."""
    return tuple(f"{element}.{axis}" for axis in POSE_AXES)


def axis_tags(element: str) -> tuple[str, ...]:
    """Return the tags of an element of the robot's axes, such as `AIPos` or `AK`, from axis 1 on."""
    return tuple(f"{element}.{axis}" for axis in AXES)
