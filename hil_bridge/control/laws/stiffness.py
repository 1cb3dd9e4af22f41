"""Contact stiffness by recursive least squares with forgetting, over force–position pairs aligned in time.

Model: while pressing, f = k · (x − s), where the surface s becomes s' deeper per metre of travel. Between two
pairs, Δf = k · φ with φ = Δx − s' · Δtravel. So k = Σ w φ Δf / Σ w φ², with the weights w = λⁿ/r, which decrease
with every later pair. r is the variance of Δf − k φ: the force noise of two samples, plus k² times the quantisation
of two reported positions. On all but the softest surfaces the second part is larger.

Because φ itself contains this quantisation, each φ² is reduced by its variance. Without this correction, the
estimate from small moves would be too low, and the gain therefore too high. Source: textbook recursive least
squares in information form, bias-compensated; the paper has only eq. (4).
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.checks import require_above_zero, require_not_negative
from hil_bridge.control.limiting import within
from hil_bridge.control.types import POSITION_STEP_MM, Measurement
from protocol.marks import SettingError

_SLOPE_GAIN = 0.3
"""Weight of a newly measured slope. Chosen: a position error of one step then affects the slope by only a third of
its size.
"""
_LEAST_TRAVEL = 0.2e-3
"""Smallest travel between two samples from which a slope is measured, m. Chosen: more than a resolution step."""
_FIRST_SPAN_S = 0.8
"""Time over which moves are accumulated while there is no estimate, s. Chosen: five samples of 172 … 187 ms reach
this time and four do not.
"""


@dataclass(frozen=True, slots=True)
class Pairing:
    """Uncertainty of the pairs, and the conditions under which a pair is used."""

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    resolution_mm: float = POSITION_STEP_MM
    """Resolution of the reported position, mm."""
    force_uncertainty_n: float = 0.1
    """Standard deviation of the force, N."""
    forgetting: float = 0.8
    """λ: factor on the weight of older pairs for each new pair. Chosen: half after three pairs."""
    smallest_move: float = 1.5
    """Smallest move that makes a pair count, in resolution steps. Once there is an estimate, the move is the mean of
    |φ| and |Δf|/k; otherwise, pairs with a |φ| that is large only by quantisation would be preferred. Chosen: at a
    reversal, the robot moves one step less than it reports.
    """
    span_ms: float = 0.0
    """Time over which small moves add up once there is an estimate, ms; 0 compares only neighbouring samples."""
    stiffness_min: float = 1e2
    """Smallest plausible stiffness, N/m."""
    stiffness_max: float = 1e6
    """Largest plausible stiffness, N/m: sensor, tool and robot together are no stiffer."""
    step_variance: float = field(init=False, repr=False, compare=False)
    """Variance of the difference between two reported positions, each rounded to a step, m²."""

    def __post_init__(self) -> None:
        require_above_zero(
            self,
            "resolution_mm",
            "force_uncertainty_n",
            "forgetting",
            "smallest_move",
            "stiffness_min",
            "stiffness_max",
        )
        require_not_negative(self, "span_ms")
        if self.forgetting > 1:
            raise SettingError("forgetting", f"must be at most 1, got {self.forgetting}")
        if self.stiffness_min >= self.stiffness_max:
            raise SettingError("stiffness_min", "must be below stiffness_max")
        object.__setattr__(self, "step_variance", (self.resolution_mm * 1e-3) ** 2 / 6)


class Stiffness(Struct, frozen=True):
    """Sums of the least squares fit, and the older sample of the next difference."""

    moved: float = 0.0
    """Σ w φ² less its bias, with relative weights w, m²."""
    pressed: float = 0.0
    """Σ w φ Δf, N·m."""
    force: float | None = None
    """Force of the older pair, N; None if the next sample starts a new pair."""
    position: float = 0.0
    """Position of the older pair, m."""
    travel: float = 0.0
    """Travel of the older pair, m."""
    age: float = 0.0
    """Time since the older pair, s."""
    slope: float = 0.0
    """Depth that the surface gains per metre of travel, according to x − f/k."""

    @property
    def value(self) -> float | None:
        """Estimated stiffness, N/m; None before the first valid pair."""
        return self.pressed / self.moved if self.moved > 0.0 else None

    def relative_error(self, pairing: Pairing) -> float:
        """Return the relative standard error of the estimate; infinite if there is no estimate."""
        if not self.moved > 0.0:
            return math.inf
        noise = pairing.force_uncertainty_n * self.moved / self.pressed
        return math.sqrt((2.0 * noise * noise + pairing.step_variance) / self.moved)


def observe(
    estimate: Stiffness, pairing: Pairing, measurement: Measurement, slope: float | None = None
) -> Stiffness:
    """Return the estimate after one sample. `slope` is the depth that the surface gains per metre of travel, if the
    caller has a better value.

    Without contact, the estimate is kept and the next sample starts a new pair. A sample that is saturated or not
    finite is ignored. A move that is too small is not used. Its older sample is replaced once it is older than
    `span_ms`, because sums of small moves contain the robot's dead band.
    """
    if not measurement.in_contact:
        return replace(estimate, force=None)
    force, position, travel = measurement.force_at_position, measurement.position, measurement.travel
    slope = estimate.slope if slope is None else slope
    if measurement.saturated or not math.isfinite(force + position + travel + slope):
        return estimate
    if estimate.force is None:
        return replace(estimate, force=force, position=position, travel=travel, age=0.0)
    travelled = travel - estimate.travel
    displacement = position - estimate.position - slope * travelled
    pressed = force - estimate.force
    known = estimate.value
    learnt = estimate.slope
    if known is not None and abs(travelled) > _LEAST_TRAVEL:
        measured_slope = (position - estimate.position - pressed / known) / travelled
        learnt = slope + _SLOPE_GAIN * (within(measured_slope, -1.0, 1.0) - slope)
    newer = Stiffness(
        moved=estimate.moved,
        pressed=estimate.pressed,
        force=force,
        position=position,
        travel=travel,
        age=0.0,
        slope=learnt,
    )
    size = abs(displacement) if known is None else (abs(displacement) + abs(pressed) / known) / 2.0
    if size < pairing.smallest_move * pairing.resolution_mm * 1e-3 * (1 - 1e-6):
        # Until there is an estimate, small moves of a slow approach add up for a limited time. Otherwise, a
        # surface that moves sideways under the tool would distort the quotient without limit.
        age = estimate.age + measurement.dt
        span = _FIRST_SPAN_S if known is None else pairing.span_ms * 1e-3
        return replace(estimate, age=age) if age < span else newer
    possible = displacement and pairing.stiffness_min <= pressed / displacement <= pairing.stiffness_max
    if not possible or abs(pressed) < 2 * pairing.force_uncertainty_n:
        return newer
    kept = pairing.forgetting
    return replace(
        newer,
        moved=kept * estimate.moved + displacement**2 - min(pairing.step_variance, displacement**2 / 2),
        pressed=kept * estimate.pressed + displacement * pressed,
    )
