"""Observations, requests and verdicts of the supervisor, as plain values."""

import math
from enum import StrEnum
from typing import ClassVar, TypeAlias

from msgspec import Struct

from hil_bridge.control.course.depth_watch import Contact
from hil_bridge.control.course.free_space import FreeSpace
from hil_bridge.control.sample import Sample
from hil_bridge.control.types import SAMPLE_MS
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Quaternion, Vector


class Observation(Struct, frozen=True, gc=False):
    """Facts of a cycle as the supervisor receives them: the sample, and where it was taken."""

    sample: Sample
    """Sample with its force relative to the newest or the previous zero, whichever gives the larger force."""
    depth: float = 0.0
    """Reported position along the approach direction from the start point, m."""
    dt: float = SAMPLE_MS * 1e-3
    """Time since the previous cycle, s. Same as `Measurement.dt`."""
    pressing: bool = False
    """Whether the tool is assumed to be in contact."""
    against: float = 0.0
    """Contact force against the motion, N; 0 if unknown."""
    aside: float = 0.0
    """Force across the approach, N: the larger of the measured force and the force derived from the moments. 0 if
    the axes that measure it are verified.
    """
    free_force: float | None = None
    """Contact force along the approach direction relative to the newest zero while the tool moves through free
    space, N; None otherwise.
    """

    @property
    def position(self) -> Vector | None:
        """Reported position, base frame, m; None if it must not be checked."""
        return None if self.sample.tilt is None else self.sample.position


class Request(Struct, frozen=True, gc=False):
    """Target that the task requests."""

    depth: float
    """Target depth along the approach direction from the start point, m."""
    position: Vector
    """Target position in the base frame, m."""
    direction: Vector
    """Approach direction: unit vector into the surface, base frame."""
    barrier: float = math.inf
    """Depth at which the predicted force reaches the force limit less its margin, m."""
    quaternion: Quaternion | None = None
    """Desired orientation; None to keep the current orientation."""
    stiffness: tuple[float | None, float] = (None, 5000.0)
    """Contact stiffness learnt by the controller (None if unknown), and expected contact stiffness, N/m."""


class Allow(Struct, frozen=True, gc=False):
    """Verdict to send the request unchanged."""

    kind: ClassVar[str] = "allow"
    depth: float
    """Commanded depth relative to the start point, m."""
    position: Vector
    """Commanded position in the base frame, m."""


class Clamp(Struct, frozen=True):
    """Verdict to send another target instead of the request."""

    kind: ClassVar[str] = "clamp"
    depth: float
    """Commanded depth relative to the start point, m."""
    position: Vector
    """Commanded position in the base frame, m."""
    holds: tuple[Reason, ...]
    """Reasons why the target differs from the request."""
    goes_on: bool = False
    """Whether the clamp only delays a motion that continues later."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the target differs from the request, as text."""
        return tuple(map(str, self.holds))

    def is_for(self, cause: Cause) -> bool:
        """Return whether the cause is one of the reasons."""
        return any(reason.cause is cause for reason in self.holds)


class Stop(Struct, frozen=True):
    """Verdict to send no further commands and end the motion."""

    kind: ClassVar[str] = "stop"
    reason: Reason


LEAVES = Reason(Cause.WORKSPACE, "leaves the workspace")
WAITS = Reason(
    Cause.RETRACT_WAITS, "the force does not decrease: the retraction pauses, then continues slowly"
)
SLOWLY = Reason(Cause.NO_FORCE, "slow retraction because the force is unknown")
NO_FARTHER = Reason(Cause.NO_FORCE, "no further retraction because the force is unknown")
OVERDUE = Reason(Cause.OVERDUE, "no deeper while the next force is late")

Verdict: TypeAlias = Allow | Clamp | Stop


class Stage(StrEnum):
    """Stages of a retraction, which depend on whether it reduces the force from the front."""

    GOES = "goes"
    """The retraction continues."""
    WAITS = "waits"
    """The retraction pauses, to observe whether the force rises without motion."""
    SLOW = "slow"
    """The retraction is tried again, slowly."""
    TRUSTED = "trusted"
    """The force rose during the pause, or fell on the second try. The direction is therefore right, and the
    retraction continues.
    """


class Retreat(Struct, frozen=True):
    """State of a retraction."""

    began_at: float
    """Start time, s on the run's clock."""
    from_contact: bool
    """Whether the tool pressed when the retraction began."""
    lowest: float
    """Lowest resultant force so far, N; the newest force until the retraction has taken effect."""
    depth: float
    """Reported depth at which the force last decreased, m."""
    within: bool = False
    """Whether the retraction began within the force limit. If so, nothing may raise the force beyond the limit."""
    force: float = 0.0
    """Force along the approach when the retraction began, N."""
    front: float = 0.0
    """Largest reported force from the front since the retraction began, N."""
    stage: Stage = Stage.GOES
    since: float = 0.0
    """Time at which the retraction began to pause, s."""
    level: float = 0.0
    """Force that must not be exceeded in this stage, N."""
    dt: float = 0.0
    """Duration of the cycle in which the retraction began to pause, s."""
    begun: float = 0.0
    """Reported depth when the retraction began, m."""
    pull: float = 0.0
    """False pull that unloading causes if the tool is deeper than its force explains, N."""
    mean: float = 0.0
    """Force from the front, averaged so that an oscillation of the arm hardly shows, N."""


class SupervisorState(Struct, frozen=True, gc=False):
    """State of the supervisor: last allowed command, last device reports, and the stop if there was one."""

    depth: float
    """Last allowed depth, m. The initial value is the depth of the reported position, which is 0 at the start point."""
    position: Vector
    """Last allowed position, base frame, m. The initial value is the reported position."""
    sensor_sequence: int | None = None
    still: float = 0.0
    """Accumulated time of the cycles without a new sensor frame, s."""
    pressed: tuple[float, float] | None = None
    """Contact force that has stayed unchanged, N, and the reported depth at its last change, m; None without
    contact.
    """
    stopped: Reason | None = None
    reported: tuple[float, Vector] | None = None
    """Time at which a position was last checked, s, and the checked position, base frame, m; None before the first
    check.
    """
    retreat: Retreat | None = None
    """State of the retraction; None while the run continues."""
    quaternion: Quaternion | None = None
    """Last allowed orientation; None for the orientation at the start."""
    home: Quaternion | None = None
    """Orientation from which the tilt is measured; None until the tool is first rotated."""
    lag: float = 0.0
    """Rotation that the robot may still have to follow, rad."""
    disagreed: float | None = None
    """Weighted time for which force sensor and robot have disagreed, s; None while they agree."""
    free: FreeSpace | None = None
    """State of the sensor check while the tool moves through free space; None otherwise."""
    contact: Contact | None = None
    """Depth and force of the contact, and the position where the tool was last free; None before the first cycle."""
