"""Figs. 7 to 11: tracking a flat sponge and a curved contour through the complete chain."""

from collections.abc import Sequence

import numpy as np

from hil_bridge.lab.drawing import Panel, lines_by
from paper_experiments.cell import CellJob, CellTrace
from paper_experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    columns_of,
    digits,
    figure,
    mean_merits,
    only_row,
    round_digits,
    spread,
    verdict,
)

BEST = "predictive"
CONTROLLERS = ("fuzzy", "fuzzy-adaptive", BEST)
NORMAL = "predictive along the estimated normal"
REFERENCE_N = 10.0
STIFFNESS = 5000.0
FLAT_SECONDS, CONTOUR_SECONDS = 20.0, 40.0
"""Chosen: a hundred samples on the flat sponge, more than a period of the contour."""
SHOWN_SECONDS = 10.0
"""Part of the flat sponge shown in the picture; nothing new happens later."""
SETTLING_S = 4.0
"""Time after contact that does not count as tracking. Chosen: more than twice the slowest rise."""
ABOUT_FLAT = (
    "In the paper, the fuzzy controller without adaptation reaches and holds 10 N on a flat sponge of about 5 000 "
    "N/m, at 1 mm a sample (Fig. 7). The adaptive controller responds faster, and the estimator works as expected "
    "(Fig. 8). The text does not state the time axis, so the rise cannot be compared in seconds. Fixed gains stop "
    "because Table 1 treats an error below 5 % of the desired force as small, and the output of Table 3 for a small "
    "error is zero. The reported position lags and is rounded, and force and position are sampled at different times; "
    f"the paper's eq. (4) includes neither. {BEST} is the project's own controller."
)
ABOUT_CONTOUR = (
    "The paper shows the executed contour (Fig. 9) and the force without (Fig. 10) and with adaptation (Fig. 11), "
    "without dimensions. Here the sponge is a wave of 10 mm amplitude and 200 mm period. On the steepest part, the "
    "surface moves by 0.31 mm a sample under the tool, so an integrating controller needs a permanent error to "
    "command that motion at every sample. There eq. (4) mistakes the force caused by the surface for a response to "
    "the robot's motion. All rows except the last control the force along a fixed direction, as the paper does. The "
    "last row controls it along the normal estimated from motion and force."
)


def jobs(controllers: Sequence[str], contour: bool, seeds: int) -> list[CellJob]:
    """Return every controller over the same sponge, for seeds 1, 2, …"""
    return [
        CellJob(
            BEST if name == NORMAL else name,
            (),
            seed,
            STIFFNESS,
            REFERENCE_N,
            CONTOUR_SECONDS if contour else FLAT_SECONDS,
            contour=contour,
            approach_step_mm=0.5,  # the default of a run: the sponge is soft
            follow_normal=name == NORMAL,
        )
        for name in controllers
        for seed in range(1, seeds + 1)
    ]


def evaluate(done: Sequence[CellJob], results: Sequence[CellTrace]) -> Findings:
    """Return a row for each controller, and the curves of its first seed."""
    groups: dict[str, list[CellTrace]] = {}
    for job, result in zip(done, results, strict=True):
        groups.setdefault(NORMAL if job.follow_normal else job.controller, []).append(result)
    table = tuple(_row(name, traces) for name, traces in groups.items())
    return Findings(table, tuple(row for name, traces in groups.items() for row in _curves(name, traces[0])))


def _row(name: str, traces: Sequence[CellTrace]) -> Row:
    errors = [trace.force[trace.time >= SETTLING_S] - REFERENCE_N for trace in traces]
    tracking, tracking_sd = spread(
        float(np.sqrt(np.mean(error**2))) if error.size else None for error in errors
    )
    worst, _ = spread(float(np.max(np.abs(error))) if error.size else None for error in errors)
    estimate, _ = spread(_last_estimate(trace) for trace in traces)
    return {
        "controller": name,
        **mean_merits([trace.merit for trace in traces]),
        "tracking_rms_n": round_digits(tracking),
        "tracking_rms_n_sd": round_digits(tracking_sd),
        "worst_error_n": round_digits(worst),
        "stiffness_estimate_n_m": round_digits(estimate),
        "period_ms": round_digits(spread(trace.period * 1e3 for trace in traces)[0]),
        "completed": sum(trace.completed for trace in traces),
    }


def _last_estimate(trace: CellTrace) -> float | None:
    """Return the estimated stiffness at the end, N/m."""
    return float(trace.stiffness[-1]) if trace.stiffness.size and np.isfinite(trace.stiffness[-1]) else None


