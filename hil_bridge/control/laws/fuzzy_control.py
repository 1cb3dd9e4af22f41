"""The controllers of the paper and the one that knows the robot's position resolution.

Depth grows into the surface, force is positive while pressing, so too much force gives a negative correction.
Eq. (1), (2): error f_e(k) = f_a(k) − f_d and change f_ce(k) = f_e(k) − f_e(k−1), both in percent of f_d.
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
from hil_bridge.control.types import POSITION_STEP_MM, SAMPLE_MS, Command, Measurement, Range

OUTPUT_STEPS: Mapping[str, Range] = {"output_step_mm": Range(0.01, 0.5, by_factor=True)}
"""Chosen: from a fine robot's steps to four of the paper's."""


class FuzzyState(Struct, frozen=True):
    """State of the fuzzy PI between samples."""

    error: float | None = None
    """Force error of the sample before, N; None before the first one, whose change counts as 0."""


class AdaptiveState(Struct, frozen=True):
    """State of the adaptive controllers between samples."""

    error: float | None = None
    """Force error of the sample before, N."""
    estimate: StiffnessEstimate = StiffnessEstimate()


@dataclass(frozen=True, slots=True)
class FuzzyPi:
    """Fixed gains: x(k+1) = x_commanded(k) + K · G(f_e/f_d, f_ce/f_d). Source: the paper's Fig. 2 and
    Table 3.
    """

    __pydantic_config__: ClassVar = FORBID_EXTRA
    name: ClassVar[str] = "fuzzy"
    sample_ms: ClassVar[float] = SAMPLE_MS

    ranges: ClassVar[Mapping[str, Range]] = OUTPUT_STEPS
    output_step_mm: float = POSITION_STEP_MM
    """K: correction of one output level. The paper takes one resolution step of the robot."""
    surface: Surface = Surface.PAPER
    """Printed matrix, matrix computed from the rules, or the rules without quantisation."""
    rules_file: str = ""
    """TOML file with a rule base; empty takes the paper's."""
    _system: InferenceSystem = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        require_above_zero(self, "output_step_mm")
        object.__setattr__(self, "_system", _ready(self.surface, self.rules_file))

    def initial(self) -> FuzzyState:
        """State before the first sample in contact."""
        return FuzzyState()

    def step(
        self, state: FuzzyState, measurement: Measurement, reference: float
    ) -> tuple[FuzzyState, Command]:
        """One sample. A measurement that is not finite moves nothing and is forgotten.

        Raises ValueError for a reference that is not above 0, for errors are fractions of it.
        """
        check_reference(reference)
        if not measurement.is_finite:
            return state, _stay(measurement)
        error = measurement.force - reference
        explanation = _infer(self._system, state.error, error, reference)
        return FuzzyState(error), _correct(measurement, explanation, self.output_step_mm)


