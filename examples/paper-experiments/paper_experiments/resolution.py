"""The paper's discussion: the limit cycle caused by the position resolution, measured and predicted.

The controller is an integral controller whose loop gain is the same on every surface, so that only stiffness and
resolution make a difference. It runs in the paper's simulation, which only rounds the position, and through the
complete chain, whose servo does not react inside its dead band. Each has its own prediction.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from hil_bridge.control.analysis.stability import (
    HoldingServo,
    LimitCycle,
    Quantiser,
    SampledPlant,
    holding_limit_cycle,
    limit_cycle,
    pi_response,
)
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.devices.sensors.jr3.room import CAN_GATEWAY as JR3
from hil_bridge.lab.drawing import Line, Panel
from hil_bridge.settings.kinds import settings_of
from paper_experiments.cell import CellJob, CellTrace
from paper_experiments.paper_simulation import PERIOD, PaperJob, PaperRun, Parameters
from paper_experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    figure,
    round_digits,
    spread,
    verdict,
)
from protocol.devices.s3.adlp import BLOCK_OVERHEAD

STIFFNESSES = (5e3, 1e4, 2e4, 5e4)
RESOLUTIONS_MM = (0.125, 0.25, 0.5)
LOOP_GAIN = 0.2
"""Share of the error that is corrected per sample. Chosen: far from the loop's own instability."""
STEADY_SAMPLES = 30
SECONDS = 10.8
"""Chosen: time for the rise, which takes half of it, and for the samples that count."""
WALL_SAMPLES = 240
TOLERANCE = 0.25
"""Allowed difference between measured and predicted amplitude, as a share of the prediction."""


def _parameters(stiffness: float) -> Parameters:
    return (("integral", LOOP_GAIN), ("proportional", 0.0), ("tuned_at_n_m", stiffness))


def _reference(stiffness: float, resolution_mm: float) -> float:
    """Return a force some steps above loss of contact, half-way between two forces that full steps reach from zero."""
    step = stiffness * resolution_mm * 1e-3
    return (math.ceil(10.0 / step) + 2.5) * step


def jobs(seeds: int) -> list[PaperJob | CellJob]:
    """Return both models for every stiffness and resolution."""
    done: list[PaperJob | CellJob] = []
    for stiffness, resolution_mm in product(STIFFNESSES, RESOLUTIONS_MM):
        wanted, parameters = _reference(stiffness, resolution_mm), _parameters(stiffness)
        wall = PaperJob("pi", parameters, stiffness, wanted, 0, WALL_SAMPLES, resolution_mm * 1e-3, noise=0.0)
        cell = CellJob(
            "pi", parameters, 0, stiffness, wanted, SECONDS, step_mm=0.0, resolution_mm=resolution_mm
        )
        done += [wall, *(replace(cell, seed=seed) for seed in range(1, seeds + 1))]
    return done


ROUNDED = SampledPlant(PERIOD, PERIOD / 2, 100.0 / PERIOD)
"""The paper's simulation for the stability analysis: a command is reached at the next sample."""


def plant(job: CellJob, period: float) -> SampledPlant:
    """Return the chain for the stability analysis, from the profiles of the cell, without the force filter.

    Derived: the delay is a sum. It consists of half the time between two force frames, the line time of the move up to
    its last character, the controller's turnaround, half a tick of waiting for the interpolator, and its transport
    delay.
    """
    config = job.config()
    cell = settings_of(config, S3).emulated
    characters = 2 + BLOCK_OVERHEAD + cell.link.move_length
    servo = cell.servo
    waiting_ms = (settings_of(config, JR3).client.gateway.period_ms + servo.interpolation_ms) / 2.0
    delay = (
        characters * cell.link.character_time
        + (waiting_ms + cell.robot.turnaround_ms + servo.transport_delay_ms) * 1e-3
    )
    return SampledPlant(period, delay, servo.natural_frequency_rad_s, servo.damping_ratio)


def _predicted_rounding(stiffness: float, resolution: float) -> LimitCycle | None:
    """Return the prediction with rounding alone; None if there is no limit cycle."""
    try:
        return limit_cycle(stiffness, pi_response(0.0, LOOP_GAIN / stiffness), ROUNDED, Quantiser(resolution))
    except ValueError:
        return None


def _predicted_chain(job: CellJob, period: float) -> LimitCycle | None:
    """Return the prediction with the servo that holds inside its dead band; None if there is no limit cycle."""
    config = job.config()
    try:
        return holding_limit_cycle(
            job.stiffness,
            LOOP_GAIN / job.stiffness,
            plant(job, period),
            HoldingServo(
                job.resolution_mm * 1e-3, settings_of(config, S3).emulated.servo.interpolation_ms * 1e-3
            ),
            settings_of(config, JR3).client.gateway.delay,
        )
    except ValueError:
        return None


def evaluate(done: Sequence[PaperJob | CellJob], results: Sequence[Any]) -> Findings:
    """Return a row for each stiffness and resolution, and the oscillation."""
    walls: dict[tuple[float, float], PaperRun] = {}
    cells: dict[tuple[float, float], list[tuple[CellJob, CellTrace]]] = {}
    for job, result in zip(done, results, strict=True):
        if isinstance(job, PaperJob):
            walls[job.stiffness, round(job.resolution * 1e3, 6)] = result
        else:
            cells.setdefault((job.stiffness, job.resolution_mm), []).append((job, result))
    return Findings(tuple(_row(*point, walls[point], cells[point]) for point in walls))


