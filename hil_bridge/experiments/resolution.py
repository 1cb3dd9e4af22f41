"""The paper's discussion: the limit cycle that the position resolution leaves, measured and predicted.

The controller is an integral one whose loop gain is the same on every surface, so that stiffness and
resolution alone make the difference: in the paper's simulation, where the position is rounded and nothing
else, and through the whole chain, whose servo does not react inside its dead band.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hil_bridge.control.stability import SampledPlant, limit_cycle, pi_response
from hil_bridge.experiments.cell import CellJob, CellTrace
from hil_bridge.experiments.drawing import COLOURS, MARKERS, Sheet
from hil_bridge.experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    number,
    pick,
    rounded,
    shown,
    verdict,
)
from hil_bridge.experiments.statistics import spread
from hil_bridge.experiments.wall import Parameters, WallJob, WallRun
from protocol.adlp import BLOCK_OVERHEAD

STIFFNESSES = (5e3, 1e4, 2e4, 5e4)
RESOLUTIONS_MM = (0.125, 0.25, 0.5)
LOOP_GAIN = 0.2
"""Share of the error that is made up for in a sample. Chosen: far from the loop's own instability."""
STEADY_SAMPLES = 80
SECONDS = 24.0
WALL_SAMPLES = 240


def _parameters(stiffness: float) -> Parameters:
    return (("integral", LOOP_GAIN), ("proportional", 0.0), ("tuned_at_n_m", stiffness))


def _reference(stiffness: float, resolution_mm: float) -> float:
    """Some steps from losing contact, and half-way between two forces that whole steps reach from zero."""
    step = stiffness * resolution_mm * 1e-3
    return (math.ceil(10.0 / step) + 2.5) * step


def jobs(seeds: int) -> list[WallJob | CellJob]:
    """Both models for every stiffness and resolution."""
    done: list[WallJob | CellJob] = []
    for stiffness in STIFFNESSES:
        for resolution_mm in RESOLUTIONS_MM:
            wanted = _reference(stiffness, resolution_mm)
            done.append(
                WallJob(
                    "pi",
                    _parameters(stiffness),
                    stiffness,
                    wanted,
                    0,
                    WALL_SAMPLES,
                    resolution_mm * 1e-3,
                    noise=0.0,
                )
            )
            done += [
                CellJob(
                    "pi",
                    _parameters(stiffness),
                    seed,
                    stiffness,
                    wanted,
                    SECONDS,
                    step_mm=0.0,
                    resolution_mm=resolution_mm,
                )
                for seed in range(1, seeds + 1)
            ]
    return done


def plant(job: CellJob, period: float) -> SampledPlant:
    """The loop as the stability analysis sees it, from the emulated cell's profile.

    Derived: the delay is the line time of the move up to its last character, a tick and a half of the
    interpolator, and its transport delay.
    """
    cell = job.config().cell
    characters = 2 + BLOCK_OVERHEAD + cell.link.move_length
    servo = cell.servo
    delay = (
        characters * cell.link.character_time
        + (1.5 * servo.interpolation_ms + servo.transport_delay_ms) * 1e-3
    )
    return SampledPlant(period, delay, servo.natural_frequency_rad_s, servo.damping_ratio)


def evaluate(done: Sequence[Any], results: Sequence[Any]) -> Findings:
    """A row for each stiffness and resolution, and the swing over k_e·Δx_res."""
    table: list[Row] = []
    pairs = list(zip(done, results, strict=True))
    for stiffness in STIFFNESSES:
        for resolution_mm in RESOLUTIONS_MM:
            (wall,) = (
                result
                for job, result in pairs
                if isinstance(job, WallJob)
                and job.stiffness == stiffness
                and round(job.resolution * 1e3, 6) == resolution_mm
            )
            cells = [
                (job, result)
                for job, result in pairs
                if isinstance(job, CellJob)
                and (job.stiffness, job.resolution_mm) == (stiffness, resolution_mm)
            ]
            table.append(_row(stiffness, resolution_mm, wall, cells))
    return Findings(tuple(table), _draw(table))


def _row(
    stiffness: float, resolution_mm: float, wall: WallRun, cells: Sequence[tuple[CellJob, CellTrace]]
) -> Row:
    job, trace = cells[0]
    predicted = limit_cycle(
        stiffness, pi_response(0.0, LOOP_GAIN / stiffness), plant(job, trace.period), resolution_mm * 1e-3
    )
    swing, swing_sd = spread(float(np.ptp(trace.force[-STEADY_SAMPLES:])) for _, trace in cells)
    period, _ = spread(_period(trace) for _, trace in cells)
    return {
        "stiffness_n_m": int(stiffness),
        "resolution_mm": resolution_mm,
        "step_force_n": rounded(stiffness * resolution_mm * 1e-3),
        "predicted_n": rounded(predicted.peak_to_peak),
        "simulated_n": rounded(float(np.ptp(wall.force[-STEADY_SAMPLES:]))),
        "chain_n": rounded(swing),
        "chain_n_sd": rounded(swing_sd),
        "predicted_period_s": rounded(predicted.period),
        "chain_period_s": rounded(period),
        "sample_ms": rounded(spread(trace.period * 1e3 for _, trace in cells)[0]),
        "seeds": len(cells),
    }


