"""Figs. 7 to 11: tracking a flat sponge and a curved contour through the whole chain."""

from collections.abc import Sequence

import numpy as np

from hil_bridge.lab.experiments.cell import CellJob, CellTrace, Floats
from hil_bridge.lab.experiments.drawing import COLOURS, GREY, Sheet
from hil_bridge.lab.experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    digits,
    figure,
    only_row,
    round_digits,
    verdict,
)
from hil_bridge.lab.experiments.statistics import figures, spread

FIXED, ADAPTED, BEST = "fuzzy", "fuzzy-adaptive", "predictive"
NORMAL = "predictive along the estimated normal"
REFERENCE_N = 10.0
STIFFNESS = 5000.0
FLAT_SECONDS, CONTOUR_SECONDS = 20.0, 40.0
"""Chosen: a hundred samples on the flat sponge, more than a period of the contour."""
SHOWN_SECONDS = 10.0
"""Part of the flat sponge that the picture shows; nothing new happens later."""


def jobs(controllers: Sequence[str], contour: bool, seeds: int) -> list[CellJob]:
    """Every controller over the same sponge, for seeds 1, 2, …"""
    duration = CONTOUR_SECONDS if contour else FLAT_SECONDS
    return [
        CellJob(
            BEST if name == NORMAL else name,
            (),
            seed,
            STIFFNESS,
            REFERENCE_N,
            duration,
            contour=contour,
            approach_step_mm=0.5,  # the default of a run: the sponge is soft
            follow_normal=name == NORMAL,
        )
        for name in controllers
        for seed in range(1, seeds + 1)
    ]


def _groups(done: Sequence[CellJob], results: Sequence[CellTrace]) -> dict[str, list[CellTrace]]:
    groups: dict[str, list[CellTrace]] = {}
    for job, result in zip(done, results, strict=True):
        groups.setdefault(NORMAL if job.follow_normal else job.controller, []).append(result)
    return groups


def _row(name: str, traces: Sequence[CellTrace]) -> Row:
    tracking, tracking_sd = spread(_tracking_error(trace) for trace in traces)
    worst, _ = spread(_worst_error(trace) for trace in traces)
    estimate, _ = spread(_last_estimate(trace) for trace in traces)
    return {
        "controller": name,
        **figures([trace.merit for trace in traces]),
        "tracking_rms_n": round_digits(tracking),
        "tracking_rms_n_sd": round_digits(tracking_sd),
        "worst_error_n": round_digits(worst),
        "stiffness_estimate_n_m": round_digits(estimate),
        "period_ms": round_digits(spread(trace.period * 1e3 for trace in traces)[0]),
        "completed": sum(trace.completed for trace in traces),
    }


SETTLING_S = 4.0
"""Time after contact that does not count as tracking. Chosen: more than twice the rise of the slowest."""


def _settled(trace: CellTrace) -> Floats:
    """Force error after the rise, N."""
    return trace.force[trace.time >= SETTLING_S] - REFERENCE_N


def _tracking_error(trace: CellTrace) -> float | None:
    """RMS of the force error after the rise, N."""
    error = _settled(trace)
    return float(np.sqrt(np.mean(error**2))) if error.size else None


def _worst_error(trace: CellTrace) -> float | None:
    error = _settled(trace)
    return float(np.max(np.abs(error))) if error.size else None


def _last_estimate(trace: CellTrace) -> float | None:
    """The stiffness at the end, N/m."""
    return float(trace.stiffness[-1]) if trace.stiffness.size and np.isfinite(trace.stiffness[-1]) else None


def _series(groups: dict[str, list[CellTrace]]) -> tuple[Row, ...]:
    return tuple(
        {
            "controller": name,
            "time_s": round(float(trace.time[k]), 4),
            "force_n": round(float(trace.force[k]), 4),
            "depth_mm": round(float(trace.depth[k]) * 1e3, 4),
            "travel_mm": round(float(trace.travel[k]) * 1e3, 4),
            "stiffness_n_m": None
            if np.isnan(trace.stiffness[k])
            else round_digits(float(trace.stiffness[k])),
        }
        for name, traces in groups.items()
        for trace in traces[:1]
        for k in range(len(trace.time))
    )


