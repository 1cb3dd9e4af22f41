"""The paper's discussion: the limit cycle that the position resolution leaves, measured and predicted.

The controller is an integral one whose loop gain is the same on every surface, so that stiffness and resolution alone
make the difference. It runs in the paper's simulation, which only rounds the position, and through the whole chain,
whose servo does not react inside its dead band. Each has its prediction.
"""

import math
from collections.abc import Sequence
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
from hil_bridge.lab.experiments.cell import CellJob, CellTrace
from hil_bridge.lab.experiments.drawing import COLOURS, MARKERS, Sheet
from hil_bridge.lab.experiments.paper_simulation import PERIOD, PaperJob, PaperRun, Parameters
from hil_bridge.lab.experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    digits,
    figure,
    round_digits,
    rows_where,
    verdict,
)
from hil_bridge.lab.experiments.statistics import spread
from hil_bridge.settings.kinds import settings_of
from protocol.devices.s3.adlp import BLOCK_OVERHEAD

STIFFNESSES = (5e3, 1e4, 2e4, 5e4)
RESOLUTIONS_MM = (0.125, 0.25, 0.5)
LOOP_GAIN = 0.2
"""Share of the error that is made up for in a sample. Chosen: far from the loop's own instability."""
STEADY_SAMPLES = 30
SECONDS = 10.8
"""Chosen: the rise, which takes half of it, and the samples that count."""
WALL_SAMPLES = 240
TOLERANCE = 0.25
"""Share of a prediction by which the measured amplitude may differ from it."""
YES, NO, NONE = "yes", "no", "no limit cycle predicted"


def _parameters(stiffness: float) -> Parameters:
    return (("integral", LOOP_GAIN), ("proportional", 0.0), ("tuned_at_n_m", stiffness))


def _reference(stiffness: float, resolution_mm: float) -> float:
    """Some steps from losing contact, and half-way between two forces that whole steps reach from zero."""
    step = stiffness * resolution_mm * 1e-3
    return (math.ceil(10.0 / step) + 2.5) * step


