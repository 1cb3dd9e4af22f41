"""Second witness: comparison of the force sensor with the robot's own force estimate. Pure.

A robot's own force estimate is coarse and has an offset, so it does not measure the contact. It only shows whether
the sensor can be right. A large difference that persists means that the sensor or the robot is wrong, or that
something touches the robot outside the sensor. The run then ends, and the tool retracts. If the robot reports no
force, nothing changes.
"""

import math
from dataclasses import dataclass

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation
from hil_bridge.errors.causes import Cause, Reason

SHARE = 0.5
"""Share of the larger force by which the other force may always be smaller. Chosen: a touch that both measure 25 ms
apart stays within this share, and a sensor that reports a third of the force does not.
"""


@dataclass(frozen=True, slots=True)
class Witness:
    """Limits of size and duration for a difference between the robot's own force and the sensor's force."""

    ordinary_n: float
    """Largest normal difference, N."""
    lasting_s: float
    """Maximum duration of a larger difference, s."""

    def disagreed(self, before: float | None, observation: Observation) -> float | None:
        """Return the time for which robot and sensor have disagreed, s; None while they agree, or if there is no
        witness.

        Each cycle is weighted by the ratio of the actual to the allowed difference. The first cycle counts 0,
        because a single sample is not a lasting difference.
        """
        witness = observation.sample.witness
        if witness is None or not math.isfinite(witness):
            return None
        apart = abs(witness - observation.sample.force)
        allowed = max(self.ordinary_n, SHARE * max(abs(witness), abs(observation.sample.force)))
        if apart <= allowed:
            return None
        return 0.0 if before is None else before + observation.dt * apart / allowed

    def find_stop(self, disagreed: float | None, observation: Observation) -> Reason | None:
        """Return the reason to stop if a difference has lasted too long; otherwise None."""
        if disagreed is None or disagreed < self.lasting_s:
            return None
        force, witness = observation.sample.force, observation.sample.witness
        text = (
            f"the force sensor reports {force:.1f} N, the robot itself measures {witness:.1f} N: look whether the "
            "sensor reads what presses on the tool, and whether anything else touches the robot"
        )
        return Reason(Cause.WITNESS, text)


def witness_of(limits: Limits, ordinary_n: float, delay_s: float) -> Witness | None:
    """Return the rule for a robot that measures a force itself, from settings and device facts; None if the check
    is not requested.
    """
    if limits.witness_n == 0.0:
        return None
    allowed_n = ordinary_n if limits.witness_n is None else limits.witness_n
    return Witness(allowed_n, limits.witness_ms * 1e-3 + 2.0 * delay_s)