def evaluate_flat(done: Sequence[CellJob], results: Sequence[CellTrace]) -> Findings:
    """Force over time, and below it the stiffness estimate where there is one."""
    groups = _groups(done, results)
    table = tuple(_row(name, traces) for name, traces in groups.items())
    estimating = any(np.isfinite(trace.stiffness).any() for traces in groups.values() for trace in traces)
    rows = 2 if estimating else 1
    ratios = [2.2, 1.0][:rows]
    with Sheet(9.0, 3.2 + 1.8 * (rows - 1), rows, sharex=True, height_ratios=ratios) as sheet:
        _draw_force(sheet, groups)
        if estimating:
            ax = sheet.axes[1]
            ax.axhline(STIFFNESS, color="black", lw=1.0, ls="--")
            for colour, traces in zip(COLOURS, groups.values(), strict=False):
                ax.plot(traces[0].time, traces[0].stiffness, color=colour, lw=1.3)
            ax.set_yscale("log")
            ax.set_ylim(1e3, 3e4)
            ax.set_ylabel("stiffness\nestimate, N/m")
        sheet.axes[-1].set_xlim(-0.2, SHOWN_SECONDS)
        sheet.axes[-1].set_xlabel("time since contact, s")
        picture = sheet.png()
    return Findings(table, picture, _series(groups), REFERENCE_N)


def _draw_force(sheet: Sheet, groups: dict[str, list[CellTrace]]) -> None:
    """First axes: force of the first seed, the other seeds fainter behind it."""
    ax = sheet.axes[0]
    ax.axhline(REFERENCE_N, color="black", lw=1.0, ls="--", label="desired")
    for colour, (name, traces) in zip(COLOURS, groups.items(), strict=False):
        for trace in traces[1:]:
            ax.plot(trace.time, trace.force, color=colour, lw=0.6, alpha=0.25)
        ax.plot(traces[0].time, traces[0].force, color=colour, lw=1.3, marker=".", ms=3.5, label=name)
    ax.set_ylabel("contact force, N")
    ax.set_ylim(bottom=0.0)
    ax.legend(loc="lower right", ncols=4)


def evaluate_contour(done: Sequence[CellJob], results: Sequence[CellTrace]) -> Findings:
    """Force over time, and below it the contour that was executed."""
    groups = _groups(done, results)
    table = tuple(_row(name, traces) for name, traces in groups.items())
    with Sheet(9.0, 5.4, 2, height_ratios=(1.6, 1.0)) as sheet:
        _draw_force(sheet, groups)
        sheet.axes[0].set_xlabel("time since contact, s")
        ax = sheet.axes[1]
        for colour, (name, traces) in zip(COLOURS, groups.items(), strict=False):
            ax.plot(traces[0].travel * 1e3, -traces[0].depth * 1e3, color=colour, lw=1.3, label=name)
        ax.set_xlabel("travel along the surface, mm")
        ax.set_ylabel("height of the\ntool tip, mm")
        ax.text(
            0.99,
            0.94,
            "from the start point, up is away from the sponge",
            transform=ax.transAxes,
            ha="right",
            va="top",
            color=GREY,
            fontsize=8.5,
        )
        picture = sheet.png()
    return Findings(table, picture, _series(groups), REFERENCE_N)


