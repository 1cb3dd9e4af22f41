"""Stability of a recorded force loop, and the limit cycle due to quantised positions: prediction and measurement."""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from hil_bridge.control.analysis.merit import STEADY_SAMPLES
from hil_bridge.control.analysis.stability import (
    LimitCycle,
    Margins,
    Quantiser,
    Response,
    SampledPlant,
    admittance_response,
    limit_cycle,
    margins,
    pi_response,
)
from hil_bridge.control.laws.linear import Admittance, Pi
from hil_bridge.devices.facts import ACCEPTED, Devices
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.analysis.summary import Summary
from hil_bridge.record.device_facts import devices_of, recorded_configuration
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord

PHASE_MARGIN_DEG = 45.0
"""Smallest phase margin that counts as comfortable, °. Chosen: the textbook rule."""
GAIN_MARGIN = 2.0
"""Smallest gain margin that counts as comfortable. Chosen: the textbook rule."""

SUBSTITUTE_GAIN = 0.2
"""Gain of the integrator that substitutes for a nonlinear controller, as the share of the error that it corrects
per sample.

Chosen: the value of the resolution experiment, low enough that the limit cycle involves only two positions.
"""
_PERIODIC_SHARE = 0.4
"""Share of the variance of the error that one frequency must explain for its period to count as the period of the
error.

Chosen: white noise reaches this share once in hundreds of runs.
"""
_FREQUENCIES = 200
_MOST_TAPS = 500
"""Maximum number of samples that the servo may need to settle. A larger number indicates a damaged file, not a
force loop.
"""
_BISECTIONS = 14
_SOFTEST = 1e-4
"""Share of the stiffness below which the search for a comfortable stiffness stops."""


@dataclass(frozen=True, slots=True)
class Part:
    """Contribution to the delay of the loop."""

    label: str
    seconds: float
    source: str
    """Description of the origin of the value: measured, as configured, or assumed."""


@dataclass(frozen=True, slots=True)
class LinearLoop:
    """Force loop with a linear controller."""

    response: Response
    """Response of the controller, C(z), m/N."""
    margins: Margins
    comfortable_to: float | None
    """Stiffness up to which both margins are comfortable, N/m; None if there is no such stiffness of reasonable
    size.
    """
    unstable_from: float
    """Stiffness at which the gain margin vanishes if the gain is unchanged, N/m."""
    scheduled: bool
    """Whether the gain is scheduled by the estimated stiffness."""

    @property
    def comfortable(self) -> bool:
        """Whether both margins meet the textbook rules."""
        return _comfortable(self.margins)


@dataclass(frozen=True, slots=True)
class Analysis:
    """Force loop as identified from a recording."""

    plant: SampledPlant
    delay: tuple[Part, ...]
    servo_source: str
    stiffness: float
    """Contact stiffness, N/m."""
    stiffness_source: str
    resolution: float
    """Position resolution Δx_res, m."""
    dead_band: float
    """Largest position error, in either direction, that is not corrected, in resolution steps."""
    loop: LinearLoop | None
    """Linear loop; None for a nonlinear controller."""
    predicted: LimitCycle | None
    """Predicted limit cycle; None for a loop that is unstable even without quantisation, or that has no limit cycle."""
    steady_peak_to_peak: float | None
    """Peak-to-peak force in steady state, N; None without a steady state."""
    steps_per_second: float | None
    """Rate of resolution steps of the command in steady state, 1/s; None without a steady state."""
    dominant_period: float | None
    """Period of the force error in steady state, s; None without a dominant period."""

    @property
    def step_force(self) -> float:
        """Force of one resolution step, k_e·Δx_res, N."""
        return self.stiffness * self.resolution


def analyse(recording: Recording, summary: Summary) -> Analysis | None:
    """Analyse a recording; None without configuration, tracked cycles or stiffness."""
    config, devices = recorded_configuration(recording), devices_of(recording)
    robot, step = devices.robot, devices.robot.position_step_m
    track = [cycle for cycle in recording.cycles if cycle.phase == TRACK and math.isfinite(cycle.force)]
    steady = track[-STEADY_SAMPLES:]
    stiffness, timed = _stiffness(steady, config, robot.emulated), _plant(track, devices)
    if stiffness is None or timed is None or robot.servo is None or not step:
        return None
    dead_band = robot.servo.dead_band_steps
    (k, stiffness_source), (plant, parts) = stiffness, timed
    loop = _linear_loop(config, summary.controller, k, plant, statistics.median(c.gain for c in steady))
    return Analysis(
        plant=plant,
        delay=parts,
        servo_source=robot.servo_source("natural_frequency_rad_s", "damping_ratio"),
        stiffness=k,
        stiffness_source=stiffness_source,
        resolution=step,
        dead_band=dead_band,
        loop=loop,
        predicted=_predict(k, loop, plant, step, dead_band),
        steady_peak_to_peak=summary.figures.get("steady_peak_to_peak_n"),
        steps_per_second=summary.figures.get("steps_per_s"),
        dominant_period=dominant_period(
            [cycle.controlled_at for cycle in steady],
            [cycle.force - cycle.force_reference for cycle in steady],
        ),
    )


