"""Origin of a recording made by another program, and the choices with which it was read."""

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
"""Roles of topics. The last is never detected by its type."""
TOOL_FRAME, BASE_FRAME = "tool", "base"
FRAMES = (TOOL_FRAME, BASE_FRAME)
"""Frames of a wrench and of an axis: the child of the pose, and its parent."""
AXES: Mapping[str, tuple[float, float, float]] = {
    f"{sign}{name}": tuple(size * (place == k) for k in range(3))  # type: ignore[misc]
    for sign, size in (("", 1.0), ("-", -1.0))
    for place, name in enumerate("xyz")
}
"""Unit vectors by name."""
HEADER, LOG = "header", "log"
STAMPS = (HEADER, LOG)
"""Times of a message: the stamp of its header, or the time at which it was recorded."""
CONTACT_N = 1.0
"""Force above which the tool is in contact, N. Chosen: the default of `task.contact_threshold_n`."""
LARGEST = 1e6
"""Largest value of a measured quantity, in its SI unit. Chosen: far above any device, and squares stay finite."""
Topics: TypeAlias = Mapping[str, str | Sequence[str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class BagChoices:
    """Assumptions about a ROS 2 bag. Raises ConfigError for an invalid choice."""

    topics: Topics = field(default_factory=dict)
    """Topic, or several of which a bag has one, by role: wrench, pose, target. `/tf:CHILD` is a frame of `/tf`."""
    axis: str = "tool:z"
    """Direction in which the tool presses: `tool:` or `base:`, and x, y, z, -x, -y or -z."""
    wrench_in: str = TOOL_FRAME
    """Frame in which the wrench is expressed: tool, the child of the pose, or base, its parent."""
    sign: int = 1
    """1: the wrench of the environment on the tool; -1: of the tool on the environment."""
    zero_s: float = 0.0
    """Initial time whose mean wrench is subtracted, s; 0 subtracts nothing."""
    contact_n: float = CONTACT_N
    """Force above which the tool is in contact, N."""
    stamps: str = HEADER
    """Times of the messages: header or log."""

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
        """Return the topics given for a role."""
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
    """A topic from which a recording was made."""

    name: str
    type: str
    frame: str
    """Frame that its messages name."""
    messages: int


@dataclass(frozen=True, slots=True)
class Foreign:
    """Origin of a recording made by another program."""

    file: str
    """Name of its file or folder."""
    topics: Mapping[str, ForeignTopic]
    """By role."""
    choices: BagChoices
    left_out: int = 0
    """Number of wrenches omitted because the tool position was unknown."""
    moments: bool = True
    """Whether the moments are known."""
