"""The paper's controllers, and a controller that accounts for the robot's position resolution.

Depth grows into the surface, and force is positive while pressing, so a force above the desired force gives a
negative correction. Eq. (1), (2): error f_e(k) = f_a(k) − f_d and change f_ce(k) = f_e(k) − f_e(k−1), both in
percent of f_d.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from msgspec import Struct

from hil_bridge.control.checks import (
    FORBID_EXTRA,
    check_reference,
    require_above_zero,
    require_not_negative,
)
from hil_bridge.control.laws.estimate import Gates, StiffnessEstimate, contact_lost, update
from hil_bridge.control.laws.fuzzy import InferenceSystem, Surface, paper_system
from hil_bridge.control.laws.rules import read_rules
from hil_bridge.control.limiting import within
from hil_bridge.control.types import POSITION_STEP_MM, SAMPLE_MS, Command, Measurement, Range
from protocol.marks import SettingError

OUTPUT_STEPS: Mapping[str, Range] = {"output_step_mm": Range(0.01, 0.5, by_factor=True)}
"""Range of the output step for tuning, mm. Chosen: from the resolution step of a fine robot to four times the step
of the paper's robot.
"""


class FuzzyState(Struct, frozen=True):
    """State of the fuzzy PI between samples."""

    error: float | None = None
    """Force error of the previous sample, N; None before the first sample. The change at the first sample counts as
    0.
    """


class AdaptiveState(Struct, frozen=True):
    """State of the adaptive controllers between samples."""

    error: float | None = None
    """Force error of the previous sample, N."""
    estimate: StiffnessEstimate = StiffnessEstimate()


@dataclass(frozen=True, slots=True)
class _Fuzzy:
    """Settings shared by all controllers with a rule base."""

    __pydantic_config__: ClassVar = FORBID_EXTRA
    sample_ms: ClassVar[float] = SAMPLE_MS

    ranges: ClassVar[Mapping[str, Range]] = OUTPUT_STEPS
    output_step_mm: float = POSITION_STEP_MM
    """K: correction per output level of the fuzzy PI, mm. The paper uses one resolution step of the robot."""
    surface: Surface = Surface.PAPER
    """Control surface: the printed matrix, the matrix computed from the rules, or the rules without quantisation."""
    rules_file: str = ""
    """TOML file with a rule base; if empty, the paper's rule base."""
    _system: InferenceSystem = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        require_above_zero(self, "output_step_mm")
        object.__setattr__(self, "_system", _ready(self.surface, self.rules_file))

    def _infer(self, before: float | None, error: float, reference: float) -> dict[str, float]:
        """Return the levels of both inputs and of the output, and the active rules with their weights."""
        change = 0.0 if before is None else error - before
        return self._system.explain(100.0 * error / reference, 100.0 * change / reference)

    def _correction(self, explanation: dict[str, float], gain: float) -> float:
        """Return the correction from the rules, m."""
        return gain * explanation["level_output"] * self.output_step_mm * 1e-3

    def _correct(
        self,
        measurement: Measurement,
        explanation: dict[str, float],
        gain: float = 1.0,
        stiffness: float | None = None,
    ) -> Command:
        """Return the command of the fuzzy PI."""
        correction = self._correction(explanation, gain)
        return Command(
            position=measurement.commanded + correction,
            correction=correction,
            stiffness=stiffness,
            gain=gain,
            held=False,
            explanation=explanation,
        )


@dataclass(frozen=True, slots=True)
class FuzzyPi(_Fuzzy):
    """Fuzzy PI with fixed gains: x(k+1) = x_commanded(k) + K · G(f_e/f_d, f_ce/f_d). Source: the paper's Fig. 2 and
    Table 3.
    """

    name: ClassVar[str] = "fuzzy"

    def initial(self) -> FuzzyState:
        """Return the state before the first sample in contact."""
        return FuzzyState()

    def step(
        self, state: FuzzyState, measurement: Measurement, reference: float
    ) -> tuple[FuzzyState, Command]:
        """Return the command for one sample. A measurement that is not finite causes no motion and is ignored.

        Raises ValueError for a reference that is not above 0, because errors are relative to it.
        """
        check_reference(reference)
        if not measurement.is_finite:
            return state, _stay(measurement)
        error = measurement.force - reference
        return FuzzyState(error), self._correct(measurement, self._infer(state.error, error, reference))


