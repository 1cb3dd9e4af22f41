"""Stability of a recorded force loop, and the limit cycle that quantised
positions leave in it: predicted beside measured.
"""

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
"""Least phase margin that counts as comfortable: the textbooks' rule."""
GAIN_MARGIN = 2.0
"""Least gain margin that counts as comfortable, likewise."""

STAND_IN_GAIN = 0.2
"""Share of the error made up for in a sample by the integrator that stands for a controller that is not
linear. Chosen: the one of the resolution experiment, low enough that two positions alone take part.
"""
_PERIODIC_SHARE = 0.4
"""Share of the variance of the error that one frequency must hold to be called its period. Chosen: white
noise gets there once in hundreds of runs.
"""
_FREQUENCIES = 200
_MOST_TAPS = 500
"""Most samples that the servo may take to settle. A larger number comes from a garbled file, not from a force loop."""
_BISECTIONS = 14
_SOFTEST = 1e-4
"""Share of the stiffness below which no comfortable one is looked for."""


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the delay."""

    label: str
    seconds: float
    source: str
    """measured, as configured or assumed"""


@dataclass(frozen=True, slots=True)
class LinearLoop:
    """The loop of a linear controller."""

    response: Response
    """C(z), m/N"""
    margins: Margins
    comfortable_to: float | None
    """Stiffness up to which both margins are comfortable, N/m; None when it is none of reasonable size."""
    unstable_from: float
    """Stiffness at which the margin is gone, N/m, with the gain as it was."""
    scheduled: bool
    """The gain follows the estimated stiffness."""

    @property
    def comfortable(self) -> bool:
        """Both margins are what textbooks ask for."""
        return _comfortable(self.margins)


@dataclass(frozen=True, slots=True)
class Analysis:
    """The loop as the record shows it."""

    plant: SampledPlant
    delay: tuple[Part, ...]
    servo_source: str
    stiffness: float
    """N/m"""
    stiffness_source: str
    resolution: float
    """Δx_res, m"""
    dead_band: float
    """Largest error of the position without correction, either way, in resolution steps."""
    loop: LinearLoop | None
    """None for a controller that is not linear."""
    predicted: LimitCycle | None
    """None for a loop that is unstable by itself, or never swings."""
    steady_peak_to_peak: float | None
    """N; None when the run has no steady state."""
    steps_per_second: float | None
    """Resolution steps a second that the command moved in steady state, 1/s; None without a steady state."""
    dominant_period: float | None
    """Period of the force error in steady state, s; None when no period stands out."""

    @property
    def step_force(self) -> float:
        """k_e·Δx_res, N."""
        return self.stiffness * self.resolution


def analyse(recording: Recording, summary: Summary) -> Analysis | None:
    """None when the record says too little: no configuration, no tracked cycles, no stiffness."""
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
    """Period of the one oscillation that explains most of the error, s; None when none stands out.

    By least squares at the times themselves, which need not be evenly spaced.
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
        return configured, "no estimate; that of the emulated surface, as configured"
    return None


def _plant(track: Sequence[CycleRecord], devices: Devices) -> tuple[SampledPlant, tuple[Part, ...]] | None:
    periods = [b.started_at - a.started_at for a, b in pairwise(track)]
    waits = [cycle.answered_at - cycle.sample.sensor_at for cycle in track]
    waits = [wait for wait in waits if math.isfinite(wait)]
    servo = devices.robot.servo
    if not (periods and waits) or servo is None:
        return None
    source = devices.robot.servo_source
    taken = statistics.median(waits)
    hops = devices.robot.hops
    if (answer := None if hops is None else hops.earlier_s(ACCEPTED)) is None:
        taking = Part(
            "frame's arrival to the move's answer",
            taken,
            "measured, median; the move is accepted a little before its answer is complete",
        )
    else:
        taking = Part(
            "frame's arrival to the move's acceptance",
            taken - answer,
            "measured, median: as its answer begins",
        )
    parts = [
        taking,
        Part("wait for the interpolator", servo.wait_s, f"half a tick, {source('interpolation_s')}"),
        Part("servo's transport delay", servo.transport_delay_s, source("transport_delay_s")),
    ]
    if lag := devices.sensor.delay_s:
        parts.insert(
            0, Part("sensor's filter", lag, "phase delay at low frequencies, as the run's sensor was set")
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
        case _:  # with its spring it does not integrate, which the formulas take for granted
            return None
    found = margins(stiffness, response, plant)
    return LinearLoop(
        response,
        found,
        _comfortable_to(stiffness, response, plant, found),
        stiffness * found.gain_margin,
        controller.gain_scheduling,
    )


def _predict(
    stiffness: float, loop: LinearLoop | None, plant: SampledPlant, resolution: float, dead_band: float
) -> LimitCycle | None:
    if loop is not None and not loop.margins.stable:
        return None
    response = pi_response(0.0, STAND_IN_GAIN / stiffness) if loop is None else loop.response
    try:
        return limit_cycle(stiffness, response, plant, Quantiser(resolution, dead_band))
    except ValueError:
        return None


def _comfortable(found: Margins) -> bool:
    return found.gain_margin >= GAIN_MARGIN and found.phase_margin_deg >= PHASE_MARGIN_DEG


def _comfortable_to(
    stiffness: float, response: Response, plant: SampledPlant, found: Margins
) -> float | None:
    """Stiffness by bisection, for the phase margin follows it by no formula."""
    if not math.isfinite(found.gain_margin):
        return None
    low, high = stiffness, stiffness * found.gain_margin
    if not _comfortable(found):
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
    found: Any = config
    for name in key.split("."):
        found = found.get(name) if isinstance(found, dict) else None
    return found


def _number(config: Mapping[str, Any], key: str) -> float | None:
    found = _at(config, key)
    if isinstance(found, bool) or not isinstance(found, (int, float)):
        return None
    return float(found) if 0.0 <= found < 1e9 else None