def _period(trace: CellTrace) -> float | None:
    """Mean time between two upward passages through the middle of the swing, s; None for fewer than two."""
    force, time = trace.force[-STEADY_SAMPLES:], trace.time[-STEADY_SAMPLES:]
    above = force > (np.max(force) + np.min(force)) / 2
    rises = time[1:][~above[:-1] & above[1:]]
    return float((rises[-1] - rises[0]) / (len(rises) - 1)) if len(rises) > 1 else None


def _draw(table: Sequence[Row]) -> bytes:
    with Sheet(7.6, 5.2) as sheet:
        (ax,) = sheet.axes
        forces = [number(row, "step_force_n") for row in table]
        ends = [0.8 * min(forces), 1.25 * max(forces)]
        ax.plot(ends, ends, color="black", lw=1.0, ls="--", label="k_e·Δx_res, as the paper says")
        ax.plot(
            forces,
            [number(row, "predicted_n") for row in table],
            ls="none",
            marker="_",
            ms=16,
            mew=1.6,
            color=COLOURS[3],
            label="predicted (describing function, servo)",
        )
        ax.plot(
            forces,
            [number(row, "simulated_n") for row in table],
            ls="none",
            marker="x",
            ms=7,
            color="#606060",
            label="simulated: rounding alone",
        )
        for index, resolution in enumerate(RESOLUTIONS_MM):
            rows = pick(table, resolution_mm=resolution)
            ax.errorbar(
                [number(row, "step_force_n") for row in rows],
                [number(row, "chain_n") for row in rows],
                [number(row, "chain_n_sd") for row in rows],
                ls="none",
                marker=MARKERS[index],
                ms=7,
                capsize=3,
                color=COLOURS[index],
                label=f"whole chain, Δx_res = {resolution:g} mm",
            )
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel("force of one resolution step, k_e·Δx_res, N")
        ax.set_ylabel("steady force, peak to peak, N")
        ax.legend(loc="upper left")
        return sheet.png()


def describe(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """What the paper says of the amplitude, and what came out."""
    ratios = [number(row, "chain_n") / number(row, "step_force_n") for row in table]
    simulated = [number(row, "simulated_n") / number(row, "step_force_n") for row in table]
    predicted = [number(row, "chain_n") / number(row, "predicted_n") for row in table]
    slope, _ = np.polyfit(
        np.log([number(row, "step_force_n") for row in table]),
        np.log([number(row, "chain_n") for row in table]),
        1,
    )
    periods = [number(row, "chain_period_s") for row in table if row["chain_period_s"] is not None]
    text = (
        f"The paper says that a constant force ends in a slow oscillation of amplitude k_e·Δx_res, because "
        f"the position may be anywhere within half a step of the reported one. Over {len(table)} "
        f"combinations of stiffness and resolution, k_e·Δx_res from "
        f"{shown(min(number(row, 'step_force_n') for row in table))} to "
        f"{shown(max(number(row, 'step_force_n') for row in table))} N, an integral controller ends in one. "
        f"With rounding alone its peak-to-peak is {min(simulated):.2f} to {max(simulated):.2f} times "
        f"k_e·Δx_res. Through the whole chain it is {min(ratios):.2f} to {max(ratios):.2f} times, on "
        f"average {np.mean(ratios):.2f}, and grows with the power {slope:.2f} of it: the proportionality is "
        f"{verdict(0.8 < slope < 1.2)}. Against the describing function, which knows the servo's lag, it is "
        f"{min(predicted):.2f} to {max(predicted):.2f} times as large. The reason is the dead band: the "
        f"servo turns itself off as soon as the reported position is the wanted one, so on the way between "
        f"two steps it has only to cross the border between them, and the tool moves by what it passes that "
        f"border, and coasts, before the next tick stops it. k_e·Δx_res is what a servo leaves that goes on "
        f"to its set point. The oscillation's period is {shown(min(periods))} to {shown(max(periods))} s, at "
        f"{shown(number(table[0], 'sample_ms'))} ms a sample; predicted are "
        f"{shown(min(number(row, 'predicted_period_s') for row in table))} s, the slowest of the cycles "
        f"that sampling allows with less than a sample of delay."
        if periods
        else "No oscillation was found in any combination of stiffness and resolution, against the paper."
    )
    claim = Claim(
        "limit cycle of amplitude k_e·Δx_res",
        f"proportional to it: {verdict(0.8 < slope < 1.2)}; the factor is {np.mean(ratios):.2f} through the chain "
        f"({min(ratios):.2f} … {max(ratios):.2f}), {min(simulated):.2f} … {max(simulated):.2f} with rounding alone",
    )
    return text, (claim,)


RESOLUTION = Experiment(
    "resolution",
    "Discussion: influence of the position resolution",
    jobs,
    evaluate,
    describe,
    (
        "stiffness_n_m",
        "resolution_mm",
        "step_force_n",
        "predicted_n",
        "simulated_n",
        "chain_n",
        "chain_n_sd",
        "predicted_period_s",
        "chain_period_s",
    ),
)
