"""A touch in doubt: the tool goes deeper in small steps, and the force must rise. Pure.

The tool's weight could not verify the axis, or the force looks like that of a sensor that has lost that weight. A
surface answers each step by a force. An axis that is dead, or that tells a small part of the force, does not.
"""

from enum import IntEnum

from msgspec import Struct

from hil_bridge.control.types import Measurement
from hil_bridge.errors.causes import Cause, Reason

SETTLES_S = 0.3
"""Chosen: how long the force is waited for once the robot reports to be there; longer than the filter of any of our
sensors in its usual setting, and than one cycle of the slowest line.
"""
PATIENCE_S = 5.0
"""Chosen: how long one step may take, until the robot reports to be there."""
_STEPS = 4.0
"""Chosen: steps in which the tool goes as deep as a force must be answered by, where the robot has no coarser ones."""
_THERE_M = 0.1e-3
"""Chosen: distance from the ordered depth at which the tool counts as there, m; below a step of a coarse robot."""
_LOST_WEIGHT_M = 1e-3
"""Chosen: depth within which a force that looks like the lost weight must rise, m: 0.8 kN/m make 0.8 N of it."""
_SHORT_M = 5e-5
"""Chosen: distance by which a reported depth may fall short of the last step, m; half of what counts as there."""
_ROUNDING = 1e-9
"""Slack for sums of steps, m."""
_TRUSTED_M = 0.25e-3
"""Chosen: depth that a tool that has begun to track may go while its force looks like the lost weight, m, by its orders
and by its reports. A surface of 5 kN/m carries the force out of that look by then. The way that was ordered before
does not count, for the force of it is still to come.
"""


class Doubt(IntEnum):
    """Why a touch must be proven."""

    NONE = 0
    """It need not."""
    WEIGHT = 1
    """The force is the one that a sensor tells that has lost the tool's weight."""
    AXIS = 2
    """The tool's weight has not verified the axis that measures the force."""


class Touch(Struct, frozen=True):
    """A touch that is being proven."""

    doubt: Doubt
    since: float = 0.0
    """Time that the present step has taken, s."""
    arrived: float = 0.0
    """Time since the robot reported to be there, s."""
    began: tuple[float, float] | None = None
    """Force, N, and reported depth, m, from which the rise counts; None until the tool has come to rest."""
    proven: bool = False
    goal: float | None = None
    """Commanded depth of the present step, m; None while the tool comes to rest first. Of a tool that tracks: the
    commanded depth at which the doubt began.
    """


def begin_tracking() -> Touch:
    """Begin the first moments of tracking: a dead sensor reports its lost weight gradually, through its filter."""
    return Touch(Doubt.WEIGHT)


def keep_tracking(touch: Touch, doubt: Doubt, measurement: Measurement) -> tuple[Touch | None, bool]:
    """Advance by a sample; also return whether the tool must stop now and prove its touch.

    None once the force has shown for long enough that it is none that a lost weight makes.
    """
    force, reported, ordered = measurement.force, measurement.position, measurement.commanded
    if doubt is not Doubt.WEIGHT:
        since = touch.since + measurement.dt
        return (None if since >= SETTLES_S else Touch(Doubt.WEIGHT, since)), False
    before = touch.began or (force, reported)
    began = max(force, before[0]), before[1]
    first = ordered if touch.goal is None else touch.goal
    if reported - before[1] > _TRUSTED_M and ordered - first > _TRUSTED_M:
        return Touch(Doubt.WEIGHT, began=began), True
    return Touch(Doubt.WEIGHT, touch.since, began=began, goal=first), False


class TouchTest(Struct, frozen=True):
    """The force that a touch must show."""

    rise_n: float
    """Rise of the force that no noise makes, N."""
    least_stiffness: float
    """N/m; a softer touch is none."""
    step: float
    """The shortest step of the robot, m; 0 for a robot without."""

    def depth(self, doubt: Doubt) -> float:
        """Way by which the tool goes deeper at most, m."""
        if doubt is Doubt.WEIGHT:
            return max(_LOST_WEIGHT_M, 2.0 * self.step)
        return max(self.rise_n / self.least_stiffness, 2.0 * self.step)

    def after(self, touch: Touch, measurement: Measurement) -> tuple[Touch, float, Reason | None]:
        """Add a sample: the touch, how far to go deeper, m, and why it is no touch; None while it may be one."""
        dt, force, reported = measurement.dt, measurement.force, measurement.position
        left = 0.0 if touch.goal is None else max(touch.goal - measurement.commanded, 0.0)
        there = left < _ROUNDING and abs(measurement.commanded - reported) <= _THERE_M
        since, arrived = touch.since + dt, touch.arrived + dt if there else 0.0
        touch = Touch(touch.doubt, since, arrived, touch.began, goal=touch.goal)
        if touch.began is not None and self._answered(touch, force, reported):
            return Touch(touch.doubt, since, arrived, touch.began, proven=True), 0.0, None
        if since > PATIENCE_S + SETTLES_S:
            text = "the touch cannot be tested: the robot does not come to the depth ordered"
            return touch, 0.0, Reason(Cause.UNTESTED_TOUCH, text)
        if arrived < SETTLES_S:
            return touch, left, None
        began = (force, reported) if touch.began is None else touch.began
        most = self.depth(touch.doubt)
        if reported - began[1] >= most - min(_SHORT_M, most / 2.0 / _STEPS):
            text = self._explain_unanswered(touch, force, reported)
            return touch, 0.0, Reason(Cause.UNANSWERED_TOUCH, text)
        way = max(most / _STEPS, self.step)
        return Touch(touch.doubt, began=began, goal=measurement.commanded + way), way, None

    def _answered(self, touch: Touch, force: float, reported: float) -> bool:
        assert touch.began is not None
        rise, deeper = force - touch.began[0], reported - touch.began[1]
        if rise < self.rise_n:
            return False
        return touch.doubt is Doubt.WEIGHT or rise >= self.least_stiffness * deeper

    def _explain_unanswered(self, touch: Touch, force: float, reported: float) -> str:
        assert touch.began is not None
        before, deeper = touch.began[0], reported - touch.began[1]
        went = f"the touch is not answered: {before:.2f} N, and {force:.2f} N {deeper * 1e3:.2f} mm deeper"
        if touch.doubt is Doubt.WEIGHT:
            return f"{went}: the sensor has lost the tool's weight of so much, and tells no touch"
        return (
            f"{went}, where {self.least_stiffness:g} N/m are the least (task.least_stiffness_n_m): an axis of the "
            "sensor is dead or scaled wrongly, or the surface is softer"
        )
