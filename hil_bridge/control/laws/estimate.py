"""Contact stiffness from pairs of reported position and measured force.

Source: eq. (4) of the paper, k = [f(k) − f(k−1)] / [x(k) − x(k−1)], with gates that trials showed to be necessary.
A pair counts only if the position changed by at least half a resolution step and the force by at least twice its
uncertainty. The quotient must also be a possible stiffness. The weight of a quotient grows with the change of
force.

Choice of the two samples: until there is an estimate, a pair that fails the gates keeps its older sample, so that
the small moves of a slow approach to a soft surface add up. The older sample is discarded after a few pairs.
Otherwise, a surface that moves sideways under the tool would distort the quotient without limit. Once there is an
estimate, only consecutive samples are compared. Accumulated small moves contain the robot's dead band: half a step
that was reported but not moved. On a hard surface this halves the estimate, which is enough for a limit cycle.
"""

import math

from msgspec import Struct


class Gates(Struct, frozen=True):
    """Conditions that a pair of samples must meet to be used."""

    position_change: float
    """Minimum |Δx|, m."""
    force_change: float
    """Minimum |Δf|, N."""
    stiffness_min: float = 1e2
    """Smallest possible stiffness, N/m. Derived: in trials, smaller quotients were only noise."""
    stiffness_max: float = 1e7
    """Largest possible stiffness, N/m. Derived: in trials, larger quotients were only noise."""
    half_weight: float = 5.0
    """|Δf| at which a new quotient and the current estimate have equal weight, N. Chosen."""
    first_span: int = 5
    """Number of samples over which moves are accumulated while there is no estimate. Chosen."""


class StiffnessEstimate(Struct, frozen=True):
    """Current estimate and the older sample of the next pair."""

    stiffness: float | None = None
    """Stiffness, N/m; None before the first valid pair."""
    position: float | None = None
    """Reported position of the older sample, m; None if the next sample starts a new pair."""
    force: float = 0.0
    """Force of the older sample, N."""
    age: int = 0
    """Number of samples since the older sample."""


def update(estimate: StiffnessEstimate, gates: Gates, position: float, force: float) -> StiffnessEstimate:
    """Return the estimate after one sample in contact: reported position in m, and force in N, positive into the
    surface.

    A sample that is not finite changes nothing. The estimate is a mean of logarithms, because stiffness spans
    decades.
    """
    if not math.isfinite(position + force):
        return estimate
    if estimate.position is None:
        return StiffnessEstimate(estimate.stiffness, position, force)
    displacement, pressed = position - estimate.position, force - estimate.force
    # Positions are multiples of the resolution step with rounding errors far below this margin.
    if abs(displacement) >= gates.position_change * (1 - 1e-6) and abs(pressed) >= gates.force_change:
        return StiffnessEstimate(
            _average(estimate.stiffness, gates, pressed / displacement, pressed), position, force
        )
    if estimate.stiffness is None and estimate.age + 1 < gates.first_span:
        return StiffnessEstimate(None, estimate.position, estimate.force, estimate.age + 1)
    return StiffnessEstimate(estimate.stiffness, position, force)


def contact_lost(estimate: StiffnessEstimate) -> StiffnessEstimate:
    """Return the estimate after a loss of contact. The stiffness is kept. The next sample in contact starts a new
    pair, because the force in free space does not depend on the position.
    """
    return StiffnessEstimate(estimate.stiffness)


def _average(so_far: float | None, gates: Gates, quotient: float, pressed: float) -> float | None:
    if not gates.stiffness_min <= quotient <= gates.stiffness_max:
        return so_far
    if so_far is None:
        return quotient
    # Noise of a given size affects a quotient by 1/|Δf|, so the weight is proportional to the square of Δf.
    ratio = gates.half_weight / pressed
    weight = 1.0 / (1.0 + ratio * ratio)
    return math.exp((1 - weight) * math.log(so_far) + weight * math.log(quotient))