def dominant_period(time: Sequence[float], error: Sequence[float]) -> float | None:
    """Return the period of the oscillation that explains most of the error, s; None if no oscillation is dominant.

    The least-squares fit uses the actual times, which need not be evenly spaced.
    """
    at, value = np.asarray(time, dtype=float), np.asarray(error, dtype=float)
    if len(at) < STEADY_SAMPLES or not np.isfinite(at + value).all() or not (span := float(np.ptp(at))) > 0.0:
        return None
    value = value - value.mean()
    power = float(value @ value)
    if power <= 1e-12 * len(value):
        return None
    best, period = 0.0, None
    for frequency in np.linspace(1.5, len(at) / 2, _FREQUENCIES) / span:
        angle = math.tau * frequency * (at - at[0])
        waves = np.column_stack((np.cos(angle), np.sin(angle)))
        fitted = waves @ np.linalg.lstsq(waves, value, rcond=None)[0]
        share = float(fitted @ fitted) / power
        if share > best:
            best, period = share, 1.0 / float(frequency)
    return period if best >= _PERIODIC_SHARE else None


def _stiffness(
    steady: Sequence[CycleRecord], config: Mapping[str, Any], emulated: bool
) -> tuple[float, str] | None:
    known = [c.stiffness for c in steady if c.stiffness is not None and 0.0 < c.stiffness < math.inf]
    if known:
        return statistics.median(known), f"median of the last {len(known)} estimates"
    linear = _at(config, "cell.surface.material.kind") in ("linear", None)
    configured = _number(config, "cell.surface.stiffness_n_m")
    if emulated and linear and configured is not None and configured > 0.0:
        return configured, "no estimate; configured value of the emulated surface, as on a rigid arm"
    return None


def _plant(track: Sequence[CycleRecord], devices: Devices) -> tuple[SampledPlant, tuple[Part, ...]] | None:
    periods = [b.started_at - a.started_at for a, b in pairwise(track)]
    waits = [cycle.answered_at - cycle.sample.sensor_at for cycle in track]
    waits = [wait for wait in waits if math.isfinite(wait)]
    servo = devices.robot.servo
    if not (periods and waits) or servo is None:
        return None
    source = devices.robot.servo_source
    waited = statistics.median(waits)
    hops = devices.robot.hops
    if (answer := None if hops is None else hops.earlier_s(ACCEPTED)) is None:
        taking = Part(
            "frame's arrival to the move's answer",
            waited,
            "measured, median; the move is accepted a little before its answer is complete",
        )
    else:
        taking = Part(
            "frame's arrival to the move's acceptance",
            waited - answer,
            "measured, median: as its answer begins",
        )
    parts = [
        taking,
        Part("wait for the interpolator", servo.wait_s, f"half a tick, {source('interpolation_s')}"),
        Part("servo's transport delay", servo.transport_delay_s, source("transport_delay_s")),
    ]
    if lag := devices.sensor.delay_s:
        parts.insert(
            0,
            Part(
                "sensor's filter", lag, "phase delay at low frequencies, with the sensor settings of the run"
            ),
        )
    frequency, damping = servo.natural_frequency_rad_s, servo.damping_ratio
    delay = math.fsum(part.seconds for part in parts)
    try:
        plant = SampledPlant(statistics.median(periods), delay, frequency, damping)
    except ValueError:
        return None
    settling = delay + 21.0 / (frequency * min(damping, 0.5 / damping))
    return (plant, tuple(parts)) if settling <= _MOST_TAPS * plant.period else None


def _linear_loop(
    config: Mapping[str, Any], name: str, stiffness: float, plant: SampledPlant, gain: float
) -> LinearLoop | None:
    kind = {"pi": Pi, "admittance": Admittance}.get(name)
    parameters = _at(config, "controller.parameters")
    if kind is None or not isinstance(parameters, dict) or not 0.0 < gain < math.inf:
        return None
    try:
        controller = kind(**parameters)
    except (TypeError, ValueError):
        return None
    response: Response
    match controller:
        case Pi():
            scale = gain / controller.tuned_at_n_m
            response = pi_response(controller.proportional * scale, controller.integral * scale)
        case Admittance(spring_n_m=0.0):
            response = admittance_response(
                controller.mass_kg / gain, controller.damping_ns_m / gain, plant.period
            )
        case _:  # a spring prevents the integration that the formulas assume
            return None
    loop_margins = margins(stiffness, response, plant)
    return LinearLoop(
        response,
        loop_margins,
        _comfortable_to(stiffness, response, plant, loop_margins),
        stiffness * loop_margins.gain_margin,
        controller.gain_scheduling,
    )


def _predict(
    stiffness: float, loop: LinearLoop | None, plant: SampledPlant, resolution: float, dead_band: float
) -> LimitCycle | None:
    if loop is not None and not loop.margins.stable:
        return None
    response = pi_response(0.0, SUBSTITUTE_GAIN / stiffness) if loop is None else loop.response
    try:
        return limit_cycle(stiffness, response, plant, Quantiser(resolution, dead_band))
    except ValueError:
        return None


def _comfortable(loop_margins: Margins) -> bool:
    return loop_margins.gain_margin >= GAIN_MARGIN and loop_margins.phase_margin_deg >= PHASE_MARGIN_DEG


def _comfortable_to(
    stiffness: float, response: Response, plant: SampledPlant, loop_margins: Margins
) -> float | None:
    """Return the largest comfortable stiffness by bisection, because the phase margin has no closed form."""
    if not math.isfinite(loop_margins.gain_margin):
        return None
    low, high = stiffness, stiffness * loop_margins.gain_margin
    if not _comfortable(loop_margins):
        low, high = min(low, high) * _SOFTEST, min(low, high)
        if not _comfortable(margins(low, response, plant)):
            return None
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        if _comfortable(margins(middle, response, plant)):
            low = middle
        else:
            high = middle
    return low


def _at(config: Mapping[str, Any], key: str) -> Any:
    value: Any = config
    for name in key.split("."):
        value = value.get(name) if isinstance(value, dict) else None
    return value


def _number(config: Mapping[str, Any], key: str) -> float | None:
    value = _at(config, key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if 0.0 <= value < 1e9 else None
