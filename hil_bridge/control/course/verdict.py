"""Observations, requests and verdicts of the supervisor: plain values."""

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
    """The facts of a cycle as the guard sees them: the sample, and where it was taken."""

    sample: Sample
    """Its force is that from the newest zero, or from the zero before it, whichever is more."""
    depth: float = 0.0
    """Reported position along the approach direction from the start point, m."""
    dt: float = SAMPLE_MS * 1e-3
    """Time since the cycle before, as `Measurement.dt`, s."""
    pressing: bool = False
    """Whether the tool is taken to be in contact."""
    against: float = 0.0
    """Contact force against the way, N; 0 where it is not known."""
    aside: float = 0.0
    """Length of the contact force across the approach, or what the moments tell of it, whichever is more, N. 0 where
    the axes that measure it are verified.
    """
    free_force: float | None = None
    """Contact force along the approach direction from the newest zero while the tool moves through free space, N; None
    elsewhere.
    """

    @property
    def position(self) -> Vector | None:
        """Reported position, base frame, m; None where it is not to be judged."""
        return None if self.sample.tilt is None else self.sample.position


class Request(Struct, frozen=True, gc=False):
    """Target that the task asks for."""

    depth: float
    """Along the approach direction from the start point, m."""
    position: Vector
    """The same target as a point in the base frame, m."""
    direction: Vector
    """Approach direction: unit vector into the surface, base frame."""
    barrier: float = math.inf
    """Depth at which the force limit less its margin is predicted, m."""
    quaternion: Quaternion | None = None
    """Orientation wanted; None leaves it as it is."""
    stiffness: tuple[float | None, float] = (None, 5000.0)
    """Stiffness of the contact that the controller has learnt, None where it has none, and that expected, N/m."""


class Allow(Struct, frozen=True, gc=False):
    """Send the request as it is."""

    kind: ClassVar[str] = "allow"
    depth: float
    """Depth of the command from the start point, m."""
    position: Vector
    """The same as a point in the base frame, m."""


class Clamp(Struct, frozen=True):
    """Send this instead of the request."""

    kind: ClassVar[str] = "clamp"
    depth: float
    """Depth of the command from the start point, m."""
    position: Vector
    """The same as a point in the base frame, m."""
    holds: tuple[Reason, ...]
    """Why it is not the request."""
    goes_on: bool = False
    """It holds back a way that continues later."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it is not the request, in words."""
        return tuple(map(str, self.holds))

    def is_for(self, cause: Cause) -> bool:
        """Whether this is one of its causes."""
        return any(reason.cause is cause for reason in self.holds)


class Stop(Struct, frozen=True):
    """Send nothing more: end the motion."""

    kind: ClassVar[str] = "stop"
    reason: Reason


LEAVES = Reason(Cause.WORKSPACE, "leaves the workspace")
WAITS = Reason(Cause.RETRACT_WAITS, "the force does not come down: the retraction waits, then tries slowly")
SLOWLY = Reason(Cause.NO_FORCE, "without a force to go by slowly back")
NO_FARTHER = Reason(Cause.NO_FORCE, "without a force to go by no farther back")
OVERDUE = Reason(Cause.OVERDUE, "no deeper while the next force is late")

Verdict: TypeAlias = Allow | Clamp | Stop


class Stage(StrEnum):
    """Stages of a retraction that the force from the front does not answer."""

    GOES = "goes"
    """It continues."""
    WAITS = "waits"
    """It stands, to see whether the force rises without it."""
    SLOW = "slow"
    """It tries a second time, slowly."""
    TRUSTED = "trusted"
    """The force rose while it stood, or fell when it tried again: the way back is right, and it continues."""


class Retreat(Struct, frozen=True):
    """Course of a retraction so far."""

    began_at: float
    """s on the run's clock."""
    from_contact: bool
    """The tool pressed when it began."""
    lowest: float
    """Resultant force that it has come down to, N; while it has not taken effect yet, the newest."""
    depth: float
    """Reported depth at which the force last came down, m."""
    within: bool = False
    """The retraction began within the force limit, so that nothing may carry the force beyond."""
    force: float = 0.0
    """Force along the approach when it began, N."""
    front: float = 0.0
    """Largest force from the front that was told since, N."""
    stage: Stage = Stage.GOES
    since: float = 0.0
    """When it began to wait, s on the run's clock."""
    level: float = 0.0
    """Force beyond which it must not rise at this stage, N."""
    dt: float = 0.0
    """Time of the cycle in which it began to wait, s."""
    begun: float = 0.0
    """Reported depth when the retraction began, m."""
    pull: float = 0.0
    """Pull that the unloading of a tool has made which is deeper than its force explains, N."""


class SupervisorState(Struct, frozen=True, gc=False):
    """Place of the last allowed command, the reports of the devices, and the stop if there was one."""

    depth: float
    """Depth allowed last, m; at the beginning that of the reported position, so 0 at the start point."""
    position: Vector
    """Position allowed last, base frame, m; at the beginning the reported one."""
    sensor_sequence: int | None = None
    still: float = 0.0
    """Time of the cycles without a new sensor frame, s."""
    pressed: tuple[float, float] | None = None
    """Contact force that has not changed since, N, and the reported depth when it was new, m; None without contact."""
    stopped: Reason | None = None
    reported: tuple[float, Vector] | None = None
    """When a position was judged last, s, and that position, base frame, m; None before the first."""
    retreat: Retreat | None = None
    """None while the run continues."""
    quaternion: Quaternion | None = None
    """Orientation allowed last; None for that of the start."""
    home: Quaternion | None = None
    """Orientation from which the tilt counts; None before the tool was turned."""
    lag: float = 0.0
    """Turn that the robot may not have followed yet, rad."""
    disagreed: float | None = None
    """Weighted time for which force sensor and robot have disagreed, s; None while they agree."""
    free: FreeSpace | None = None
    """Watch over the sensor while the tool moves through free space; None elsewhere."""
    contact: Contact | None = None
    """Depth and force of the contact, and where the tool was last free; None before the first cycle."""