@dataclass(frozen=True, slots=True)
class FuzzyAdaptive:
    """The paper's adaptation: x(k+1) = x_est(k) + g · K · G(f_e/f_d, f_ce/f_d).

    x_est = x(k) − (f(k) − f_d)/k_est is eq. (5), k_est is eq. (4), and g is 1, for log10 k_est in (4, 5)
    one half, above 5 one quarter (k in N/m). Assumed: at exactly 5, which the paper leaves out, one half.
    Without an estimate, and without contact, the fuzzy PI works alone.
    """

    __pydantic_config__: ClassVar = FORBID_EXTRA
    name: ClassVar[str] = "fuzzy-adaptive"
    sample_ms: ClassVar[float] = SAMPLE_MS

    ranges: ClassVar[Mapping[str, Range]] = OUTPUT_STEPS
    output_step_mm: float = POSITION_STEP_MM
    """K: correction of one output level."""
    surface: Surface = Surface.PAPER
    """Printed matrix, matrix computed from the rules, or the rules without quantisation."""
    rules_file: str = ""
    """TOML file with a rule base; empty takes the paper's."""
    _system: InferenceSystem = field(init=False, repr=False, compare=False)
    resolution_mm: float = POSITION_STEP_MM
    """Smallest step of the reported position."""
    force_uncertainty_n: float = 0.5
    """Half-width of the force noise, as the paper assumes it."""
    feedforward_limit_mm: float | None = None
    """Farthest that the feedforward may move the command in a sample, either way. The paper has no such
    limit.
    """

    def __post_init__(self) -> None:
        require_above_zero(self, "output_step_mm")
        object.__setattr__(self, "_system", _ready(self.surface, self.rules_file))
        _check_adaptation(self)

    def initial(self) -> AdaptiveState:
        """State before the first sample in contact."""
        return AdaptiveState()

    def step(
        self, state: AdaptiveState, measurement: Measurement, reference: float
    ) -> tuple[AdaptiveState, Command]:
        """One sample. A measurement that is not finite moves nothing and is forgotten.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        if not measurement.is_finite:
            return state, _stay(measurement, state.estimate.stiffness)
        error = measurement.force - reference
        state, explanation = _observed(self, state, measurement, measurement.force, reference)
        stiffness = state.estimate.stiffness
        if stiffness is None:
            return state, _correct(measurement, explanation, self.output_step_mm)
        gain = scheduled_gain(stiffness)
        command = _correct(measurement, explanation, self.output_step_mm, gain, stiffness)
        if not measurement.in_contact:
            return state, command
        feedforward = _feedforward(self.feedforward_limit_mm, measurement, error, stiffness)
        command.explanation["feedforward_m"] = feedforward
        position = feedforward + command.correction
        return state, Command(position, command.correction, stiffness, gain, False, command.explanation)


@dataclass(frozen=True, slots=True)
class ResolutionAware:
    """Feedforward alone, and rest where no reachable position is nearer.

    x(k+1) = x_est(k) of eq. (5) while |f_e| > k_est · Δx_res/2 + uncertainty, else the command stays. Derived:
    positions are Δx_res apart, hence forces k_est · Δx_res, so no step can make a smaller error better. The fuzzy
    correction is never 0 for long on a hard surface and would keep the limit cycle alive. Estimate and feedforward take
    the force that acted when the position was true, where it is known. Without an estimate, and without contact, the
    fuzzy PI works alone.
    """

    __pydantic_config__: ClassVar = FORBID_EXTRA
    name: ClassVar[str] = "resolution-aware"
    sample_ms: ClassVar[float] = SAMPLE_MS

    ranges: ClassVar[Mapping[str, Range]] = OUTPUT_STEPS
    output_step_mm: float = POSITION_STEP_MM
    """K: correction of one output level of the fuzzy PI."""
    surface: Surface = Surface.PAPER
    """Printed matrix, matrix computed from the rules, or the rules without quantisation."""
    rules_file: str = ""
    """TOML file with a rule base; empty takes the paper's."""
    _system: InferenceSystem = field(init=False, repr=False, compare=False)
    resolution_mm: float = POSITION_STEP_MM
    """Smallest step of the robot's position."""
    force_uncertainty_n: float = 0.5
    """Half-width of the force noise; widens the band of rest."""
    feedforward_limit_mm: float | None = 2.0
    """Farthest that the feedforward may move the command in a sample, either way, whatever the estimate.
    Chosen.
    """

    def __post_init__(self) -> None:
        require_above_zero(self, "output_step_mm")
        object.__setattr__(self, "_system", _ready(self.surface, self.rules_file))
        _check_adaptation(self)

    def initial(self) -> AdaptiveState:
        """State before the first sample in contact."""
        return AdaptiveState()

    def step(
        self, state: AdaptiveState, measurement: Measurement, reference: float
    ) -> tuple[AdaptiveState, Command]:
        """One sample. A measurement that is not finite moves nothing and is forgotten.

        Raises ValueError for a reference that is not above 0.
        """
        check_reference(reference)
        if not measurement.is_finite:
            return state, _stay(measurement, state.estimate.stiffness)
        error = measurement.force - reference
        aligned = measurement.force_at_position
        state, explanation = _observed(self, state, measurement, aligned, reference)
        stiffness = state.estimate.stiffness
        if stiffness is None or not measurement.in_contact:
            return state, _correct(measurement, explanation, self.output_step_mm, 1.0, stiffness)
        band = stiffness * self.resolution_mm * 1e-3 / 2 + self.force_uncertainty_n
        explanation["band_n"] = band
        if abs(error) <= band:
            return state, Command(measurement.commanded, 0.0, stiffness, 1.0, True, explanation)
        feedforward = _feedforward(self.feedforward_limit_mm, measurement, aligned - reference, stiffness)
        explanation["feedforward_m"] = feedforward
        return state, Command(feedforward, 0.0, stiffness, 1.0, False, explanation)