def _curves(name: str, trace: CellTrace) -> list[Row]:
    return [
        {
            "controller": name,
            "time_s": round(float(trace.time[k]), 4),
            "force_n": round(float(trace.force[k]), 4),
            "depth_mm": round(float(trace.depth[k]) * 1e3, 4),
            "travel_mm": round(float(trace.travel[k]) * 1e3, 4),
            "stiffness_n_m": None if np.isnan(trace.stiffness[k]) else round_digits(trace.stiffness[k]),
        }
        for k in range(len(trace.time))
    ]


_TIME = ("time_s", "time since contact, s")
_FORCE = "contact force, N"


def panels_flat(curves: Sequence[Row]) -> list[Panel]:
    """Return panels of the force over time, and of the stiffness estimate if there is one."""
    shown = [row for row in curves if figure(row, "time_s") <= SHOWN_SECONDS]
    panels = [Panel("Force", _TIME, _FORCE, lines_by(shown, "controller", "force_n"), REFERENCE_N)]
    if any(row["stiffness_n_m"] is not None for row in shown):
        lines = lines_by(shown, "controller", "stiffness_n_m")
        panels.append(Panel("Stiffness estimate", _TIME, "stiffness, N/m", lines, STIFFNESS))
    return panels


def panels_contour(curves: Sequence[Row]) -> list[Panel]:
    """Return panels of the force over time, and of the executed contour."""
    return [
        Panel("Force", _TIME, _FORCE, lines_by(curves, "controller", "force_n"), REFERENCE_N),
        Panel(
            "Contour",
            ("travel_mm", "travel along the surface, mm"),
            "depth of the tool tip below the start point, mm",
            lines_by(curves, "controller", "depth_mm"),
        ),
    ]


def claims_flat(table: Sequence[Row]) -> tuple[Claim, ...]:
    """Return the claims about the flat sponge, without and with adaptation."""
    fixed, adapted, best = (only_row(table, controller=name) for name in CONTROLLERS)
    holds = abs(figure(fixed, "steady_mean_error_n")) <= STIFFNESS * 0.125e-3
    rise = figure(fixed, "rise_samples")
    faster, best_faster = (rise / figure(row, "rise_samples") for row in (adapted, best))
    return (
        Claim(
            "the fuzzy controller holds 10 N on a sponge",
            f"rise {digits(rise)} samples, steady error {digits(fixed['steady_mean_error_n'])} N: {verdict(holds)}",
        ),
        Claim(
            "with adaptation the response on the sponge is faster",
            f"{faster:.1f} times: {verdict(faster > 1.2)}; {BEST} {best_faster:.1f} times",
        ),
        Claim(
            "the environment estimator works as expected",
            f"it ends at {digits(adapted['stiffness_estimate_n_m'])} N/m on {digits(STIFFNESS)} N/m",
        ),
    )


def claims_contour(table: Sequence[Row]) -> tuple[Claim, ...]:
    """Return the claims about the contour, without and with adaptation."""
    fixed, adapted, best = (only_row(table, controller=name) for name in CONTROLLERS)
    error, losses = figure(fixed, "tracking_rms_n"), figure(fixed, "contact_losses")
    ratio, best_ratio = (figure(row, "tracking_rms_n") / error for row in (adapted, best))
    return (
        Claim(
            "a curved contour is tracked without adaptation",
            f"{digits(error)} N RMS, {digits(losses)} contact losses: {verdict(losses == 0)}",
        ),
        Claim(
            "adaptation improves the force on a contour",
            f"RMS error {ratio:.2f} times that of fixed gains: {verdict(ratio < 0.95)}; {BEST} "
            f"{best_ratio:.2f} times",
        ),
    )


FLAT = Experiment(
    "fig7-8",
    "Figs. 7 and 8: flat sponge",
    ABOUT_FLAT,
    lambda seeds: jobs(CONTROLLERS, False, seeds),
    evaluate,
    claims_flat,
    panels_flat,
    columns_of(
        "controller",
        "rise_samples",
        "rise_samples_sd",
        "overshoot_percent",
        "steady_mean_error_n",
        "steady_peak_to_peak_n",
        "steps_per_s",
        "stiffness_estimate_n_m",
    ),
)
CONTOUR = Experiment(
    "fig9-11",
    "Figs. 9 to 11: curved contour",
    ABOUT_CONTOUR,
    lambda seeds: jobs((*CONTROLLERS, NORMAL), True, seeds),
    evaluate,
    claims_contour,
    panels_contour,
    columns_of(
        "controller",
        "tracking_rms_n",
        "tracking_rms_n_sd",
        "worst_error_n",
        "contact_losses",
        "largest_force_n",
        "stiffness_estimate_n_m",
    ),
)
