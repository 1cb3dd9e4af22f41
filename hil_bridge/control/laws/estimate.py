"""Contact stiffness from pairs of reported position and measured force.

Source: eq. (4) of the paper, k = [f(k) − f(k−1)] / [x(k) − x(k−1)], with the gates that trials found necessary. A pair
counts only when the position moved by half a resolution step and the force by twice its uncertainty. The quotient must
also be a possible stiffness. It counts the more, the more its force changed.

Which two samples make a pair. Until there is an estimate, a pair that does not pass the gates keeps its older sample.
So the small moves of a slow approach to a soft surface add up. The sample is given up after a few pairs: a surface that
moves sideways under the tool would otherwise enter the quotient without bound. Once there is an estimate, only
neighbouring samples are compared. Added-up small moves carry the robot's dead band: half a step that was reported but
not moved. On a hard surface this pulls the estimate to half of its value, which is enough for a limit cycle.
"""

import math

from msgspec import Struct


class Gates(Struct, frozen=True):
    """Conditions under which a pair of samples counts."""

    position_change: float
    """Smallest |Δx|, m."""
    force_change: float
    """Smallest |Δf|, N."""
    stiffness_min: float = 1e2
    """Smallest possible stiffness, N/m. Derived: below it in trials only noise was divided."""
    stiffness_max: float = 1e7
    """Largest possible stiffness, N/m. Derived, likewise."""
    half_weight: float = 5.0
    """|Δf| in N at which a new quotient and the estimate so far count alike. Chosen."""
    first_span: int = 5
    """Samples over which moves add up while there is no estimate. Chosen."""


class StiffnessEstimate(Struct, frozen=True):
    """Estimate so far and the older sample of the next pair."""

    stiffness: float | None = None
    """N/m; None before the first pair that counted."""
    position: float | None = None
    """Reported position of the older sample, m; None when the next sample begins again."""
    force: float = 0.0
    """Force of the older sample, N."""
    age: int = 0
    """Samples since the older one."""


def update(estimate: StiffnessEstimate, gates: Gates, position: float, force: float) -> StiffnessEstimate:
    """Take one sample in contact: reported position in m and force in N, positive into the surface.

    A sample that is not finite changes nothing. The mean is taken of logarithms, for stiffness spans decades.
    """
    if not math.isfinite(position + force):
        return estimate
    if estimate.position is None:
        return StiffnessEstimate(estimate.stiffness, position, force)
    moved, pressed = position - estimate.position, force - estimate.force
    # Positions are multiples of the resolution step with rounding errors far below this margin.
    if abs(moved) >= gates.position_change * (1 - 1e-6) and abs(pressed) >= gates.force_change:
        return StiffnessEstimate(
            _average(estimate.stiffness, gates, pressed / moved, pressed), position, force
        )
    if estimate.stiffness is None and estimate.age + 1 < gates.first_span:
        return StiffnessEstimate(None, estimate.position, estimate.force, estimate.age + 1)
    return StiffnessEstimate(estimate.stiffness, position, force)


def contact_lost(estimate: StiffnessEstimate) -> StiffnessEstimate:
    """Keep the stiffness; the next sample in contact begins a new pair, for in the air no force answers
    to moves.
    """
    return StiffnessEstimate(estimate.stiffness)


def _average(so_far: float | None, gates: Gates, quotient: float, pressed: float) -> float | None:
    if not gates.stiffness_min <= quotient <= gates.stiffness_max:
        return so_far
    if so_far is None:
        return quotient
    # Noise of given size spoils a quotient by 1/|Δf|, so its variance asks for a weight by the square.
    ratio = gates.half_weight / pressed
    weight = 1.0 / (1.0 + ratio * ratio)
    return math.exp((1 - weight) * math.log(so_far) + weight * math.log(quotient))
