"""Predictive controller, which extrapolates along the travel to the position at which the desired force will act.

Each pair of position x and force f at the same time gives a target position z = x + (f_d − f)/k, at which the
desired force f_d would act for this travel. Travel and depth pass through the same link, queue and servo, so a
command is a point (travel, depth) of a path, regardless of the delay. The controller therefore treats z as a
function of travel and fits a straight line to its last few values. The command is the value of that line at the
travel that is sent with it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.checks import (
    FORBID_EXTRA,
    check_reference,
    require_above_zero,
    require_not_negative,
)
from hil_bridge.control.laws.servo import Served, Servo
from hil_bridge.control.laws.stiffness import Pairing, Stiffness, observe
from hil_bridge.control.limiting import within
from hil_bridge.control.types import (
    FINE_STEP_MM,
    POSITION_STEP_MM,
    SAMPLE_MS,
    STREAM_SAMPLES_MS,
    Command,
    Measurement,
    Range,
    Tuning,
)

_PROBE_RANGE = 50.0
"""Ratio of the stiffest to the softest surface that is assumed while probing. Chosen: with the default, the softest
surface has 2 kN/m.
"""
_REVERSAL_FACTOR, _CALM_FACTOR, _ROBUSTNESS_MOST = 1.5, 0.95, 8.0
"""Factors on the robustness factor, and its largest value. A reversal of the error multiplies the robustness factor
by the first; every other sample multiplies it by the second. Chosen.
"""
_ROBUSTNESS_LEAST = 1.0 / _REVERSAL_FACTOR
"""Smallest value of the robustness factor. The next reversal raises it to 1."""

_LANDING_MS = 100.0
"""`landing_ms` of streaming robots. Chosen: twice the time that an order takes with EGM."""
_STEPS_MM = {2.0: 0.1, 4.0: FINE_STEP_MM, 12.0: FINE_STEP_MM}
"""`resolution_mm`, in mm, by sample time, in ms. Chosen: at 2 ms, the sample time of a Universal Robots arm, about the
difference of that arm from its targets. With less, the controller answers that difference, and excites the first mode
of the arm at 20 kN/m.
"""
_WINDOWS_MS = {2.0: 0.0, 4.0: 80.0, 12.0: 80.0}
"""`window_ms`, in ms, by sample time, in ms. Chosen: the line then covers more than a period of the first mode of an
arm, 50 to 70 ms, and does not follow its oscillation. At 2 ms, the sample time of a Universal Robots arm, a longer line
does not follow the arm's differences from its targets.
"""
_SHORTEST_S = 1e-3
"""Shortest time between two pairs that counts, s. Chosen: below the cycle of every robot."""
_SPAN_MS = 100.0
"""`Pairing.span_ms` for a controller with a model of the servo, which has no dead band. Chosen: after this time,
the following error of a Universal Robots arm has changed; see `follow_error_ms` of the emulated arm.
"""
_LEAD_S = 0.02
"""Time for which an order leads the robot at most, at `servo_speed_mm_s`, s. Chosen: the guard gives the robot 80 ms to
carry out an order, of which the link and the servo take about 50 ms.
"""
_NEAR_SHARE = 0.03
"""Force error below which the first touch is over, as a share of the desired force. Chosen."""
_LANDINGS = 3.0
"""Time limit of the first touch, as a multiple of `landing_ms`. Chosen. Without it, the controller would follow a
receding surface too late.
"""


Pair: TypeAlias = tuple[float, float, float]
"""Travel, m, position, m, and force, N, at the same time."""


class PredictiveState(Struct, frozen=True):
    """State of the predictive controller between samples."""

    estimate: Stiffness = Stiffness()
    pairs: tuple[Pair, ...] = ()
    """Pairs of the current contact, oldest first."""
    slope: float = 0.0
    """Depth that the surface gains per metre of travel, as far as known."""
    side: int = 0
    """Sign of the last force error that was clearly above the noise."""
    robustness: float = 0.0
    """Factor on the stiffness while the error oscillates. A value below 1 has no effect."""
    landing: float = 0.0
    """Time in contact until the force is near the desired force, s; infinite once it is. The time does not restart
    when lost contact is regained, because the stiffness is known.
    """
    served: Served | None = None
    """State of the servo model; None without contact."""


@dataclass(frozen=True, slots=True)
class Predictive:
    """x(k+1) = ẑ(travel commanded with it), ẑ the weighted line through z_i = x_i + (f_d − f_i)/k_est.

    Derived. The gain 1/k_est falls by itself on harder surfaces. The weights are inverse variances with four parts:
    quantisation of the position, force noise, standard error of k_est, and deviation of a curved surface from a line.
    The standard error is scaled by the distance to the desired force. For a move inwards, k_est is increased by its
    standard error. Before there is an estimate, a move inwards assumes the stiffest surface, and a move outwards the
    softest one that the approach allows.

    Deadband rest: unless the surface moves, the command stays where it is while no position that the robot can take is
    nearer. That is the case for |f_e| ≤ k_est · Δx_res/2 + uncertainty.

    Robustness factor: an error that oscillates shows that k_est is too low, because of damping or friction. From the
    second reversal on, each reversal raises the stiffness used in place of k_est for a while.
    """

    __pydantic_config__: ClassVar = FORBID_EXTRA
    name: ClassVar[str] = "predictive"
    sample_ms: ClassVar[float] = SAMPLE_MS
    tunings: ClassVar[tuple[Tuning, ...]] = tuple(
        Tuning(
            sample_ms,
            {
                "resolution_mm": _STEPS_MM[sample_ms],
                "landing_ms": _LANDING_MS,
                "window_ms": _WINDOWS_MS[sample_ms],
            },
        )
        for sample_ms in STREAM_SAMPLES_MS
    )

    ranges: ClassVar[Mapping[str, Range]] = {
        "window": Range(3, 20),
        "window_ms": Range(0.0, 300.0),
        "caution": Range(0.0, 4.0),
        "steepest": Range(0.02, 2.0, by_factor=True),
        "smallest_radius_mm": Range(10.0, 1000.0, by_factor=True),
        "landing_ms": Range(0.0, 300.0),
    }
    """Ranges of the parameters for `hil-bridge tune`. Chosen: about a tenth to ten times the defaults, as far as a
    line through pairs makes sense.
    """

    window: int = 6
    """Smallest number of pairs that the line is fitted to."""
    window_ms: float = 0.0
    """Time over which the line is fitted to all pairs, ms."""
    stiffest_n_m: float = 100_000.0
    """Stiffness assumed for moves inwards while there is no estimate, N/m."""
    caution: float = 1.0
    """Number of standard errors added to the estimate for a move inwards."""
    steepest: float = 0.3
    """Standard deviation of the expected slopes, m deeper per m of travel; an uncertain slope is reduced accordingly.
    """
    smallest_radius_mm: float = 100.0
    """Radius of curvature of the surface, mm, down to which old pairs keep their full weight."""
    step_limit_mm: float = 2.0
    """Largest move of the command per sample in either direction, mm. Chosen."""
    resolution_mm: float = POSITION_STEP_MM
    """Resolution of the robot's position, mm."""
    force_uncertainty_n: float = 0.1
    """Standard deviation of the force, N."""
    landing_ms: float = 0.0
    """Time in which a move inwards covers 63 % of its distance at a first touch, ms. It applies until the force has
    been near the desired force, or three times this time has passed. With 0 or a longer sample time, each move is made
    at once.
    """
    servo_lag_ms: float = 0.0
    """Time by which the robot lags behind its orders, ms, for a servo model whose position replaces the reported one; 0
    uses the reported position. It is set for robots that report a noisy position.
    """
    servo_damping: float = 1.0
    """Damping ratio of the servo model."""
    servo_speed_mm_s: float = 0.0
    """Largest speed of the set points that the link sends, mm/s: an order leads the robot by no more than it covers in
    20 ms or a sample. 0 for no limit.
    """
    servo_acceleration_mm_s2: float = 0.0
    """Largest acceleration of the set points that the servo model receives, mm/s²; 0 for no limit."""
    servo_error_mm: float = 0.15
    """Largest difference between the model's position and the reported one, mm. Chosen: the largest following error of
    a Universal Robots arm here.
    """
    pairing: Pairing = field(init=False, repr=False, compare=False)
    """Settings for the pairing of force and position."""
    constants: tuple[float, float, float] = field(init=False, repr=False, compare=False)
    """Constants of the fitted line: variance of a rounded position, m², half the curvature, 1/m, and weight of the
    slope 0.
    """
    servo: Servo | None = field(init=False, repr=False, compare=False)
    """Model of the robot's servo; None if the reported position is used."""

    def __post_init__(self) -> None:
        require_above_zero(self, "window", "stiffest_n_m", "steepest", "smallest_radius_mm", "step_limit_mm")
        require_above_zero(self, "servo_damping", "servo_error_mm")
        require_not_negative(self, "servo_speed_mm_s", "servo_acceleration_mm_s2")
        require_not_negative(self, "caution", "window_ms", "landing_ms", "servo_lag_ms")
        modelled = self.servo_lag_ms > 0.0
        pairing = Pairing(
            resolution_mm=self.resolution_mm,
            force_uncertainty_n=self.force_uncertainty_n,
            span_ms=_SPAN_MS if modelled else 0.0,
        )
        servo = Servo(
            self.servo_lag_ms * 1e-3,
            self.servo_damping,
            self.servo_error_mm * 1e-3,
            self.servo_speed_mm_s * 1e-3 or math.inf,
            self.servo_acceleration_mm_s2 * 1e-3 or math.inf,
        )
        object.__setattr__(self, "pairing", pairing)
        rounded, bend = (self.resolution_mm * 1e-3) ** 2 / 12, 0.5 / (self.smallest_radius_mm * 1e-3)
        object.__setattr__(self, "constants", (rounded, bend, 1.0 / self.steepest**2))
        object.__setattr__(self, "servo", servo if modelled else None)

    def initial(self) -> PredictiveState:
        """Return the state before the first sample in contact."""
        return PredictiveState()

    def step(
        self, state: PredictiveState, measurement: Measurement, reference: float
    ) -> tuple[PredictiveState, Command]:
        """Return the command for one sample. A measurement that is not finite causes no motion and is ignored.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        acting, position, travel = measurement.force_at_position, measurement.position, measurement.travel
        known = measurement.force + acting + position + measurement.commanded + travel
        if not math.isfinite(known + measurement.travel_next):
            return state, Command(measurement.commanded, 0.0, state.estimate.value)
        served = None
        if self.servo is not None and measurement.in_contact:
            if state.served is None:
                served = self.servo.begin(measurement, coming=state.estimate.value is None)
            else:
                served = self.servo.after(state.served, measurement)
            measurement = replace(measurement, position=served.position)
        estimate = observe(state.estimate, self.pairing, measurement, state.slope)
        stiffness = estimate.value
        if not measurement.in_contact:
            correction = self._search(stiffness, reference)
            state = PredictiveState(estimate, robustness=state.robustness, landing=state.landing)
            return state, self._answer(measurement, estimate, correction)
        newest = travel, measurement.position, acting
        kept = self.window
        if self.window_ms > 0.0:
            kept = max(kept, round(self.window_ms * 1e-3 / max(measurement.dt, _SHORTEST_S)))
        pairs = (state.pairs + (newest,))[-kept:]  # noqa: RUF005 – half the time of unpacking
        near = measurement.force - reference > -_NEAR_SHARE * reference
        landing = math.inf if near else state.landing + measurement.dt
        state = PredictiveState(
            estimate=estimate,
            pairs=pairs,
            slope=state.slope,
            side=state.side,
            robustness=state.robustness,
            landing=landing,
            served=served,
        )
        if stiffness is None:
            correction = self._land(state, self._probe(pairs, measurement, reference), measurement.dt)
            return state, self._answer(measurement, estimate, correction)
        return self._follow(state, stiffness, measurement, reference)

    def _follow(
        self, state: PredictiveState, stiffness: float, measurement: Measurement, reference: float
    ) -> tuple[PredictiveState, Command]:
        """Return the command for a known stiffness, and the state after it. `state` already contains this sample's
        pair.
        """
        estimate, pairs = state.estimate, state.pairs
        error, relative_error = measurement.force - reference, estimate.relative_error(self.pairing)
        band = stiffness * self.resolution_mm * 1e-3 / 2 + self.force_uncertainty_n
        side = 1 if error > 2.0 * band else -1 if error < -2.0 * band else state.side
        swung = side * state.side < 0
        robustness = state.robustness * (_REVERSAL_FACTOR if swung else _CALM_FACTOR)
        robustness = within(robustness, _ROBUSTNESS_LEAST, _ROBUSTNESS_MOST)
        guard = 1.0 if robustness < 1.0 else robustness
        predicted, slope, slope_error = self._fit(
            pairs, stiffness * guard, relative_error, measurement.travel_next, reference
        )
        moving = abs(slope) > 2.0 * slope_error
        resting = abs(error) <= band and not moving
        explanation = {
            "relative_error": relative_error,
            "guard": guard,
            "slope": slope,
            "predicted_m": predicted,
            "band_n": band,
        }
        correction = 0.0 if resting else predicted - measurement.commanded
        correction = self._limit(self._land(state, correction, measurement.dt), measurement)
        position, gain = measurement.commanded + correction, 1.0 / (1.0 + relative_error)
        command = Command(
            position=position,
            correction=correction,
            stiffness=stiffness,
            gain=gain,
            held=resting,
            explanation=explanation,
        )
        learnt = slope if moving else 0.0
        return PredictiveState(
            estimate=estimate,
            pairs=pairs,
            slope=learnt,
            side=side,
            robustness=robustness,
            landing=state.landing,
            served=state.served,
        ), command

    def _probe(self, pairs: tuple[Pair, ...], measurement: Measurement, reference: float) -> float:
        """Return the correction while the stiffness is unknown, m."""
        error = reference - measurement.force
        if error >= 0:
            return error / self._stiffness_bound(pairs)
        if measurement.free_position is None:
            return error / self.stiffest_n_m
        # Contact began beyond the last free position, so the surface is at least this stiff.
        travelled = max(measurement.position - measurement.free_position, self.resolution_mm * 1e-3)
        return error * travelled / (2 * max(measurement.force_at_position, -error))

    def _land(self, state: PredictiveState, correction: float, dt: float) -> float:
        """Return the correction that one sample makes at a first touch, m. `dt` is the duration of the sample, s."""
        landing = self.landing_ms * 1e-3
        if correction <= 0.0 or dt >= landing or state.landing > _LANDINGS * landing:
            return correction
        return correction * dt / landing

    def _stiffness_bound(self, pairs: tuple[Pair, ...]) -> float:
        """Return twice the upper bound of the stiffness, N/m, derived from moves inwards that hardly changed the
        force.
        """
        (_, newest, pressing), least = pairs[-1], self.stiffest_n_m / _PROBE_RANGE
        for _, position, force in pairs[:-1]:
            displacement = newest - position - self.resolution_mm * 1e-3
            if displacement > self.resolution_mm * 1e-3 / 2:
                pressed = max(pressing - force, 0.0) + 2 * self.force_uncertainty_n
                return within(2 * pressed / displacement, least, self.stiffest_n_m)
        return self.stiffest_n_m

    def _search(self, stiffness: float | None, reference: float) -> float:
        """Return the correction while contact is lost, m."""
        if stiffness is None:
            return max(reference / self.stiffest_n_m, self.resolution_mm * 1e-3)
        # A third, because regained contact is reported two cycles late, and the force must not have tripled by then.
        return reference / (3 * stiffness)

    def _fit(
        self, pairs: tuple[Pair, ...], stiffness: float, relative_error: float, at: float, reference: float
    ) -> tuple[float, float, float]:
        """Return the value of a line fitted through the target positions at the given travel, its slope, and the
        standard error of the value.

        The fit is a weighted least squares fit, with an assumed slope of 0 ± `steepest` before the first pair.
        """
        relative_error = relative_error if relative_error < 1.0 else 1.0
        inwards, doubt = stiffness * (1.0 + self.caution * relative_error), relative_error / stiffness
        (rounded, bend, s2), noise = self.constants, self.force_uncertainty_n / stiffness
        still = rounded + noise * noise
        s0 = s1 = t0 = t1 = 0.0
        base = pairs[-1][1]
        for travel, position, force in pairs:
            short, away = reference - force, travel - at
            target = position - base + short / (inwards if short > 0.0 else stiffness)
            unsure, bent = doubt * short, bend * away * away
            weight = 1.0 / (still + unsure * unsure + bent * bent)
            far = weight * away
            s0 += weight
            s1 += far
            s2 += far * away
            t0 += weight * target
            t1 += far * target
        determinant = s0 * s2 - s1 * s1
        slope = (s0 * t1 - s1 * t0) / determinant
        return base + (s2 * t0 - s1 * t1) / determinant, slope, math.sqrt(s0 / determinant)

    def _answer(self, measurement: Measurement, estimate: Stiffness, correction: float) -> Command:
        """Return the command with the given correction for a sample in which no line is followed. Its gain is 0
        without an estimate.
        """
        correction = self._limit(correction, measurement)
        gain = 1.0 / (1.0 + estimate.relative_error(self.pairing))
        return Command(measurement.commanded + correction, correction, estimate.value, gain)

    def _limit(self, correction: float, measurement: Measurement) -> float:
        """Return the correction limited to the largest correction of one sample, m, and to what the link can send in
        time. With a model of the servo, a set point covers it in the duration of the sample.
        """
        limit, speed, dt = self.step_limit_mm * 1e-3, self.servo_speed_mm_s * 1e-3, measurement.dt
        if self.servo is not None:
            limit = min(limit, self.servo.setpoint_m_s * dt)
        elif speed > 0.0:
            lead, ahead = speed * max(dt, _LEAD_S), measurement.commanded - measurement.position
            correction = within(correction, min(-lead - ahead, 0.0), max(lead - ahead, 0.0))
        return within(correction, -limit, limit)