def scheduled_gain(stiffness: float) -> float:
    """The paper's adaptation rule: factor on the fuzzy output for a stiffness in N/m."""
    decade = math.log10(stiffness)
    if decade <= 4:
        return 1.0
    return 0.5 if decade <= 5 else 0.25


def _ready(surface: str, rules_file: str) -> InferenceSystem:
    if surface not in tuple(Surface):
        raise ValueError(f"surface must be one of {', '.join(Surface)}, got {surface!r}")
    chosen = Surface(surface)
    return InferenceSystem(read_rules(rules_file), chosen) if rules_file else paper_system(chosen)


def _check_adaptation(model: FuzzyAdaptive | ResolutionAware) -> None:
    require_above_zero(model, "resolution_mm")
    require_not_negative(model, "force_uncertainty_n")
    if model.feedforward_limit_mm is not None:
        require_above_zero(model, "feedforward_limit_mm")


def _infer(system: InferenceSystem, before: float | None, error: float, reference: float) -> dict[str, float]:
    """Levels of both inputs and of the answer, and the rules behind it with their weights."""
    change = 0.0 if before is None else error - before
    percents = 100.0 * error / reference, 100.0 * change / reference
    inference, explanation = system.explain(*percents)
    explanation["level_error"] = inference.level_error
    explanation["level_change"] = inference.level_change
    explanation["level_output"] = inference.level_output
    return explanation


def _stay(measurement: Measurement, stiffness: float | None = None) -> Command:
    return Command(measurement.commanded, 0.0, stiffness)


def _correct(
    measurement: Measurement,
    explanation: dict[str, float],
    output_step_mm: float,
    gain: float = 1.0,
    stiffness: float | None = None,
) -> Command:
    correction = gain * explanation["level_output"] * output_step_mm * 1e-3
    return Command(measurement.commanded + correction, correction, stiffness, gain, False, explanation)


def _observed(
    model: FuzzyAdaptive | ResolutionAware,
    state: AdaptiveState,
    measurement: Measurement,
    force: float,
    reference: float,
) -> tuple[AdaptiveState, dict[str, float]]:
    """The state behind a sample, and what the fuzzy PI makes of it. `force` (N) is that of the reported position."""
    error = measurement.force - reference
    explanation = _infer(model._system, state.error, error, reference)
    if not measurement.in_contact:
        return AdaptiveState(error, contact_lost(state.estimate)), explanation
    gates = Gates(position_change=model.resolution_mm * 1e-3 / 2, force_change=2 * model.force_uncertainty_n)
    estimate = update(state.estimate, gates, measurement.position, force)
    return AdaptiveState(error, estimate), explanation


def _feedforward(limit_mm: float | None, measurement: Measurement, error: float, stiffness: float) -> float:
    expected = measurement.position - error / stiffness
    if limit_mm is None:
        return expected
    limit = limit_mm * 1e-3
    return min(max(expected, measurement.commanded - limit), measurement.commanded + limit)
