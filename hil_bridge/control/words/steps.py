"""The words of a program: one settings class for each kind of step.

A value of None stands for that of the task or of the limits. Places are mm in the work frame: its x axis is
`frame.travel`, its z axis points away from the surface, against `frame.approach`.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Discriminator

from hil_bridge.control.checks import FORBID_EXTRA, require_above_zero, require_not_negative
from hil_bridge.control.words.paths import Path, Place, check_finite
from protocol.geometry import Quaternion, Vector
from protocol.marks import SettingError

Orientation: TypeAlias = Literal["fixed", "along-path", "normal"]
"""fixed: as at the start. along-path: turned about the approach so that it looks along the path as at its begin.
normal: perpendicular to the surface.
"""
ForceProfile: TypeAlias = float | tuple[tuple[float, float], ...]
"""A force, N, or pairs of way in mm and force in N, with straight ramps between."""


@dataclass(frozen=True, slots=True)
class StepLimits:
    """Limits that hold for one step, tighter than those of the run."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    force_limit_n: float | None = None
    resultant_limit_n: float | None = None
    moment_limit_nm: float | None = None
    correction_mm_s: float | None = None
    travel_mm_s: float | None = None
    turn_deg_s: float | None = None

    def __post_init__(self) -> None:
        require_above_zero(self, *(name for name in self.__slots__ if getattr(self, name) is not None))


@dataclass(frozen=True, slots=True)
class Criterion:
    """How good a step must have been."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    within_n: float
    """Largest distance of the force from the wanted one."""
    for_percent: float = 95.0
    """Share of the way for which the force must be within; of the time where there is no way."""

    def __post_init__(self) -> None:
        require_above_zero(self, "within_n", "for_percent")
        if self.for_percent > 100:
            raise SettingError("for_percent", f"must be at most 100, got {self.for_percent:g}")


@dataclass(frozen=True, slots=True)
class Approach:
    """Step into the surface until the force says contact."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    do: Literal["approach"] = "approach"
    name: str = ""
    """Name under which the place of the contact is told; empty for none."""
    speed_mm_s: float | None = None
    contact_n: float | None = None
    at_most_mm: float | None = None
    limits: StepLimits = StepLimits()

    def __post_init__(self) -> None:
        _above_zero(self, "speed_mm_s", "contact_n", "at_most_mm")


@dataclass(frozen=True, slots=True)
class Track:
    """Press with a force while the tool goes along a path."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    path: Path
    do: Literal["track"] = "track"
    speed_mm_s: float | None = None
    force_n: ForceProfile | None = None
    for_s: float | None = None
    """The step ends after this time too; nothing: at the end of the path alone."""
    orientation: Orientation = "fixed"
    lateral_limit_n: float | None = None
    """Force along the surface, friction included, at which the feed stands still; nothing: no such limit."""
    at_wall: Literal["slow", "stop"] = "slow"
    """slow: the feed becomes slower towards the limit, and the step fails when it gets no farther. stop: it fails at
    the limit.
    """
    feed_error_n: float | None = None
    """Error of the force at which the feed is a tenth; without an error it is whole. Nothing: always whole."""
    across: Literal["position", "compliant", "force"] = "position"
    """The axis across the path: on the path; yielding to the force; or pressing with a force."""
    across_n: float = 0.0
    """Force across the path, N, positive to the left of it; with across = "force"."""
    across_n_mm: float = 1.0
    """Force that moves the tool by 1 mm beside the path; with across = "compliant"."""
    across_mm: float = 5.0
    """Farthest that the tool may be beside the path."""
    criterion: Criterion | None = None
    limits: StepLimits = StepLimits()

    def __post_init__(self) -> None:
        names = "speed_mm_s", "for_s", "lateral_limit_n", "feed_error_n", "across_n_mm", "across_mm"
        _above_zero(self, *names)
        check_profile(self.force_n)
        if self.across == "force" and not (math.isfinite(self.across_n) and self.across_n):
            raise SettingError("across_n", 'must be a force that is not 0 for across = "force"')
        if self.across_n and self.across != "force":
            raise SettingError("across_n", f'needs across = "force", now "{self.across}"')


@dataclass(frozen=True, slots=True)
class Hold:
    """Press at the place for a time."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    for_s: float
    do: Literal["hold"] = "hold"
    name: str = ""
    """Name under which the mean place of the second half of the time is told; empty for none."""
    force_n: float | None = None
    orientation: Orientation = "fixed"
    criterion: Criterion | None = None
    limits: StepLimits = StepLimits()

    def __post_init__(self) -> None:
        _above_zero(self, "for_s", "force_n")


