"""Textbook controllers for comparison: incremental PI and admittance.

Both move the command in proportion to the missing force, so their loop gain is proportional to the stiffness of the
surface. A controller tuned for one surface is slow on softer ones and oscillates on harder ones. Gain scheduling
scales the gains by the estimated stiffness.
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
"""Share of the error that the PI corrects per second on a streaming robot. Chosen: with half of this value, the
error on a contour is twice as large; with twice this value, the force overshoots.
"""
_STREAM_STEP_MM = 0.05
"""Position resolution that the estimate assumes for a streaming robot, mm. Chosen: on a soft surface, the smallest
move that counts then changes the force by more than its noise.
"""


class PiState(Struct, frozen=True):
    """State of the PI between samples."""

    error: float | None = None
    """f_d − f of the previous sample, N; None before the first sample. The change at the first sample counts as 0."""
    estimate: Stiffness = Stiffness()


@dataclass(frozen=True, slots=True)
class Pi:
    """x(k+1) = x_commanded(k) + [K_p · (e(k) − e(k−1)) + K_i · e(k)] / k_t, e = f_d − f.

    Source: textbook PI in velocity form, gains relative to the stiffness k_t that they were tuned at. With
    `gain_scheduling`, the estimated stiffness replaces k_t; before there is an estimate, `stiffest_n_m` does.
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
    """Ranges of the parameters for `hil-bridge tune`. Chosen: from hardly any response to a response that
    oscillates at the stiffness of tuning.
    """

    proportional: float = 0.2
    """K_p: share of a change of the error that is corrected per sample."""
    integral: float = 0.4
    """K_i: share of the error that is corrected per sample. Chosen together with K_p for little overshoot at the delay
    of the computer link, nearly two samples.
    """
    tuned_at_n_m: float = 5000.0
    """k_t: stiffness that the gains were tuned at, N/m; the paper's sponge."""
    gain_scheduling: bool = False
    """Whether the estimated stiffness scales the gains."""
    stiffest_n_m: float = 100_000.0
    """Stiffness that gain scheduling assumes before there is an estimate, N/m: that of the hardest expected surface."""
    correction_limit_mm: float = 2.0
    """Largest move of the command per sample in either direction, mm. Chosen."""
    resolution_mm: float = POSITION_STEP_MM
    """Resolution of the reported position, for the estimate, mm."""
    force_uncertainty_n: float = 0.1
    """Standard deviation of the force, for the estimate, N."""

    def __post_init__(self) -> None:
        require_not_negative(self, "proportional")
        require_above_zero(self, "integral", "tuned_at_n_m", "stiffest_n_m", "correction_limit_mm")
        _pairing(self)

    def initial(self) -> PiState:
        """Return the state before the first sample in contact."""
        return PiState()

    def step(self, state: PiState, measurement: Measurement, reference: float) -> tuple[PiState, Command]:
        """Return the command for one sample. A measurement that is not finite causes no motion and is ignored.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        if not measurement.is_finite:
            return state, Command(measurement.commanded, 0.0, state.estimate.value)
        estimate = observe(state.estimate, _pairing(self), measurement)
        error = reference - measurement.force
        change = 0.0 if state.error is None else error - state.error
        gain = _gain(self, estimate)
        requested = gain * (self.proportional * change + self.integral * error) / self.tuned_at_n_m
        correction = _limit(requested, self.correction_limit_mm)
        return PiState(error, estimate), _answer(measurement, correction, estimate, gain)


class AdmittanceState(Struct, frozen=True):
    """State of the virtual body."""

    time: float | None = None
    """Time of the last force sample, s; None before the first sample."""
    offset: float = 0.0
    """Commanded displacement of the virtual body since the start of the contact, m."""
    velocity: float = 0.0
    """Velocity of the virtual body, m/s."""
    anchor: float = 0.0
    """Commanded position at which contact began, m. The spring is relaxed there."""
    estimate: Stiffness = Stiffness()


@dataclass(frozen=True, slots=True)
class Admittance:
    """M · a + D · v + K · (x − x_0) = f_d − f: the command is the position of a virtual body after the cycle.

    Source: textbook admittance control. Discretised exactly for a force that stays constant over a cycle, with the
    duration of the previous cycle. Without a spring, the body is in equilibrium only at f = f_d. With
    `gain_scheduling`, mass, damper and spring are scaled by the estimated stiffness over the stiffness of tuning.
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
    """Ranges of the parameters for `hil-bridge tune`. Chosen: about a tenth to ten times the defaults, for all
    sample times.
    """

    mass_kg: float = 66.0
    """M. Chosen: with the damper a time constant of 30 ms, a fraction of the cycle."""
    damping_ns_m: float = 2200.0
    """D. Chosen: at the stiffness of tuning, two fifths of the error are corrected in a cycle of 0.18 s."""
    spring_n_m: float = 0.0
    """K. Above 0, the force settles below or above the desired force, by K times the distance from the first contact.
    """
    tuned_at_n_m: float = 5000.0
    """Stiffness that mass and damper were chosen for, N/m; the paper's sponge."""
    gain_scheduling: bool = False
    """Whether the estimated stiffness scales mass, damper and spring."""
    stiffest_n_m: float = 100_000.0
    """Stiffness that gain scheduling assumes before there is an estimate, N/m: that of the hardest expected surface."""
    cycle_ms: float = SAMPLE_MS
    """Duration assumed for the first cycle, before any was measured, ms. A measured duration counts for at most five
    times as much.
    """
    correction_limit_mm: float = 2.0
    """Largest move of the command per sample in either direction, mm. Chosen."""
    resolution_mm: float = POSITION_STEP_MM
    """Resolution of the reported position, for the estimate, mm."""
    force_uncertainty_n: float = 0.1
    """Standard deviation of the force, for the estimate, N."""

    def __post_init__(self) -> None:
        require_above_zero(
            self, "mass_kg", "damping_ns_m", "tuned_at_n_m", "stiffest_n_m", "cycle_ms", "correction_limit_mm"
        )
        require_not_negative(self, "spring_n_m")
        _pairing(self)

    def initial(self) -> AdmittanceState:
        """Return the state before the first sample in contact."""
        return AdmittanceState()

    def step(
        self, state: AdmittanceState, measurement: Measurement, reference: float
    ) -> tuple[AdmittanceState, Command]:
        """Return the command for one sample. A measurement that is not finite causes no motion and is ignored.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        if not (measurement.is_finite and math.isfinite(measurement.time)):
            return state, Command(measurement.commanded, 0.0, state.estimate.value)
        estimate = observe(state.estimate, _pairing(self), measurement)
        first = state.time is None
        anchor = measurement.commanded if first else state.anchor
        gain = _gain(self, estimate)
        # Motion that the supervisor or rounding removed is not part of the body's motion.
        offset, velocity = self._move(
            measurement.commanded - anchor,
            state.velocity,
            gain * (reference - measurement.force),
            self._cycle(state, measurement),
        )
        requested = anchor + offset - measurement.commanded
        correction = _limit(requested, self.correction_limit_mm)
        if correction != requested:
            velocity = 0.0
        state = AdmittanceState(measurement.time, offset, velocity, anchor, estimate)
        return state, _answer(measurement, correction, estimate, gain)

    def _cycle(self, state: AdmittanceState, measurement: Measurement) -> float:
        nominal = self.cycle_ms * 1e-3
        measured = measurement.time - state.time if state.time is not None else 0.0
        return measured if 0 < measured <= 5 * nominal else nominal

    def _move(self, offset: float, velocity: float, force: float, cycle: float) -> tuple[float, float]:
        """Return the body after a cycle. Scaling mass, damper and spring is equivalent to scaling the force
        inversely, so the given force is already scaled.
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
    """Return the ratio of the stiffness of tuning to the current stiffness; 1 without gain scheduling."""
    return model.tuned_at_n_m / (estimate.value or model.stiffest_n_m) if model.gain_scheduling else 1.0


def _limit(correction: float, limit_mm: float) -> float:
    limit = limit_mm * 1e-3
    return within(correction, -limit, limit)


def _answer(measurement: Measurement, correction: float, estimate: Stiffness, gain: float) -> Command:
    return Command(measurement.commanded + correction, correction, estimate.value, gain)
