"""The controllers of textbooks, to compare with: incremental PI and admittance.

Both push the command in proportion to the missing force, so both have a loop gain that is proportional to the stiffness
of the surface. Tuned for one surface, they creep on softer ones and oscillate on harder ones. Scheduling scales them by
the estimated stiffness.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from msgspec import Struct

from hil_bridge.control.checks import (
    FORBID_EXTRA,
    check_reference,
    require_above_zero,
    require_not_negative,
)
from hil_bridge.control.exponential import exponential
from hil_bridge.control.laws.stiffness import Pairing, Stiffness, observe
from hil_bridge.control.limiting import within
from hil_bridge.control.types import (
    POSITION_STEP_MM,
    SAMPLE_MS,
    STREAM_SAMPLES_MS,
    Command,
    Measurement,
    Range,
    Tuning,
)

_STREAM_INTEGRAL_PER_S = 10.0
"""Share of the error that the PI makes up for in a second, on a robot that streams. Chosen: with half of it the error
on a contour is twice as large, with twice as much the force overshoots.
"""
_STREAM_STEP_MM = 0.05
"""Step of the position that the estimate counts with on such a robot. Chosen: on a soft surface the smallest move that
counts then changes the force by more than its noise.
"""


class PiState(Struct, frozen=True):
    """State of the PI between samples."""

    error: float | None = None
    """f_d − f of the sample before, N; None before the first one, whose change counts as 0."""
    estimate: Stiffness = Stiffness()


@dataclass(frozen=True, slots=True)
class Pi:
    """x(k+1) = x_commanded(k) + [K_p · (e(k) − e(k−1)) + K_i · e(k)] / k_t, e = f_d − f. Source: textbook PI
    in velocity form, gains relative to the stiffness k_t that they were tuned at.

    With `gain_scheduling` the estimated stiffness takes the place of k_t; before there is one, the stiffest.
    """

    __pydantic_config__: ClassVar = FORBID_EXTRA
    name: ClassVar[str] = "pi"
    sample_ms: ClassVar[float] = SAMPLE_MS
    tunings: ClassVar[tuple[Tuning, ...]] = tuple(
        Tuning(
            sample_ms,
            {
                "proportional": 0.0,
                "integral": _STREAM_INTEGRAL_PER_S * sample_ms * 1e-3,
                "resolution_mm": _STREAM_STEP_MM,
                "gain_scheduling": True,
            },
        )
        for sample_ms in STREAM_SAMPLES_MS
    )

    ranges: ClassVar[Mapping[str, Range]] = {
        "proportional": Range(0.0, 1.0),
        "integral": Range(0.005, 1.5, by_factor=True),
    }
    """Chosen: from hardly any answer to one that swings at the stiffness tuned at."""

    proportional: float = 0.2
    """K_p: share of a change of the error that is answered in a sample."""
    integral: float = 0.4
    """K_i: share of the error that is made up for in a sample. Chosen with the other for little overshoot at
    the delay of the computer link, nearly two samples.
    """
    tuned_at_n_m: float = 5000.0
    """k_t: stiffness that the gains were tuned at; the paper's sponge."""
    gain_scheduling: bool = False
    """Whether the gains follow the estimated stiffness."""
    stiffest_n_m: float = 100_000.0
    """With scheduling, stiffness assumed before there is an estimate: the hardest surface that may come."""
    correction_limit_mm: float = 2.0
    """Farthest that the command may move in a sample, either way. Chosen."""
    resolution_mm: float = POSITION_STEP_MM
    """Smallest step of the reported position, for the estimate."""
    force_uncertainty_n: float = 0.1
    """Standard deviation of the force, for the estimate."""

    def __post_init__(self) -> None:
        require_not_negative(self, "proportional")
        require_above_zero(self, "integral", "tuned_at_n_m", "stiffest_n_m", "correction_limit_mm")
        _pairing(self)

    def initial(self) -> PiState:
        """State before the first sample in contact."""
        return PiState()

    def step(self, state: PiState, measurement: Measurement, reference: float) -> tuple[PiState, Command]:
        """One sample. A measurement that is not finite moves nothing and is forgotten.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        if not measurement.is_finite:
            return state, Command(measurement.commanded, 0.0, state.estimate.value)
        estimate = observe(state.estimate, _pairing(self), measurement)
        error = reference - measurement.force
        change = 0.0 if state.error is None else error - state.error
        gain = _gain(self, estimate)
        wanted = gain * (self.proportional * change + self.integral * error) / self.tuned_at_n_m
        correction = _limit(wanted, self.correction_limit_mm)
        return PiState(error, estimate), _answer(measurement, correction, estimate, gain)


class AdmittanceState(Struct, frozen=True):
    """Where the virtual body is."""

    time: float | None = None
    """When the force was sampled last, s; None before the first sample."""
    offset: float = 0.0
    """Way of the virtual body from the begin of the contact, m, as commanded."""
    velocity: float = 0.0
    """Velocity of the virtual body, m/s."""
    anchor: float = 0.0
    """Commanded position at which contact began, m: the spring is relaxed there."""
    estimate: Stiffness = Stiffness()


@dataclass(frozen=True, slots=True)
class Admittance:
    """M · a + D · v + K · (x − x_0) = f_d − f: the command is where a virtual body is after the cycle.

    Source: textbook admittance control. Discretised exactly for a force that stays constant over a cycle, at
    the time that the cycle before took. Without spring the body rests at f = f_d only. With
    `gain_scheduling` mass, damper and spring are scaled by the estimated stiffness over the one tuned at.
    """

    __pydantic_config__: ClassVar = FORBID_EXTRA
    name: ClassVar[str] = "admittance"
    sample_ms: ClassVar[float] = SAMPLE_MS
    tunings: ClassVar[tuple[Tuning, ...]] = tuple(
        Tuning(
            sample_ms,
            {
                "mass_kg": 5.0,
                "damping_ns_m": 500.0,
                "cycle_ms": sample_ms,
                "resolution_mm": _STREAM_STEP_MM,
                "gain_scheduling": True,
            },
        )
        for sample_ms in STREAM_SAMPLES_MS
    )

    ranges: ClassVar[Mapping[str, Range]] = {
        "mass_kg": Range(1.0, 500.0, by_factor=True),
        "damping_ns_m": Range(100.0, 20_000.0, by_factor=True),
    }
    """Chosen: about a tenth to ten times of the defaults for all sample times."""

    mass_kg: float = 66.0
    """M. Chosen: with the damper a time constant of 30 ms, a fraction of the cycle."""
    damping_ns_m: float = 2200.0
    """D. Chosen: at the stiffness tuned at, two fifths of the error are made up for in a cycle of 0.18 s."""
    spring_n_m: float = 0.0
    """K. Above 0 the force rests below or above the desired one, by K times the distance from the first
    contact.
    """
    tuned_at_n_m: float = 5000.0
    """Stiffness that mass and damper were chosen for; the paper's sponge."""
    gain_scheduling: bool = False
    """Whether mass, damper and spring follow the estimated stiffness."""
    stiffest_n_m: float = 100_000.0
    """With scheduling, stiffness assumed before there is an estimate: the hardest surface that may come."""
    cycle_ms: float = SAMPLE_MS
    """Cycle taken for the first one, before any was measured, and the longest that is believed, five of
    them.
    """
    correction_limit_mm: float = 2.0
    """Farthest that the command may move in a sample, either way. Chosen."""
    resolution_mm: float = POSITION_STEP_MM
    """Smallest step of the reported position, for the estimate."""
    force_uncertainty_n: float = 0.1
    """Standard deviation of the force, for the estimate."""

    def __post_init__(self) -> None:
        require_above_zero(
            self, "mass_kg", "damping_ns_m", "tuned_at_n_m", "stiffest_n_m", "cycle_ms", "correction_limit_mm"
        )
        require_not_negative(self, "spring_n_m")
        _pairing(self)

    def initial(self) -> AdmittanceState:
        """State before the first sample in contact."""
        return AdmittanceState()

    def step(
        self, state: AdmittanceState, measurement: Measurement, reference: float
    ) -> tuple[AdmittanceState, Command]:
        """One sample. A measurement that is not finite moves nothing and is forgotten.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        if not (measurement.is_finite and math.isfinite(measurement.time)):
            return state, Command(measurement.commanded, 0.0, state.estimate.value)
        estimate = observe(state.estimate, _pairing(self), measurement)
        first = state.time is None
        anchor = measurement.commanded if first else state.anchor
        gain = _gain(self, estimate)
        # The part that the supervisor or the rounding to words took off does not belong to the body's motion.
        offset, velocity = self._move(
            measurement.commanded - anchor,
            state.velocity,
            gain * (reference - measurement.force),
            self._cycle(state, measurement),
        )
        wanted = anchor + offset - measurement.commanded
        correction = _limit(wanted, self.correction_limit_mm)
        if correction != wanted:
            velocity = 0.0
        state = AdmittanceState(measurement.time, offset, velocity, anchor, estimate)
        return state, _answer(measurement, correction, estimate, gain)

    def _cycle(self, state: AdmittanceState, measurement: Measurement) -> float:
        nominal = self.cycle_ms * 1e-3
        measured = measurement.time - state.time if state.time is not None else 0.0
        return measured if 0 < measured <= 5 * nominal else nominal

    def _move(self, offset: float, velocity: float, force: float, cycle: float) -> tuple[float, float]:
        """Return the body after a cycle. Scaling mass, damper and spring is the same as scaling the force inversely,
        so the force comes already scaled.
        """
        system = np.array(
            [
                [0.0, 1.0, 0.0],
                [-self.spring_n_m / self.mass_kg, -self.damping_ns_m / self.mass_kg, 1.0 / self.mass_kg],
                [0.0, 0.0, 0.0],
            ]
        )
        after = exponential(system * cycle) @ np.array([offset, velocity, force])
        return float(after[0]), float(after[1])


def _pairing(model: Pi | Admittance) -> Pairing:
    return Pairing(resolution_mm=model.resolution_mm, force_uncertainty_n=model.force_uncertainty_n)


def _gain(model: Pi | Admittance, estimate: Stiffness) -> float:
    """Stiffness tuned at over the one there is, with scheduling; else 1."""
    return model.tuned_at_n_m / (estimate.value or model.stiffest_n_m) if model.gain_scheduling else 1.0


def _limit(correction: float, limit_mm: float) -> float:
    limit = limit_mm * 1e-3
    return within(correction, -limit, limit)


def _answer(measurement: Measurement, correction: float, estimate: Stiffness, gain: float) -> Command:
    return Command(measurement.commanded + correction, correction, estimate.value, gain)