@dataclass(frozen=True, slots=True)
class Seek:
    """Move along the surface until something is found: a force against the tool, or the edge of the surface."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    direction_deg: float
    """Direction in the plane, from x towards y."""
    do: Literal["seek"] = "seek"
    until: Literal["force", "edge"] = "force"
    """force: in free space, until something pushes back. edge: pressing, until the surface ends."""
    name: str = ""
    """Name under which the found place is told; empty for none."""
    at_most_mm: float = 50.0
    speed_mm_s: float | None = None
    """Nothing: the speed of an approach."""
    contact_n: float | None = None
    """Force that counts as found; nothing: that of the task's contact."""
    back_off_mm: float = 1.0
    """Way back from what pushed back; unused for an edge."""
    limits: StepLimits = StepLimits()

    def __post_init__(self) -> None:
        _above_zero(self, "at_most_mm", "speed_mm_s", "contact_n")
        require_not_negative(self, "back_off_mm")
        if not math.isfinite(self.direction_deg):
            raise SettingError("direction_deg", "must be a number")


@dataclass(frozen=True, slots=True)
class Retract:
    """Back out of the surface, at least to the depth of the start."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    do: Literal["retract"] = "retract"
    back_mm: float | None = None
    """Way back from where the tool is."""
    speed_mm_s: float | None = None
    limits: StepLimits = StepLimits()

    def __post_init__(self) -> None:
        _above_zero(self, "speed_mm_s")
        if self.back_mm is not None:
            require_not_negative(self, "back_mm")


@dataclass(frozen=True, slots=True)
class Move:
    """Go to another place through free space, at the safe height; a touch on the way ends the run."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    to_mm: Place
    """Place in the work frame."""
    do: Literal["move"] = "move"
    speed_mm_s: float = 10.0
    """Speed of the way across; an obstacle is met with it. Chosen."""
    contact_n: float | None = None
    """Force that counts as a touch; nothing: that of the task's contact."""
    limits: StepLimits = StepLimits()

    def __post_init__(self) -> None:
        _above_zero(self, "speed_mm_s", "contact_n")
        check_finite("to_mm", self.to_mm)


@dataclass(frozen=True, slots=True)
class Zero:
    """Stand still in free space, and take what the sensor reads there for zero: against drift between strokes."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    do: Literal["zero"] = "zero"
    settle_ms: float = 1000.0
    """Time to stand still before: for the servo and the sensor's filter. Chosen."""
    for_ms: float = 500.0
    """Time over which the reading is averaged. Chosen."""
    at_most_n: float = 2.0
    """Largest force that may be taken for zero; more looks like a touch. Chosen."""
    limits: StepLimits = StepLimits()

    def __post_init__(self) -> None:
        _above_zero(self, "settle_ms", "for_ms", "at_most_n")


SimpleStep: TypeAlias = Annotated[Approach | Track | Hold | Seek | Retract | Move | Zero, Discriminator("do")]
"""A step that holds no others."""


@dataclass(frozen=True, slots=True)
class Repeat:
    """The same steps several times."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    times: int
    """Passes, at most."""
    step: tuple[SimpleStep, ...]
    do: Literal["repeat"] = "repeat"
    until_removed_mm: float | None = None
    """No further pass once the tracks lie deeper than in the first pass by this much, on average. Nothing: all passes.
    """
    limits: StepLimits = field(default=StepLimits(), repr=False)

    def __post_init__(self) -> None:
        if not 1 <= self.times <= 1000:
            raise SettingError("times", f"must be 1 … 1000, got {self.times}")
        if not self.step:
            raise SettingError("step", "must hold at least one step")
        if self.limits != StepLimits():
            raise SettingError("limits", "must stand in the steps of the repeat")
        _above_zero(self, "until_removed_mm")
        if self.until_removed_mm is not None and not any(step.do == "track" for step in self.step):
            raise SettingError("until_removed_mm", "needs a track among the steps")


Step: TypeAlias = Annotated[
    Approach | Track | Hold | Seek | Retract | Move | Zero | Repeat, Discriminator("do")
]
"""A step of a program, by its word."""


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """Where a program goes on. `run --resume` fills it in."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    leg: int
    """Step of the program, passes counted, from 0."""
    way_mm: float
    """Way along its path from which it goes on; 0 for a step without a path."""
    place_mm: Place
    """That place in the work frame."""
    start_m: Vector
    """Start point of the first run, base frame: the safe height, and paths without an origin, count from there."""
    quaternion: Quaternion
    """Orientation of that start."""
    spent_s: float = 0.0
    """Time that the step has had already."""


def _above_zero(step: object, *names: str) -> None:
    """Raise ValueError for the first of these attributes that is given and not above 0."""
    require_above_zero(step, *(name for name in names if getattr(step, name) is not None))


def check_profile(force: ForceProfile | None) -> None:
    """Raise ValueError for a force profile with gaps, or with a force that does not press."""
    if force is None:
        return
    pairs = ((0.0, force),) if isinstance(force, (int, float)) else force
    if not pairs or pairs[0][0] != 0.0:
        raise SettingError("force_n", "must begin at 0 mm of the way")
    for (before, _), (after, _) in pairwise(pairs):
        if not after > before:
            raise SettingError(
                "force_n", f"must ascend along the way, but {after:g} mm follows {before:g} mm"
            )
    for _, value in pairs:
        if not (math.isfinite(value) and value > 0):
            raise SettingError("force_n", f"must be above 0 N everywhere, got {value:g}")