def jobs(seeds: int) -> list[PaperJob | CellJob]:
    """Both models for every stiffness and resolution."""
    done: list[PaperJob | CellJob] = []
    for stiffness in STIFFNESSES:
        for resolution_mm in RESOLUTIONS_MM:
            wanted = _reference(stiffness, resolution_mm)
            done.append(
                PaperJob(
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


ROUNDED = SampledPlant(PERIOD, PERIOD / 2, 100.0 / PERIOD)
"""The paper's simulation as the stability analysis sees it: a command has been followed at the next sample."""


def plant(job: CellJob, period: float) -> SampledPlant:
    """The chain as the stability analysis sees it, from the profiles of the cell; the force's filter apart.

    Derived: the delay is a sum. It begins with half the time between two force frames, the line time of the move up to
    its last character, and the controller's turnaround. To this come half a tick of waiting for the interpolator, and
    its transport delay.
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
    """With rounding alone; None where there is no limit cycle."""
    try:
        return limit_cycle(stiffness, pi_response(0.0, LOOP_GAIN / stiffness), ROUNDED, Quantiser(resolution))
    except ValueError:
        return None


def _predicted_chain(job: CellJob, period: float) -> LimitCycle | None:
    """With the servo that holds inside its dead band; None where there is no limit cycle."""
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


def agreement(measured: float, predicted: float | None) -> tuple[float | None, str]:
    """Measured over predicted amplitude, and whether it is near enough to 1."""
    if predicted is None:
        return None, NONE
    ratio = measured / predicted
    return round_digits(ratio), YES if abs(ratio - 1.0) <= TOLERANCE else NO


def evaluate(done: Sequence[Any], results: Sequence[Any]) -> Findings:
    """A row for each stiffness and resolution, and the swing over k_e·Δx_res."""
    table: list[Row] = []
    pairs = list(zip(done, results, strict=True))
    for stiffness in STIFFNESSES:
        for resolution_mm in RESOLUTIONS_MM:
            (wall,) = (
                result
                for job, result in pairs
                if isinstance(job, PaperJob)
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
    simulated_ratio, simulated_within = agreement(simulated, rounding_n)
    chain_ratio, chain_within = agreement(swing, holding_n)
    period, _ = spread(_period(trace) for _, trace in cells)
    return {
        "stiffness_n_m": int(stiffness),
        "resolution_mm": resolution_mm,
        "step_force_n": round_digits(stiffness * resolution_mm * 1e-3),
        "rounding_predicted_n": rounding_n,
        "rounding_n": round_digits(simulated),
        "rounding_ratio": simulated_ratio,
        "rounding_within_25_percent": simulated_within,
        "chain_predicted_n": holding_n,
        "chain_n": round_digits(swing),
        "chain_n_sd": round_digits(swing_sd),
        "chain_ratio": chain_ratio,
        "chain_within_25_percent": chain_within,
        "chain_predicted_period_s": round_digits(holding.period) if holding else None,
        "chain_period_s": round_digits(period),
        "sample_ms": round_digits(sample * 1e3),
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
        forces = [figure(row, "step_force_n") for row in table]
        ends = [0.8 * min(forces), 1.25 * max(forces)]
        ax.plot(ends, ends, color="black", lw=1.0, ls="--", label="k_e·Δx_res, as the paper says")
        for column, colour, name in (
            ("rounding_predicted_n", COLOURS[3], "predicted: rounding alone (describing function)"),
            ("chain_predicted_n", COLOURS[4], "predicted: servo that holds in its dead band"),
        ):
            known = [row for row in table if row[column] is not None]
            ax.errorbar(
                [figure(row, "step_force_n") for row in known],
                values := [figure(row, column) for row in known],
                [TOLERANCE * value for value in values],
                ls="none",
                marker="_",
                ms=16,
                mew=1.6,
                capsize=5,
                color=colour,
                label=f"{name}, ± {TOLERANCE:.0%}",
            )
        ax.plot(
            forces,
            [figure(row, "rounding_n") for row in table],
            ls="none",
            marker="x",
            ms=7,
            color="#606060",
            label="simulated: rounding alone",
        )
        for index, resolution in enumerate(RESOLUTIONS_MM):
            rows = rows_where(table, resolution_mm=resolution)
            ax.errorbar(
                [figure(row, "step_force_n") for row in rows],
                [figure(row, "chain_n") for row in rows],
                [figure(row, "chain_n_sd") for row in rows],
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


def _places(rows: Sequence[Row]) -> str:
    return ", ".join(
        f"{digits(row['stiffness_n_m'])} N/m at {digits(row['resolution_mm'])} mm ({digits(row['step_force_n'])} N)"
        for row in rows
    )


def _agreement(table: Sequence[Row], model: str) -> str:
    """At which points the amplitude of a model is as predicted, at which not, and where none is predicted."""
    column = f"{model}_within_25_percent"
    parts = []
    for value, title in ((YES, "within 25 %"), (NO, "farther off"), (NONE, NONE)):
        rows = rows_where(table, **{column: value})
        if not rows:
            continue
        ratios = [figure(row, f"{model}_ratio") for row in rows if row[f"{model}_ratio"] is not None]
        span = f", {min(ratios):.2f} … {max(ratios):.2f} times as predicted" if ratios else ""
        where = f"each of the {len(rows)} points" if len(rows) == len(table) else _places(rows)
        parts.append(f"{title} at {where}{span}")
    return "; ".join(parts)


def _between(values: Sequence[float], unit: str) -> str:
    if not values:
        return "none"
    low, high = digits(min(values)), digits(max(values))
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def _known(table: Sequence[Row], column: str) -> list[float]:
    return [figure(row, column) for row in table if row[column] is not None]


def describe(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """The paper's claim about the amplitude, and the result here."""
    forces = _known(table, "step_force_n")
    ratios = [figure(row, "chain_n") / figure(row, "step_force_n") for row in table]
    simulated = [figure(row, "rounding_n") / figure(row, "step_force_n") for row in table]
    slope, _ = np.polyfit(np.log(forces), np.log(_known(table, "chain_n")), 1)
    text = (
        f"The paper says that a constant force ends in a slow oscillation of amplitude k_e·Δx_res, because "
        f"the position may be anywhere within half a step of the reported one. Over {len(table)} "
        f"combinations of stiffness and resolution, k_e·Δx_res from {digits(min(forces))} to "
        f"{digits(max(forces))} N, an integral controller was left alone with the force half-way between two "
        f"steps. With rounding alone the peak-to-peak is {min(simulated):.2f} to {max(simulated):.2f} times "
        f"k_e·Δx_res; against the describing function of the quantised loop it is "
        f"{_agreement(table, 'rounding')}. Through the whole chain it is {min(ratios):.2f} to "
        f"{max(ratios):.2f} times k_e·Δx_res, on average {np.mean(ratios):.2f}, and grows with the power "
        f"{slope:.2f} of it: the proportionality is {verdict(0.8 < slope < 1.2)}. The factor is the servo's. "
        f"It turns itself off at the first tick at which the reported position is the wanted one, so on the "
        f"way between two steps it has only to cross the border between them: it is held a few hundredths of "
        f"a step beyond, and swings through by what it coasts while the force is sampled. Stepped from tick "
        f"to tick, that loop is predicted from the servo's frequency and damping, tick, delays, filter of "
        f"the force, sample time and gain, without anything fitted; against it the measured swing is "
        f"{_agreement(table, 'chain')}. k_e·Δx_res is what a servo leaves that goes on to its set point. The "
        f"oscillation's period is {_between(_known(table, 'chain_period_s'), 's')}, predicted "
        f"{_between(_known(table, 'chain_predicted_period_s'), 's')}, at "
        f"{digits(figure(table[0], 'sample_ms'))} ms a sample. The columns of ratios are measured over "
        f"predicted."
    )
    claim = Claim(
        "limit cycle of amplitude k_e·Δx_res",
        f"proportional to it: {verdict(0.8 < slope < 1.2)}; the factor is {min(simulated):.2f} … "
        f"{max(simulated):.2f} with rounding alone, {min(ratios):.2f} … {max(ratios):.2f} through the chain. "
        f"Measured against predicted, rounding alone: {_agreement(table, 'rounding')}; servo with dead band: "
        f"{_agreement(table, 'chain')}",
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
        "rounding_predicted_n",
        "rounding_n",
        "rounding_within_25_percent",
        "chain_predicted_n",
        "chain_n",
        "chain_n_sd",
        "chain_ratio",
        "chain_within_25_percent",
        "chain_predicted_period_s",
        "chain_period_s",
    ),
)
