"""The controller that looks ahead: where along the travel will the desired force be?

Every pair of reported position x and force f of the same moment says at which position the desired force
would act there: z = x + (f_d − f)/k. Since travel and depth go through the same line, queue and servo, a
command is a point (travel, depth) of a path, whatever the delay; so z is looked at as a function of travel,
a straight line is laid through its last few values, and the command is that line's value at the travel it is
sent with.
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

from msgspec import Struct

from hil_bridge.control.course.checks import (
    FORBID_EXTRA,
    check_reference,
    require_above_zero,
    require_not_negative,
)
from hil_bridge.control.laws.stiffness import Pairing, Stiffness, observe
from hil_bridge.control.types import POSITION_STEP_MM, SAMPLE_MS, Command, Measurement

_PROBE_RANGE = 50.0
"""The stiffest surface over the softest that is believed while probing. Chosen: with the default, 2 kN/m."""
_SWING, _CALM, _GUARD_MOST = 1.5, 0.95, 8.0
"""What a swing multiplies the guard by, what every other sample does, and its largest value. Chosen."""


class Pair(NamedTuple):
    """Force and position of one moment."""

    travel: float
    """m"""
    position: float
    """m"""
    force: float
    """N"""


class PredictiveState(Struct, frozen=True):
    """What the predictive controller remembers."""

    estimate: Stiffness = Stiffness()
    pairs: tuple[Pair, ...] = ()
    """Newest last, all of the present contact."""
    slope: float = 0.0
    """How much deeper the surface lies per travel, as far as known."""
    side: int = 0
    """Sign of the last force error that was clearly no noise."""
    guard: float = 0.0
    """Factor on the stiffness while the error swings from side to side; below 1 it is none."""


class Line(Struct, frozen=True):
    """A straight line through values along the travel."""

    value: float
    """At the travel asked for."""
    slope: float
    slope_error: float
    """Standard error of the slope."""


@dataclass(frozen=True, slots=True)
class Predictive:
    """x(k+1) = ẑ(travel commanded with it), ẑ the weighted line through z_i = x_i + (f_d − f_i)/k_est.

    Derived. The gain 1/k_est falls by itself on harder surfaces. Weights are inverse variances: quantisation
    of the position, force noise, the doubt in k_est times the distance to the desired force, and what a
    curved surface departs from a line. A move inwards takes k_est larger by its standard error; before there
    is an estimate, it takes the stiffest surface, and a move outwards the softest that the approach allows.
    It holds where no reachable position is nearer, |f_e| ≤ k_est · Δx_res/2 + uncertainty, unless the
    surface moves.
    An error that swings from side to side betrays an estimate that is too low, by damping or friction: from
    the second swing on, each raises the stiffness used in its place for a while.
    """

    __pydantic_config__: ClassVar = FORBID_EXTRA
    name: ClassVar[str] = "predictive"
    sample_ms: ClassVar[float] = SAMPLE_MS

    window: int = 6
    """Pairs that the line goes through."""
    stiffest_n_m: float = 100_000.0
    """Stiffness assumed for moves inwards before any was estimated."""
    caution: float = 1.0
    """Standard errors of the estimate by which it is taken larger for a move inwards."""
    steepest: float = 0.3
    """Standard deviation of the slopes expected, m deeper per m of travel: a doubtful slope is taken for
    less.
    """
    smallest_radius_mm: float = 100.0
    """Radius of curvature of the surface down to which pairs far behind still count in full."""
    step_limit_mm: float = 2.0
    """Farthest that the command may move in a sample, either way. Chosen."""
    resolution_mm: float = POSITION_STEP_MM
    """Smallest step of the robot's position."""
    force_uncertainty_n: float = 0.1
    """Standard deviation of the force."""
    pairing: Pairing = field(init=False, repr=False, compare=False)
    """What is known of pairs."""

    def __post_init__(self) -> None:
        require_above_zero(self, "window", "stiffest_n_m", "steepest", "smallest_radius_mm", "step_limit_mm")
        require_not_negative(self, "caution")
        pairing = Pairing(resolution_mm=self.resolution_mm, force_uncertainty_n=self.force_uncertainty_n)
        object.__setattr__(self, "pairing", pairing)

    def initial(self) -> PredictiveState:
        """State before the first sample in contact."""
        return PredictiveState()

    def step(
        self, state: PredictiveState, measurement: Measurement, reference: float
    ) -> tuple[PredictiveState, Command]:
        """One sample. A measurement that is not finite moves nothing and is forgotten.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        if not (measurement.is_finite and math.isfinite(measurement.travel + measurement.travel_next)):
            return state, Command(measurement.commanded, 0.0, state.estimate.value)
        estimate = observe(state.estimate, self.pairing, measurement, state.slope)
        if not measurement.in_contact:
            correction = self._search(estimate, reference)
            state = PredictiveState(estimate, guard=state.guard)
            return state, self._answer(measurement, estimate, correction)
        newest = Pair(measurement.travel, measurement.position, measurement.force_at_position)
        pairs = (*state.pairs, newest)[-self.window :]
        if estimate.value is None:
            correction = self._probe(pairs, measurement, reference)
            state = PredictiveState(estimate, pairs, state.slope, state.side, state.guard)
            return state, self._answer(measurement, estimate, correction)
        return self._follow(state, estimate, pairs, measurement, reference)

    def _follow(
        self,
        state: PredictiveState,
        estimate: Stiffness,
        pairs: tuple[Pair, ...],
        measurement: Measurement,
        reference: float,
    ) -> tuple[PredictiveState, Command]:
        """The answer where there is an estimate, and the state after it."""
        stiffness, doubt = estimate.value or math.nan, estimate.relative_error(self.pairing)
        error = measurement.force - reference
        band = stiffness * self.resolution_mm * 1e-3 / 2 + self.force_uncertainty_n
        side = (error > 2 * band) - (error < -2 * band) or state.side
        swung = side * state.side < 0
        guard = min(state.guard * _SWING, _GUARD_MOST) if swung else max(state.guard * _CALM, 1.0 / _SWING)
        line = self._fit(pairs, stiffness * max(guard, 1.0), doubt, measurement.travel_next, reference)
        moving = abs(line.slope) > 2 * line.slope_error
        held = abs(error) <= band and not moving
        explanation = {
            "relative_error": doubt,
            "guard": max(guard, 1.0),
            "slope": line.slope,
            "predicted_m": line.value,
            "band_n": band,
        }
        correction = 0.0 if held else line.value - measurement.commanded
        command = self._answer(measurement, estimate, correction, doubt, explanation, held)
        slope = line.slope if moving else 0.0
        return PredictiveState(estimate, pairs, slope, side, guard), command

    def _probe(self, pairs: tuple[Pair, ...], measurement: Measurement, reference: float) -> float:
        """Correction while nothing is known of the stiffness, m."""
        error = reference - measurement.force
        if error >= 0:
            return error / self._stiffest(pairs)
        if measurement.free_position is None:
            return error / self.stiffest_n_m
        # Contact began behind the last position without it, so the surface is at least this stiff.
        travelled = max(measurement.position - measurement.free_position, self.resolution_mm * 1e-3)
        return error * travelled / (2 * max(measurement.force_at_position, -error))

    def _stiffest(self, pairs: tuple[Pair, ...]) -> float:
        """Twice what the surface can be at most, going by moves inwards that the force hardly answered,
        N/m.
        """
        newest, least = pairs[-1], self.stiffest_n_m / _PROBE_RANGE
        for pair in pairs[:-1]:
            moved = newest.position - pair.position - self.resolution_mm * 1e-3
            if moved > self.resolution_mm * 1e-3 / 2:
                pressed = max(newest.force - pair.force, 0.0) + 2 * self.force_uncertainty_n
                return min(max(2 * pressed / moved, least), self.stiffest_n_m)
        return self.stiffest_n_m

    def _search(self, estimate: Stiffness, reference: float) -> float:
        """Correction while contact is lost, m."""
        if estimate.value is None:
            return max(reference / self.stiffest_n_m, self.resolution_mm * 1e-3)
        # A third: contact found again shows two cycles late, and must not be pressed threefold by then.
        return reference / (3 * estimate.value)

    def _fit(
        self, pairs: tuple[Pair, ...], stiffness: float, doubt: float, at: float, reference: float
    ) -> Line:
        """Weighted least squares with a slope that is 0 ± `steepest` before any pair is seen."""
        doubt = min(doubt, 1.0)
        wary = stiffness * (1 + self.caution * doubt)
        still = (self.resolution_mm * 1e-3) ** 2 / 12 + (self.force_uncertainty_n / stiffness) ** 2
        bend = 0.5 / (self.smallest_radius_mm * 1e-3)
        s0 = s1 = s2 = t0 = t1 = 0.0
        base = pairs[-1].position
        for travel, position, force in pairs:
            short, away = reference - force, travel - at
            wanted = position - base + short / (wary if short > 0 else stiffness)
            variance = still + (doubt * short / stiffness) ** 2 + (bend * away * away) ** 2
            weight = 1.0 / variance
            s0 += weight
            s1 += weight * away
            s2 += weight * away * away
            t0 += weight * wanted
            t1 += weight * away * wanted
        s2 += 1.0 / self.steepest**2
        determinant = s0 * s2 - s1 * s1
        slope = (s0 * t1 - s1 * t0) / determinant
        return Line(base + (s2 * t0 - s1 * t1) / determinant, slope, math.sqrt(s0 / determinant))

    def _answer(
        self,
        measurement: Measurement,
        estimate: Stiffness,
        correction: float,
        doubt: float | None = None,
        explanation: dict[str, float] | None = None,
        held: bool = False,
    ) -> Command:
        """The command with this correction; its gain is 0 without an estimate and nears 1 the surer that is."""
        limit = self.step_limit_mm * 1e-3
        correction = min(max(correction, -limit), limit)
        position = measurement.commanded + correction
        confidence = 1.0 / (1.0 + (estimate.relative_error(self.pairing) if doubt is None else doubt))
        return Command(position, correction, estimate.value, confidence, held, explanation or {})
