"""Contact stiffness by recursive least squares with forgetting, over force–position pairs aligned in time.

Model: while pressing, f = k · (x − s), where the surface s lies s' deeper per metre of travel. Between two pairs Δf = k
· φ with φ = Δx − s' · Δtravel, so k = Σ w φ Δf / Σ w φ², the weights w = λⁿ/r fading with every pair that came after. r
is the variance of Δf − k φ: the force noise of two samples and k² times the quantisation of two reported positions. On
all but the softest surfaces the second part is the larger one. Since φ itself carries that quantisation, each φ² is
lessened by its variance. Without this the estimate of small moves is too low, and a stiffness that is too low is a gain
that is too high. Source: textbook recursive least squares in information form, bias-compensated; the paper has eq. (4)
alone.
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
"""Share of a newly seen slope that is believed. Chosen: a position off by one step is a third of it."""
_LEAST_TRAVEL = 0.2e-3
"""Travel below which two samples say nothing of the slope, m. Chosen: more than a resolution step."""
_FIRST_SPAN_S = 0.8
"""Time over which moves add up while there is no estimate, s. Chosen: five samples of 172 … 187 ms reach it and four do
not.
"""


@dataclass(frozen=True, slots=True)
class Pairing:
    """Settings for pairs: their uncertainty, and the conditions under which they count."""

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    resolution_mm: float = POSITION_STEP_MM
    """Smallest step of the reported position."""
    force_uncertainty_n: float = 0.1
    """Standard deviation of the force."""
    forgetting: float = 0.8
    """λ: what older pairs still count when a pair has been added. Chosen: half of them after three."""
    smallest_move: float = 1.5
    """Move from which a pair counts, in resolution steps. Once there is an estimate, it is the mean of |φ| and of
    |Δf|/k; otherwise pairs would be chosen in which |φ| is large by quantisation alone. Chosen: a reversal moves the
    robot by one step less than it reports.
    """
    span_ms: float = 0.0
    """Time over which small moves add up once there is an estimate; 0 compares neighbouring samples alone."""
    stiffness_min: float = 1e2
    """Smallest stiffness that is believed, N/m."""
    stiffness_max: float = 1e6
    """Largest stiffness that is believed, N/m: sensor, tool and robot are no stiffer together."""
    step_variance: float = field(init=False, repr=False, compare=False)
    """Variance of the difference of two reported positions, m²: two roundings to whole steps."""

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
    """Sums of the least squares and the older half of the next difference."""

    moved: float = 0.0
    """Σ w φ² less its bias, with w relative: in m²."""
    pressed: float = 0.0
    """Σ w φ Δf, N·m."""
    force: float | None = None
    """Force of the older pair, N; None when the next pair begins again."""
    position: float = 0.0
    """Position of the older pair, m."""
    travel: float = 0.0
    """Travel of the older pair, m."""
    age: float = 0.0
    """Time since the older pair, s."""
    slope: float = 0.0
    """Depth that the surface gains per travel, going by x − f/k."""

    @property
    def value(self) -> float | None:
        """Estimate in N/m; None before the first pair that counted."""
        return self.pressed / self.moved if self.moved > 0.0 else None

    def relative_error(self, pairing: Pairing) -> float:
        """Return the standard error of the estimate, relative to it; infinite without one."""
        if not self.moved > 0.0:
            return math.inf
        noise = pairing.force_uncertainty_n * self.moved / self.pressed
        return math.sqrt((2.0 * noise * noise + pairing.step_variance) / self.moved)


def observe(
    estimate: Stiffness, pairing: Pairing, measurement: Measurement, slope: float | None = None
) -> Stiffness:
    """Take one sample. `slope` is how much deeper the surface lies per travel, where the caller knows it better.

    Without contact the estimate stays and pairs begin again. A sample that is saturated or not finite is passed over.
    So is a move that is too small: its older half is replaced once it is older than `span_ms`, for sums of small moves
    carry the robot's dead band.
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
    moved = position - estimate.position - slope * travelled
    pressed = force - estimate.force
    known = estimate.value
    learnt = estimate.slope
    if known is not None and abs(travelled) > _LEAST_TRAVEL:
        seen = (position - estimate.position - pressed / known) / travelled
        learnt = slope + _SLOPE_GAIN * (within(seen, -1.0, 1.0) - slope)
    newer = Stiffness(
        moved=estimate.moved,
        pressed=estimate.pressed,
        force=force,
        position=position,
        travel=travel,
        age=0.0,
        slope=learnt,
    )
    size = abs(moved) if known is None else (abs(moved) + abs(pressed) / known) / 2.0
    if size < pairing.smallest_move * pairing.resolution_mm * 1e-3 * (1 - 1e-6):
        # Until there is an estimate, small moves of a careful beginning add up, though not for ever. A
        # surface that moves sideways under the tool would enter the quotient without bound.
        age = estimate.age + measurement.dt
        span = _FIRST_SPAN_S if known is None else pairing.span_ms * 1e-3
        return replace(estimate, age=age) if age < span else newer
    possible = moved and pairing.stiffness_min <= pressed / moved <= pairing.stiffness_max
    if not possible or abs(pressed) < 2 * pairing.force_uncertainty_n:
        return newer
    kept = pairing.forgetting
    return replace(
        newer,
        moved=kept * estimate.moved + moved**2 - min(pairing.step_variance, moved**2 / 2),
        pressed=kept * estimate.pressed + moved * pressed,
    )
