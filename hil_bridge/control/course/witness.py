"""The second witness: the force that the robot itself feels, beside that of the force sensor. Pure.

A robot's own force is coarse and has an offset, so it is no measure of the contact. It tells only whether the sensor
can be right. A gross difference that lasts means that one of the two is wrong, or that something touches the robot
beside the sensor. The run ends then, and the tool goes back. A witness that is silent changes nothing.
"""

import math
from dataclasses import dataclass

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation
from hil_bridge.errors.causes import Cause, Reason

SHARE = 0.5
"""Share of the larger force that may always be missing in the other. Chosen: a touch that both see 25 ms apart stays
within it, and a sensor that tells a third of the force does not.
"""


@dataclass(frozen=True, slots=True)
class Witness:
    """How far, and for how long, the robot's own force may be from the sensor's."""

    ordinary_n: float
    """Difference that is still ordinary, N."""
    lasting_s: float
    """Time for which a larger one may last, s."""

    def disagreed(self, before: float | None, seen: Observation) -> float | None:
        """Time for which both have disagreed, s; None while they agree, or there is no witness.

        Each cycle is weighed by how many times the difference is what is allowed. The first one counts nothing: one
        sample is no difference that lasts.
        """
        witness = seen.sample.witness
        if witness is None or not math.isfinite(witness):
            return None
        apart = abs(witness - seen.sample.force)
        allowed = max(self.ordinary_n, SHARE * max(abs(witness), abs(seen.sample.force)))
        if apart <= allowed:
            return None
        return 0.0 if before is None else before + seen.dt * apart / allowed

    def find_stop(self, disagreed: float | None, seen: Observation) -> Reason | None:
        """Return the reason to stop for a difference that has lasted too long; None for another."""
        if disagreed is None or disagreed < self.lasting_s:
            return None
        force, witness = seen.sample.force, seen.sample.witness
        text = (
            f"the force sensor tells {force:.1f} N, the robot itself feels {witness:.1f} N: look whether the "
            "sensor reads what presses on the tool, and whether anything else touches the robot"
        )
        return Reason(Cause.WITNESS, text)


def witness_of(limits: Limits, ordinary_n: float, delay_s: float) -> Witness | None:
    """Return the rule for a robot that measures a force itself, by settings and facts; None if it is not requested."""
    if limits.witness_n == 0.0:
        return None
    allowed_n = ordinary_n if limits.witness_n is None else limits.witness_n
    return Witness(allowed_n, limits.witness_ms * 1e-3 + 2.0 * delay_s)