def _row(
    stiffness: float, resolution_mm: float, wall: PaperRun, cells: Sequence[tuple[CellJob, CellTrace]]
) -> Row:
    job = cells[0][0]
    sample, _ = spread(trace.period for _, trace in cells)
    assert sample is not None, "every run has samples"
    rounding = _predicted_rounding(stiffness, resolution_mm * 1e-3)
    holding = _predicted_chain(job, sample)
    rounding_n, holding_n = (
        round_digits(cycle.peak_to_peak) if cycle else None for cycle in (rounding, holding)
    )
    simulated = float(np.ptp(wall.force[-STEADY_SAMPLES:]))
    swings = [float(np.ptp(trace.force[-STEADY_SAMPLES:])) for _, trace in cells]
    swing, swing_sd = float(np.mean(swings)), float(np.std(swings))
    period, _ = spread(_period(trace) for _, trace in cells)
    return {
        "stiffness_n_m": int(stiffness),
        "resolution_mm": resolution_mm,
        "step_force_n": round_digits(stiffness * resolution_mm * 1e-3),
        "rounding_predicted_n": rounding_n,
        "rounding_n": round_digits(simulated),
        "rounding_ratio": round_digits(simulated / rounding_n) if rounding_n else None,
        "chain_predicted_n": holding_n,
        "chain_n": round_digits(swing),
        "chain_n_sd": round_digits(swing_sd),
        "chain_ratio": round_digits(swing / holding_n) if holding_n else None,
        "chain_predicted_period_s": round_digits(holding.period) if holding else None,
        "chain_period_s": round_digits(period),
        "sample_ms": round_digits(sample * 1e3),
        "seeds": len(cells),
    }


def _period(trace: CellTrace) -> float | None:
    """Return the mean time between two upward crossings of the oscillation's centre, s; None for fewer than two."""
    force, time = trace.force[-STEADY_SAMPLES:], trace.time[-STEADY_SAMPLES:]
    above = force > (np.max(force) + np.min(force)) / 2
    rises = time[1:][~above[:-1] & above[1:]]
    return float((rises[-1] - rises[0]) / (len(rises) - 1)) if len(rises) > 1 else None


def panels(table: Sequence[Row]) -> list[Panel]:
    """Return measured and predicted oscillation over the force of a resolution step."""
    lines = [
        Line("step_force_n", "k_e·Δx_res, as the paper says", table),
        Line("rounding_predicted_n", "predicted: rounding alone", table, joined=False),
        Line("rounding_n", "simulated: rounding alone", table, joined=False),
        Line("chain_predicted_n", "predicted: servo that holds in its dead band", table, joined=False),
        Line("chain_n", "whole chain", table, joined=False),
    ]
    x = "step_force_n", "force of one resolution step, k_e·Δx_res, N"
    return [Panel("Limit cycle", x, "steady force, peak to peak, N", lines, log=True)]


def _agreement(table: Sequence[Row], model: str) -> str:
    """Return as text at how many points the amplitude of a model matches the prediction."""
    ratios = [figure(row, f"{model}_ratio") for row in table if row[f"{model}_ratio"] is not None]
    if not ratios:
        return "no limit cycle predicted"
    near = sum(abs(ratio - 1.0) <= TOLERANCE for ratio in ratios)
    span = f"{min(ratios):.2f} … {max(ratios):.2f} times as predicted"
    return f"within {TOLERANCE:.0%} at {near} of {len(table)} points, {span}"


def claims(table: Sequence[Row]) -> tuple[Claim, ...]:
    """Return the paper's claim about the amplitude, and the result here."""
    forces = np.array([figure(row, "step_force_n") for row in table])
    swings = np.array([figure(row, "chain_n") for row in table])
    simulated = np.array([figure(row, "rounding_n") for row in table]) / forces
    ratios = swings / forces
    slope, _ = np.polyfit(np.log(forces), np.log(swings), 1)
    return (
        Claim(
            "limit cycle of amplitude k_e·Δx_res",
            f"proportional to it: {verdict(0.8 < slope < 1.2)}; the factor is {simulated.min():.2f} … "
            f"{simulated.max():.2f} with rounding alone, {ratios.min():.2f} … {ratios.max():.2f} through the chain. "
            f"Measured against predicted, rounding alone: {_agreement(table, 'rounding')}; servo with dead band: "
            f"{_agreement(table, 'chain')}",
        ),
    )


ABOUT = (
    "In the paper, a constant force ends in a slow oscillation of amplitude k_e·Δx_res, because the position may be "
    "anywhere within half a step of the reported one. Here an integral controller runs with the target force half-way "
    "between two steps. With rounding alone, the prediction is the describing function of the quantised loop. Through "
    "the complete chain, the servo determines the factor. It switches off at the first tick at which the reported "
    "position is the target, so it only has to cross the border between two steps. It stops a few hundredths of a "
    "step beyond, and overshoots by the distance that it coasts while the force is sampled. The prediction simulates "
    "that loop tick by tick from the servo's frequency and damping, tick, delays, filter of the force, sample time "
    "and gain, without fitted values. A servo that continues to its set point leaves k_e·Δx_res. The ratios are "
    "measured over predicted."
)

RESOLUTION = Experiment(
    "resolution",
    "Discussion: influence of the position resolution",
    ABOUT,
    jobs,
    evaluate,
    claims,
    panels,
)
