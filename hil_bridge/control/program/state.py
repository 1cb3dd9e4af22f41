"""The state of a program from one sample to the next, and its input beside a measurement."""

import math
from typing import Any

from msgspec import Struct

from hil_bridge.control.course.facing import FacingState
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.stroke import StrokeState
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.sample import Sample
from hil_bridge.control.types import Measurement
from hil_bridge.errors.causes import Reason
from protocol.geometry import Quaternion, Vector


class Felt(Struct, frozen=True):
    """One sample as a program sees it, in the work frame."""

    sample: Sample
    measurement: Measurement
    """The direction in which the force is controlled."""
    place: Place
    """Reported x and y from the start point, m."""
    force: Vector
    """Contact force along the approach, x and y, N, positive where the tool presses that way; from the newest zero."""
    wrench: tuple[float, ...]
    """Contact wrench in the tool frame from the newest zero, N and N·m, (6,); empty where it is not known."""

    @property
    def aside(self) -> float:
        """Length of the force across the approach, or what the moments tell of it, whichever is more, N. 0 where the
        axes that measure it are verified.
        """
        hidden = self.sample.hidden
        return 0.0 if hidden is None else max(math.hypot(self.force[1], self.force[2]), hidden)

    def against(self, heading: Place) -> float:
        """Force against a way in this direction of the work frame, N."""
        return self.force[1] * heading[0] + self.force[2] * heading[1]


class Done(Struct, frozen=True):
    """A step that has ended."""

    leg: int
    """Place in the program's list, from 0."""
    began: float
    """s on the run's clock."""
    ended: float
    """s on the run's clock."""
    way: float = 0.0
    """Way along the path, m."""
    force_mean: float | None = None
    """Mean force of the samples in contact, N; None where there were none."""
    within: float | None = None
    """Share of the way for which the force was within the criterion; None where there is no criterion."""
    passed: bool = True
    """The criterion is met, or there is none."""
    found: Vector | None = None
    """Place that was found, base frame, m; None where nothing was sought."""
    text: str = ""
    """How it ended, in words."""
    resumable: float = 0.0
    """Way until which the force was last within its band, m: a resumed run goes on from there."""


class Tally(Struct, frozen=True):
    """Sums over the samples of a step."""

    total: float = 0.0
    """Way judged by the criterion, m, or time, s, where there is no way."""
    within: float = 0.0
    """The part of it with the force within the band."""
    force: float = 0.0
    """Sum of force x way, or time."""
    deep: float = 0.0
    """Sum of depth x way, or time."""
    good: float = 0.0
    """Way until which the force was last within the band, m."""


class ProgramState(Struct, frozen=True):
    """Where a program is."""

    stroke: StrokeState = StrokeState()
    reason: Reason | None = None
    """Why the run retracts and ends before the last step; None while it goes on."""
    failed: bool = False
    """The reason is a failure."""
    leg: int = 0
    """Place of the step in the list, from 0."""
    began: float | None = None
    """When the step began, s on the run's clock; None before its first sample."""
    start: Place | None = None
    """The start point in the work frame, m; None before the first sample."""
    safe: float = 0.0
    """Depth of the safe height, m."""
    at: Place = (0.0, 0.0)
    """Commanded x and y from the start point, m."""
    origin: Place = (0.0, 0.0)
    """Where the way of this step begins, from the start point, m."""
    base: float = 0.0
    """Way of the run at which this step begins, m."""
    local: float = 0.0
    """Commanded way along the path of this step, m."""
    reached: float = 0.0
    """Reported way along the path of this step, m."""
    ground: float = 0.0
    """Depth of the plane that the normal predicts at the commanded place, from that of the first contact, m."""
    aside: float = 0.0
    """Commanded way to the left of the path, m."""
    lean: float = 0.0
    """Angle by which the controller tips the tool's axis towards the travel, from the start's orientation, rad."""
    stage: int = 0
    """Part of a step that has several."""
    stage_at: float = 0.0
    """Way along the path to which a step goes back, m."""
    since: float = 0.0
    """When this part began, s on the run's clock."""
    stuck: float = 0.0
    """Time since the tool was last seen to get along its path, s."""
    passed: float = 0.0
    """Way along the path at that time, m."""
    yielded: float = 0.0
    """Way that the tool has yielded to a force from the side while it retracts, m."""
    feed: float = 1.0
    """Share of the speed at which the tool goes along its path."""
    memory: Any = None
    """The step's own state, or that of the controller across the path; None at the step's first sample."""
    facing: FacingState = FacingState()
    home: Quaternion | None = None
    """Orientation of the start; None before the first sample."""
    turned: Quaternion | None = None
    """Orientation that is ordered; None while the program leaves it alone."""
    zero: tuple[float, ...] = ()
    """Contact wrench in the tool frame that is taken off, N and N·m; empty where no zero was taken."""
    readings: tuple[tuple[float, ...], int, int] = ((), 0, -1)
    """Sum of the wrenches of a zero, their number, and the newest frame's counter."""
    found: tuple[Vector, int] = ((0.0, 0.0, 0.0), 0)
    """Sum of reported places, m, and their number."""
    tally: Tally = Tally()
    first_pass: float | None = None
    """Mean depth of the tracks in the first pass of a repeat, m."""
    this_pass: tuple[float, float] = (0.0, 0.0)
    """Sums of depth x way and of way of the steps of this pass that have ended, m², m."""
    text: str = ""
    """Words of the step on its end; empty for none."""
    done: tuple[Done, ...] = ()
    """Steps that have ended, oldest first."""
    led: Reason | None = None
    """Why the newest step along the surface ended: its time, or its way; None before the first."""
    heading: Place = (1.0, 0.0)
    """Direction of the newest path, unit vector in x and y; the travel direction before the first."""

    @property
    def phase(self) -> Phase:
        """Phase of the run."""
        return self.stroke.phase

    @property
    def in_contact(self) -> bool:
        """Whether the tool is taken to be in contact."""
        return self.stroke.in_contact