def describe_fig7(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """The flat sponge without adaptation."""
    row = only_row(table, controller=FIXED)
    text = (
        f"The paper shows that the fuzzy controller without adaptation reaches and holds {REFERENCE_N:g} N "
        f"on a flat sponge of about {digits(STIFFNESS)} N/m, at 1 mm a sample. Through the emulated chain, "
        f"at {digits(row['period_ms'])} ms a sample, it takes {digits(row['rise_samples'])} samples to 90 % "
        f"(spread {digits(row['rise_samples_sd'])} over {row['seeds']} seeds), overshoots by "
        f"{digits(row['overshoot_percent'])} % and rests at a mean error of {digits(row['steady_mean_error_n'])} "
        f"N, with {digits(row['steady_peak_to_peak_n'])} N peak to peak and {digits(row['contact_losses'])} "
        f"contact losses. It rests because Table 1 takes an error below 5 % of the desired force for small "
        f"and Table 3 answers small with nothing; one resolution step is worth "
        f"{digits(STIFFNESS * 0.125e-3)} N here. The paper prints no time axis in words, so the rise cannot "
        f"be compared in seconds."
    )
    claim = Claim(
        "the fuzzy controller holds 10 N on a sponge",
        f"rise {digits(row['rise_samples'])} samples, steady error "
        f"{digits(row['steady_mean_error_n'])} N: "
        + verdict(abs(figure(row, "steady_mean_error_n")) <= STIFFNESS * 0.125e-3),
    )
    return text, (claim,)


def describe_fig8(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """The flat sponge with adaptation."""
    fixed, adapted, best = (only_row(table, controller=name) for name in (FIXED, ADAPTED, BEST))
    faster = figure(fixed, "rise_samples") / figure(adapted, "rise_samples")
    word = "faster" if faster > 1.05 else "no faster"
    better = figure(fixed, "rise_samples") / figure(best, "rise_samples")
    estimate = figure(adapted, "stiffness_estimate_n_m") / STIFFNESS
    text = (
        f"The paper says that the adaptive controller responds faster than the fixed one and that the "
        f"estimator works as expected. It came out {word}: {digits(adapted['rise_samples'])} samples to 90 % "
        f"against {digits(fixed['rise_samples'])}, a factor of {faster:.1f}. The estimate ends at "
        f"{digits(adapted['stiffness_estimate_n_m'])} N/m, {estimate:.2f} times the stiffness of the sponge; "
        f"the reported position lags and is rounded, and the force is sampled at another moment than the "
        f"position, which the paper's eq. (4) does not know. Overshoot is "
        f"{digits(adapted['overshoot_percent'])} %, against {digits(fixed['overshoot_percent'])} % with fixed "
        f"gains; the steady force swings by {digits(adapted['steady_peak_to_peak_n'])} N against "
        f"{digits(fixed['steady_peak_to_peak_n'])} N. The project's own controller, {BEST}, takes "
        f"{digits(best['rise_samples'])} samples ({better:.1f} times faster than fixed gains), overshoots by "
        f"{digits(best['overshoot_percent'])} % and leaves {digits(best['steady_peak_to_peak_n'])} N peak to "
        f"peak at a mean error of {digits(best['steady_mean_error_n'])} N."
    )
    claims = (
        Claim(
            "with adaptation the response on the sponge is faster",
            f"{faster:.1f} times: {verdict(faster > 1.2)}",
        ),
        Claim(
            "the environment estimator works as expected",
            f"it ends at {digits(adapted['stiffness_estimate_n_m'])} N/m on {digits(STIFFNESS)} N/m",
        ),
    )
    return text, claims


def describe_fig9(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """The contour without adaptation."""
    row = only_row(table, controller=FIXED)
    slope = np.pi * 2 * 10.0 / 200.0
    text = (
        f"The paper shows the contour that was executed (Fig. 9) and the force without adaptation (Fig. "
        f"10), without dimensions; here the sponge is a wave of 10 mm amplitude and 200 mm period. After "
        f"the rise the force is off by {digits(row['tracking_rms_n'])} N RMS and at worst by "
        f"{digits(row['worst_error_n'])} N, with {digits(row['contact_losses'])} contact losses. On the "
        f"steepest part the surface moves by {slope:.2f} mm a sample under the tool, so an integrating "
        f"controller must be off by as much as it takes to command that move at every sample: the error "
        f"follows the slope of the contour."
    )
    claim = Claim(
        "a curved contour is tracked without adaptation",
        f"{digits(row['tracking_rms_n'])} N RMS, {digits(row['contact_losses'])} contact losses: "
        + verdict(figure(row, "contact_losses") == 0),
    )
    return text, (claim,)


def describe_fig11(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """The contour with adaptation."""
    fixed, adapted, best, normal = (
        only_row(table, controller=name) for name in (FIXED, ADAPTED, BEST, NORMAL)
    )
    ratio = figure(adapted, "tracking_rms_n") / figure(fixed, "tracking_rms_n")
    best_ratio = figure(best, "tracking_rms_n") / figure(fixed, "tracking_rms_n")
    text = (
        f"The paper shows the same contour with adaptation and calls it better. Here the RMS force error is "
        f"{digits(adapted['tracking_rms_n'])} N with the paper's adaptation against "
        f"{digits(fixed['tracking_rms_n'])} N without ({ratio:.2f} times), at worst "
        f"{digits(adapted['worst_error_n'])} N against {digits(fixed['worst_error_n'])} N, with "
        f"{digits(adapted['contact_losses'])} and {digits(fixed['contact_losses'])} contact losses. The "
        f"estimate ends at {digits(adapted['stiffness_estimate_n_m'])} N/m: on a slope the surface itself "
        f"moves between two samples, and eq. (4) takes the force that this makes for an answer to the "
        f"robot's move. The project's own controller, {BEST}, is off by {digits(best['tracking_rms_n'])} N "
        f"RMS ({best_ratio:.2f} times fixed gains), at worst by {digits(best['worst_error_n'])} N. All these control "
        f"the force along a fixed direction, as the paper does. Along the normal that is estimated from motion and "
        f"force, {BEST} is off by {digits(normal['tracking_rms_n'])} N RMS of the normal force, at worst by "
        f"{digits(normal['worst_error_n'])} N, and the tool keeps its speed along the surface."
    )
    claim = Claim(
        "adaptation improves the force on a contour",
        f"RMS error {ratio:.2f} times that of fixed gains: {verdict(ratio < 0.95)}; {BEST} "
        f"{best_ratio:.2f} times",
    )
    return text, (claim,)


_FLAT = (
    "controller",
    "rise_samples",
    "rise_samples_sd",
    "overshoot_percent",
    "steady_mean_error_n",
    "steady_peak_to_peak_n",
    "steps_per_s",
    "stiffness_estimate_n_m",
)
_CONTOUR = (
    "controller",
    "tracking_rms_n",
    "tracking_rms_n_sd",
    "worst_error_n",
    "contact_losses",
    "largest_force_n",
    "stiffness_estimate_n_m",
)
_ALL = (FIXED, ADAPTED, BEST)

TRACKING = (
    Experiment(
        "fig7",
        "Fig. 7: flat sponge without adaptation",
        lambda seeds: jobs((FIXED,), False, seeds),
        evaluate_flat,
        describe_fig7,
        _FLAT,
    ),
    Experiment(
        "fig8",
        "Fig. 8: flat sponge with adaptation",
        lambda seeds: jobs(_ALL, False, seeds),
        evaluate_flat,
        describe_fig8,
        _FLAT,
    ),
    Experiment(
        "fig9-10",
        "Figs. 9 and 10: curved contour without adaptation",
        lambda seeds: jobs((FIXED,), True, seeds),
        evaluate_contour,
        describe_fig9,
        _CONTOUR,
    ),
    Experiment(
        "fig11",
        "Fig. 11: curved contour with adaptation",
        lambda seeds: jobs((*_ALL, NORMAL), True, seeds),
        evaluate_contour,
        describe_fig11,
        _CONTOUR,
    ),
)
