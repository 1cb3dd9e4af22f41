"""State of a program between two samples: `Course` belongs to the program, `StepState` to its current step.

A step receives both and returns only `StepState`.
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
"""Type of a step's internal memory."""


class Done(Struct, frozen=True):
    """Result of a step that has ended."""

    leg: int
    """Index of the step in the program's list, from 0."""
    began: float
    """Start time, s on the run's clock."""
    ended: float
    """End time, s on the run's clock."""
    way: float = 0.0
    """Length of the path covered, m."""
    force_mean: float | None = None
    """Mean force of the samples in contact, N; None if there are no such samples."""
    within: float | None = None
    """Share of the path on which the force met the criterion; None if there is no criterion."""
    passed: bool = True
    """Whether the criterion is met; True if there is no criterion."""
    found: Vector | None = None
    """Position that the step located, base frame, m; None if the step locates no position."""
    text: str = ""
    """Description of how the step ended."""
    resumable: float = 0.0
    """Path length up to which the force was last within its band, m. A resumed run continues there."""


class Tally(Struct, frozen=True):
    """Sums over the samples of a step, for its outcome."""

    total: float = 0.0
    """Length of the path judged by the criterion, m; for a step without a path, the time, s."""
    within: float = 0.0
    """Part of `total` during which the force was within the band."""
    force: float = 0.0
    """Sum of force × length, or of force × time for a step without a path."""
    deep: float = 0.0
    """Sum of depth × length, or of depth × time for a step without a path."""
    good: float = 0.0
    """Path length up to which the force was last within the band, m."""


class StepState(Struct, Generic[M], frozen=True):
    """Part of the state that a step returns: position, path, contact and internal memory."""

    stroke: StrokeState = StrokeState()
    at: Place = (0.0, 0.0)
    """Commanded x and y relative to the start point, m."""
    heading: Place = (1.0, 0.0)
    """Direction of the newest path, as a unit vector in x and y; the travel direction before the first path."""
    ground: float = 0.0
    """Depth of the plane that the normal predicts at the commanded position, relative to the depth of the first
    contact, m.
    """
    memory: M | None = None
    """Internal memory of the step; None at its first sample."""
    local: float = 0.0
    """Commanded path length in this step, m."""
    aside: float = 0.0
    """Commanded distance to the left of the path, m."""
    lean: float = 0.0
    """Angle by which the controller tilts the tool's axis towards the travel, relative to the orientation at the
    start, rad.
    """
    feed: float = 1.0
    """Feed of the tool along its path, as a share of the speed."""
    yielded: float = 0.0
    """Distance by which the tool has yielded to a force from the side while it retracts, m."""
    tally: Tally = Tally()
    found: tuple[Vector, int] = ((0.0, 0.0, 0.0), 0)
    """Sum of the reported positions, m, and their number. Their mean is the position that the step locates."""
    text: str = ""
    """Description of how the step ended; empty if there is none."""


class Course(Struct, frozen=True):
    """Part of the state that the program returns; read-only for steps."""

    leg: int = 0
    """Index of the step in the list, from 0."""
    began: float | None = None
    """Time at which the step began, s on the run's clock; None before its first sample."""
    reason: Reason | None = None
    """Reason why the run retracts and ends before the last step; None while it continues."""
    failed: bool = False
    """Whether the reason is a failure."""
    start: Place | None = None
    """Start point in the work frame, m; None before the first sample."""
    safe: float = 0.0
    """Safe height, as a depth, m."""
    home: Quaternion | None = None
    """Orientation at the start; None before the first sample."""
    turned: Quaternion | None = None
    """Commanded orientation; None while the program does not turn the tool."""
    zero: tuple[float, ...] = ()
    """Contact wrench in the tool frame that is subtracted as the zero, N and N·m; empty if no step took a zero."""
    origin: Place = (0.0, 0.0)
    """Start of this step's path relative to the start point, m."""
    base: float = 0.0
    """Path length of the run at which this step begins, m."""
    reached: float = 0.0
    """Reported path length in this step, m."""
    facing: FacingState = FacingState()
    first_pass: float | None = None
    """Mean depth of the tracks in the first pass of a repeat, m."""
    this_pass: tuple[float, float] = (0.0, 0.0)
    """Sums over the steps of this pass that have ended: depth × length, m², and length, m."""
    done: tuple[Done, ...] = ()
    """Steps that have ended, oldest first."""
    travelled: Reason | None = None
    """Cause that ended the newest step with a path: its time or the end of the path; None before the first such
    step.
    """