@dataclass(frozen=True, slots=True)
class _Adaptive(_Fuzzy):
    """Fuzzy PI with an estimate of the stiffness. Without an estimate, the fuzzy PI works alone."""

    resolution_mm: float = POSITION_STEP_MM
    """Resolution of the robot's position, mm."""
    force_uncertainty_n: float = 0.5
    """Half-width of the force noise, N."""
    feedforward_limit_mm: float | None = None
    """Largest move of the command by the feedforward per sample in either direction, mm; the paper has no such limit.
    """
    _gates: Gates = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        _Fuzzy.__post_init__(self)
        require_above_zero(self, "resolution_mm")
        require_not_negative(self, "force_uncertainty_n")
        if self.feedforward_limit_mm is not None:
            require_above_zero(self, "feedforward_limit_mm")
        gates = Gates(self.resolution_mm * 1e-3 / 2, 2 * self.force_uncertainty_n)
        object.__setattr__(self, "_gates", gates)

    def initial(self) -> AdaptiveState:
        """Return the state before the first sample in contact."""
        return AdaptiveState()

    def step(
        self, state: AdaptiveState, measurement: Measurement, reference: float
    ) -> tuple[AdaptiveState, Command]:
        """Return the command for one sample. A measurement that is not finite causes no motion and is ignored.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        if not measurement.is_finite:
            return state, _stay(measurement, state.estimate.stiffness)
        error = measurement.force - reference
        explanation = self._infer(state.error, error, reference)
        estimate = self._observe(state.estimate, measurement)
        if estimate.stiffness is None:
            command = self._correct(measurement, explanation)
        else:
            command = self._answer(measurement, reference, explanation, estimate.stiffness)
        return AdaptiveState(error, estimate), command

    def _observe(self, estimate: StiffnessEstimate, measurement: Measurement) -> StiffnessEstimate:
        """Return the estimate after a sample."""
        if not measurement.in_contact:
            return contact_lost(estimate)
        return update(estimate, self._gates, measurement.position, self._force(measurement))

    def _force(self, measurement: Measurement) -> float:
        """Return the force that corresponds to the reported position, N."""
        return measurement.force

    def _answer(
        self, measurement: Measurement, reference: float, explanation: dict[str, float], stiffness: float
    ) -> Command:
        """Return the command for a known stiffness, N/m."""
        raise NotImplementedError

    def _feedforward(self, measurement: Measurement, reference: float, stiffness: float) -> float:
        """Return the position at which the desired force is expected, m."""
        expected = measurement.position - (self._force(measurement) - reference) / stiffness
        if self.feedforward_limit_mm is None:
            return expected
        limit = self.feedforward_limit_mm * 1e-3
        return within(expected, measurement.commanded - limit, measurement.commanded + limit)


@dataclass(frozen=True, slots=True)
class FuzzyAdaptive(_Adaptive):
    """The paper's adaptive controller: x(k+1) = x_est(k) + g · K · G(f_e/f_d, f_ce/f_d).

    x_est = x(k) − (f(k) − f_d)/k_est is eq. (5), k_est is eq. (4). g is 1; one half for log10 k_est in (4, 5); one
    quarter above 5 (k in N/m). Assumed: one half at exactly 5, which the paper leaves open. Without an estimate, and
    without contact, the fuzzy PI works alone.
    """

    name: ClassVar[str] = "fuzzy-adaptive"

    def _answer(
        self, measurement: Measurement, reference: float, explanation: dict[str, float], stiffness: float
    ) -> Command:
        gain = scheduled_gain(stiffness)
        if not measurement.in_contact:
            return self._correct(measurement, explanation, gain, stiffness)
        correction = self._correction(explanation, gain)
        feedforward = self._feedforward(measurement, reference, stiffness)
        explanation["feedforward_m"] = feedforward
        return Command(
            position=feedforward + correction,
            correction=correction,
            stiffness=stiffness,
            gain=gain,
            held=False,
            explanation=explanation,
        )


@dataclass(frozen=True, slots=True)
class ResolutionAware(_Adaptive):
    """Feedforward only, and no motion where no reachable position is nearer.

    x(k+1) = x_est(k) of eq. (5) while |f_e| > k_est · Δx_res/2 + uncertainty, else the command stays. Derived:
    positions are Δx_res apart, hence forces k_est · Δx_res, so no step can reduce a smaller error. On a hard surface
    the fuzzy correction is never 0 for long and would sustain the limit cycle. Estimate and feedforward use the force
    at the moment for which the position was reported, where it is known. Without an estimate, and without contact, the
    fuzzy PI works alone.
    """

    name: ClassVar[str] = "resolution-aware"

    feedforward_limit_mm: float | None = 2.0
    """Largest move of the command by the feedforward per sample in either direction, mm, whatever the estimate. Chosen.
    """

    def _force(self, measurement: Measurement) -> float:
        return measurement.force_at_position

    def _answer(
        self, measurement: Measurement, reference: float, explanation: dict[str, float], stiffness: float
    ) -> Command:
        if not measurement.in_contact:
            return self._correct(measurement, explanation, 1.0, stiffness)
        band = stiffness * self.resolution_mm * 1e-3 / 2 + self.force_uncertainty_n
        explanation["band_n"] = band
        if abs(measurement.force - reference) <= band:
            return Command(
                position=measurement.commanded,
                correction=0.0,
                stiffness=stiffness,
                gain=1.0,
                held=True,
                explanation=explanation,
            )
        feedforward = self._feedforward(measurement, reference, stiffness)
        explanation["feedforward_m"] = feedforward
        return Command(
            position=feedforward,
            correction=0.0,
            stiffness=stiffness,
            gain=1.0,
            held=False,
            explanation=explanation,
        )


def scheduled_gain(stiffness: float) -> float:
    """Return the factor on the fuzzy output for a stiffness in N/m, by the paper's adaptation rule."""
    decade = math.log10(stiffness)
    if decade <= 4.0:
        return 1.0
    return 0.5 if decade <= 5.0 else 0.25


def _ready(surface: str, rules_file: str) -> InferenceSystem:
    if surface not in tuple(Surface):
        raise SettingError("surface", f"must be one of {', '.join(Surface)}, got {surface!r}")
    chosen = Surface(surface)
    return InferenceSystem(read_rules(rules_file), chosen) if rules_file else paper_system(chosen)


def _stay(measurement: Measurement, stiffness: float | None = None) -> Command:
    return Command(measurement.commanded, 0.0, stiffness)
