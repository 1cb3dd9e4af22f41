"""Confirmation of a doubtful touch: the tool moves deeper in small steps, and the force must rise. Pure.

A touch is in doubt if the tool's weight could not verify the axis, or if the force looks like the force of a sensor
that has lost that weight. A surface responds to each step with a force. An axis that is dead, or that reports a
small part of the force, does not respond.
"""

from enum import IntEnum

from msgspec import Struct

from hil_bridge.control.types import Measurement
from hil_bridge.errors.causes import Cause, Reason

SETTLES_S = 0.3
"""Time to wait for the force once the robot reports arrival, s. Chosen: longer than the filter of any supported
sensor in its usual setting, and longer than one cycle of the slowest link.
"""
PATIENCE_S = 5.0
"""Time limit of one step, until the robot reports arrival, s. Chosen."""
_STEPS = 4.0
"""Number of steps over the depth within which the force must rise, for a robot with fine resolution. Chosen."""
_THERE_M = 0.1e-3
"""Distance from the ordered depth at which the tool counts as arrived, m. Chosen: below a step of a coarse robot."""
_LOST_WEIGHT_M = 1e-3
"""Depth within which a force that looks like the lost weight must rise, m. Chosen: at 0.8 kN/m, the force rises by
0.8 N.
"""
_SHORT_M = 5e-5
"""Distance by which a reported depth may fall short of the last step, m. Chosen: half of the distance within which
the tool counts as arrived.
"""
_ROUNDING = 1e-9
"""Tolerance for the rounding error of summed steps, m."""
_TRUSTED_M = 0.25e-3
"""Distance that a tracking tool may move deeper, by its orders and by its reports, while its force looks like the
lost weight, m. Chosen: within this distance, a surface of 5 kN/m raises the force out of that range. Motion that
was ordered before tracking does not count, because its force is yet to come.
"""


class Doubt(IntEnum):
    """Reason why a touch must be confirmed."""

    NONE = 0
    """No confirmation is needed."""
    WEIGHT = 1
    """The force looks like the force of a sensor that has lost the tool's weight."""
    AXIS = 2
    """The tool's weight has not verified the axis that measures the force."""


class Touch(Struct, frozen=True):
    """Touch that is being confirmed."""

    doubt: Doubt
    since: float = 0.0
    """Time since the current step began, s."""
    arrived: float = 0.0
    """Time since the robot reported arrival, s."""
    began: tuple[float, float] | None = None
    """Force, N, and reported depth, m, relative to which the rise is measured; None until the tool is stationary."""
    proven: bool = False
    goal: float | None = None
    """Commanded depth of the current step, m; None while the tool comes to a stop. During tracking: commanded depth
    at which the doubt began.
    """


def begin_tracking() -> Touch:
    """Return the touch for the first samples of tracking. A dead sensor reports its lost weight gradually, because
    of its filter.
    """
    return Touch(Doubt.WEIGHT)


def keep_tracking(touch: Touch, doubt: Doubt, measurement: Measurement) -> tuple[Touch | None, bool]:
    """Return the touch after a sample, and whether the tool must stop now and confirm the touch.

    The touch is None once the force has been outside the range of a lost weight for long enough.
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
    """Criteria that the force of a real touch must meet."""

    rise_n: float
    """Minimum rise of the force, above all noise, N."""
    least_stiffness: float
    """Minimum stiffness of an accepted touch, N/m."""
    step: float
    """Resolution of the robot's position, m; 0 for a robot without position steps."""

    def depth(self, doubt: Doubt) -> float:
        """Return the largest depth that the tool moves to confirm a touch, m."""
        if doubt is Doubt.WEIGHT:
            return max(_LOST_WEIGHT_M, 2.0 * self.step)
        return max(self.rise_n / self.least_stiffness, 2.0 * self.step)

    def after(self, touch: Touch, measurement: Measurement) -> tuple[Touch, float, Reason | None]:
        """Return the touch after a sample, how far to move deeper, m, and the reason why the touch is rejected
        (None while it may be a touch).
        """
        dt, force, reported = measurement.dt, measurement.force, measurement.position
        left = 0.0 if touch.goal is None else max(touch.goal - measurement.commanded, 0.0)
        there = left < _ROUNDING and abs(measurement.commanded - reported) <= _THERE_M
        since, arrived = touch.since + dt, touch.arrived + dt if there else 0.0
        touch = Touch(touch.doubt, since, arrived, touch.began, goal=touch.goal)
        if touch.began is not None and self._answered(touch, force, reported):
            return Touch(touch.doubt, since, arrived, touch.began, proven=True), 0.0, None
        if since > PATIENCE_S + SETTLES_S:
            text = "the touch cannot be confirmed: the robot does not reach the ordered depth"
            return touch, 0.0, Reason(Cause.UNTESTED_TOUCH, text)
        if arrived < SETTLES_S:
            return touch, left, None
        began = (force, reported) if touch.began is None else touch.began
        most = self.depth(touch.doubt)
        if reported - began[1] >= most - min(_SHORT_M, most / 2.0 / _STEPS):
            text = self._explain_unanswered(touch, force, reported)
            return touch, 0.0, Reason(Cause.UNANSWERED_TOUCH, text)
        step = max(most / _STEPS, self.step)
        return Touch(touch.doubt, began=began, goal=measurement.commanded + step), step, None

    def _answered(self, touch: Touch, force: float, reported: float) -> bool:
        assert touch.began is not None
        rise, deeper = force - touch.began[0], reported - touch.began[1]
        if rise < self.rise_n:
            return False
        return touch.doubt is Doubt.WEIGHT or rise >= self.least_stiffness * deeper

    def _explain_unanswered(self, touch: Touch, force: float, reported: float) -> str:
        assert touch.began is not None
        before, deeper = touch.began[0], reported - touch.began[1]
        went = f"the force does not respond: {before:.2f} N at the touch, {force:.2f} N {deeper * 1e3:.2f} mm deeper"
        if touch.doubt is Doubt.WEIGHT:
            return f"{went}: the sensor has lost the tool's weight of so much, and does not measure the touch"
        return (
            f"{went}, where {self.least_stiffness:g} N/m are the least (task.least_stiffness_n_m): an axis of the "
            "sensor is dead or scaled wrongly, or the surface is softer"
        )
