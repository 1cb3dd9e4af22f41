"""Origin of a recording made by another program, and the choices with which the recording was read."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from hil_bridge.errors import ConfigError

WRENCH, POSE, TARGET = "wrench", "pose", "target"
ROLES: Mapping[str, str] = {
    WRENCH: "contact wrench",
    POSE: "measured pose of the tool",
    TARGET: "commanded pose of the tool",
}
"""Roles of topics. The last role is never detected by the type of a topic."""
TOOL_FRAME, BASE_FRAME = "tool", "base"
FRAMES = (TOOL_FRAME, BASE_FRAME)
"""Frames in which a wrench or an axis can be given: the child frame of the pose, and its parent frame."""
AXES: Mapping[str, tuple[float, float, float]] = {
    f"{sign}{name}": tuple(size * (place == k) for k in range(3))  # type: ignore[misc]
    for sign, size in (("", 1.0), ("-", -1.0))
    for place, name in enumerate("xyz")
}
"""Unit vectors by name."""
HEADER, LOG = "header", "log"
STAMPS = (HEADER, LOG)
"""Sources of a message's time: the stamp in its header, or the time at which it was recorded."""
CONTACT_N = 1.0
"""Force above which the tool is in contact, N. Chosen: the default of `task.contact_threshold_n`."""
LARGEST = 1e6
"""Largest valid value of a measured quantity, in its SI unit. Chosen: far above any device, and its square stays
finite.
"""
Topics: TypeAlias = Mapping[str, str | Sequence[str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class BagChoices:
    """Assumptions about a ROS 2 bag. Raises ConfigError for an invalid choice."""

    topics: Topics = field(default_factory=dict)
    """Topic of each role (wrench, pose, target), or several topics of which the bag has one. `/tf:CHILD` is a frame
    of `/tf`.
    """
    axis: str = "tool:z"
    """Direction in which the tool presses: `tool:` or `base:`, followed by x, y, z, -x, -y or -z."""
    wrench_in: str = TOOL_FRAME
    """Frame in which the wrench is expressed: tool (the child frame of the pose) or base (its parent frame)."""
    sign: int = 1
    """Sign of the wrench. 1: wrench of the environment on the tool; -1: wrench of the tool on the environment."""
    zero_s: float = 0.0
    """Duration of the interval at the start whose mean wrench is subtracted, s; 0 subtracts nothing."""
    contact_n: float = CONTACT_N
    """Force above which the tool is in contact, N."""
    stamps: str = HEADER
    """Source of the messages' times: header or log."""

    def __post_init__(self) -> None:
        frame, _, axis = self.axis.partition(":")
        if frame not in FRAMES or axis not in AXES:
            raise ConfigError(
                f"axis {self.axis!r} must be tool or base, a colon, and one of {', '.join(AXES)}"
            )
        if self.wrench_in not in FRAMES:
            raise ConfigError(f"wrench_in {self.wrench_in!r} must be one of {', '.join(FRAMES)}")
        if self.sign not in (1, -1):
            raise ConfigError(f"sign {self.sign!r} must be 1 or -1")
        if self.stamps not in STAMPS:
            raise ConfigError(f"stamps {self.stamps!r} must be one of {', '.join(STAMPS)}")
        for name, value in (("zero_s", self.zero_s), ("contact_n", self.contact_n)):
            if not (math.isfinite(value) and 0.0 <= value <= LARGEST):
                raise ConfigError(f"{name} {value!r} must be a number from 0 to {LARGEST:g}")
        for role in self.topics:
            if role not in ROLES:
                raise ConfigError(f"topics has no role {role!r}; known: {', '.join(ROLES)}")

    def named(self, role: str) -> tuple[str, ...]:
        """Return the topics that the operator specified for a role."""
        names = self.topics.get(role, ())
        return (names,) if isinstance(names, str) else tuple(names)

    @property
    def axis_frame(self) -> str:
        """Frame of the axis: tool or base."""
        return self.axis.partition(":")[0]

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector of the axis in its frame."""
        return AXES[self.axis.partition(":")[2]]


@dataclass(frozen=True, slots=True)
class ForeignTopic:
    """Topic from which a recording was made."""

    name: str
    type: str
    frame: str
    """Frame that the messages name."""
    messages: int


@dataclass(frozen=True, slots=True)
class Foreign:
    """Origin of a recording made by another program."""

    file: str
    """Name of the file or folder."""
    topics: Mapping[str, ForeignTopic]
    """Topics by role."""
    choices: BagChoices
    left_out: int = 0
    """Number of wrenches omitted because the tool position was unknown at their time."""
    moments: bool = True
    """Whether the torques of the wrenches are known."""
