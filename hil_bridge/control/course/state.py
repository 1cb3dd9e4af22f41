"""The state of a program between two samples: `Course` is the program's own part, `StepState` that of its step.

A step is given both and answers its own part alone.
"""

from typing import Any, Generic

from msgspec import Struct
from typing_extensions import TypeVar

from hil_bridge.control.course.facing import FacingState
from hil_bridge.control.course.stroke import StrokeState
from hil_bridge.control.geometry.ways import Place
from hil_bridge.errors.causes import Reason
from protocol.geometry import Quaternion, Vector

M = TypeVar("M", default=Any)
"""Type of a step's own memory."""


class Done(Struct, frozen=True):
    """Outcome of a step that has ended."""

    leg: int
    """Place in the program's list, from 0."""
    began: float
    """s on the run's clock."""
    ended: float
    """s on the run's clock."""
    way: float = 0.0
    """Length of the path covered, m."""
    force_mean: float | None = None
    """Mean force of the samples in contact, N; None where there were none."""
    within: float | None = None
    """Share of the path on which the force met the criterion; None without a criterion."""
    passed: bool = True
    """Whether the criterion is met; True without one."""
    found: Vector | None = None
    """Place that the step located, base frame, m; None for a step that locates none."""
    text: str = ""
    """Description of how it ended."""
    resumable: float = 0.0
    """Length of the path up to which the force was last within its band, m: a resumed run continues there."""


class Tally(Struct, frozen=True):
    """Sums over the samples of a step."""

    total: float = 0.0
    """Length of the path judged by the criterion, m, or time, s, for a step without a path."""
    within: float = 0.0
    """The part of it with the force within the band."""
    force: float = 0.0
    """Sum of force x length, or time."""
    deep: float = 0.0
    """Sum of depth x length, or time."""
    good: float = 0.0
    """Length of the path up to which the force was last within the band, m."""


class StepState(Struct, Generic[M], frozen=True):
    """The part of the state that a step answers: place, path, contact, and a memory of its own."""

    stroke: StrokeState = StrokeState()
    at: Place = (0.0, 0.0)
    """Commanded x and y from the start point, m."""
    heading: Place = (1.0, 0.0)
    """Direction of the newest path, unit vector in x and y; the travel direction before the first."""
    ground: float = 0.0
    """Depth of the plane that the normal predicts at the commanded place, from that of the first contact, m."""
    memory: M | None = None
    """The step's own memory; None at its first sample."""
    local: float = 0.0
    """Commanded length along the path of this step, m."""
    aside: float = 0.0
    """Commanded distance to the left of the path, m."""
    lean: float = 0.0
    """Angle by which the controller tips the tool's axis towards the travel, from the start's orientation, rad."""
    feed: float = 1.0
    """Share of the speed at which the tool moves along its path."""
    yielded: float = 0.0
    """Distance by which the tool has yielded to a force from the side while it retracts, m."""
    tally: Tally = Tally()
    found: tuple[Vector, int] = ((0.0, 0.0, 0.0), 0)
    """Sum of reported places, m, and their number; their mean is the place that the step locates."""
    text: str = ""
    """Description of how the step ended; empty for none."""


class Course(Struct, frozen=True):
    """The program's own part of the state; steps read it."""

    leg: int = 0
    """Place of the step in the list, from 0."""
    began: float | None = None
    """When the step began, s on the run's clock; None before its first sample."""
    reason: Reason | None = None
    """Why the run retracts and ends before the last step; None while it continues."""
    failed: bool = False
    """Whether the reason is a failure."""
    start: Place | None = None
    """The start point in the work frame, m; None before the first sample."""
    safe: float = 0.0
    """Depth of the safe height, m."""
    home: Quaternion | None = None
    """Orientation of the start; None before the first sample."""
    turned: Quaternion | None = None
    """Commanded orientation; None while the program does not turn the tool."""
    zero: tuple[float, ...] = ()
    """Contact wrench in the tool frame that is subtracted, N and N·m; empty where no step took a zero."""
    origin: Place = (0.0, 0.0)
    """Where the path of this step begins, from the start point, m."""
    base: float = 0.0
    """Length of the run's path at which this step begins, m."""
    reached: float = 0.0
    """Reported length along the path of this step, m."""
    facing: FacingState = FacingState()
    first_pass: float | None = None
    """Mean depth of the tracks in the first pass of a repeat, m."""
    this_pass: tuple[float, float] = (0.0, 0.0)
    """Sums of depth x length and of length of the steps of this pass that have ended, m², m."""
    done: tuple[Done, ...] = ()
    """Steps that have ended, oldest first."""
    travelled: Reason | None = None
    """Why the newest step with a path ended: its time, or the path's end; None before the first."""
