"""Page sections on the stability of the loop and on the controller's decisions."""

import math
from html import escape

from hil_bridge.record.analysis.definition import concise
from hil_bridge.record.analysis.summary import Summary
from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.facts import start_time
from hil_bridge.show.pages import room
from hil_bridge.show.report.decision_tables import decisions, select_tracked, strongest_rules
from hil_bridge.show.report.figures import Row
from hil_bridge.show.report.loop_charts import loop_charts
from hil_bridge.show.report.markup import cells, rows
from hil_bridge.show.report.stability import (
    GAIN_MARGIN,
    PHASE_MARGIN_DEG,
    SUBSTITUTE_GAIN,
    Analysis,
    LinearLoop,
    analyse,
)

_PREDICTED_RATIO = (0.5, 2.0)
"""Smallest and largest ratio of measured to predicted amplitude for which the prediction counts as correct.

The prediction is for the least favourable position between two steps, and noise increases the measured amplitude.
"""
_PRINTED_RATE_MIN = 0.005
"""Smallest number of resolution steps per second that does not print as 0.00."""


def stability_section(recording: Recording, summary: Summary) -> str:
    """Render the stability section; empty if the recording lacks the necessary data."""
    analysis = analyse(recording, summary)
    if analysis is None:
        return ""
    parts = ["<h2>Stability</h2>", "<h3>The loop</h3>", rows(_loop_rows(analysis))]
    if (loop := analysis.loop) is not None:
        parts += [
            f"<h3>Margins</h3>{rows(_margin_rows(loop))}",
            f'<p class="verdict">{escape(margins_sentence(analysis, loop))}</p>',
            room("loop", loop_charts(analysis, loop)),
        ]
    else:
        parts.append(
            "<p>No margins: they are defined only for linear controllers (pi, admittance without a"
            " spring).</p>"
        )
    parts += [
        f"<h3>Limit cycle of the quantised position</h3>{_cycle_table(analysis)}",
        f'<p class="verdict">{escape(cycle_sentence(analysis))}</p>',
    ]
    return "\n".join(parts) + "\n"


def controller_section(recording: Recording) -> str:
    """Render the controller section; empty if no force was tracked."""
    table = decisions(recording, start_time(recording))
    if table is None:
        return ""
    parts = ["<h2>Decisions of the controller</h2>"]
    if strongest := strongest_rules(recording):
        total = len(select_tracked(recording))
        lines = [
            (name, f"{count}", f"{100 * count / total:.1f} %", f"{weight:.2f}")
            for name, count, weight in strongest
        ]
        parts.append(
            "<p>How often each rule was the strongest of its cycle. Rules with the same weight count each,"
            " so the shares may add up to more than 100 %.</p>"
            + cells(("rule", "cycles", "share", "mean weight"), lines, "narrow")
        )
    listed, cycles = len(table.rows), table.cycles
    what = f"all {cycles}" if listed == cycles else f"{listed} of {cycles}, evenly selected"
    parts.append(
        f"<details><summary>Tracked cycles ({what})</summary>"
        f'<div class="scroll">{cells(table.titles, table.rows, "dense")}</div></details>'
    )
    return "\n".join(parts) + "\n"


def margins_sentence(analysis: Analysis, loop: LinearLoop) -> str:
    """Describe whether the margins are comfortable, and the stiffness at which they vanish."""
    at, loop_margins = f"At {_stiffness(analysis.stiffness)}", loop.margins
    requirement = f"phase margin at least {PHASE_MARGIN_DEG:g}°, gain margin at least {GAIN_MARGIN:g}"
    gone, good = loop.unstable_from, loop.comfortable_to
    follows = (
        " The gain follows the estimate, so this holds for a surface harder than its estimate, not for one"
        " that is estimated well."
        if loop.scheduled
        else ""
    )
    if loop.comfortable:
        text = f"{at} the loop is comfortable ({requirement})."
        if good is not None:
            text += (
                f" It would remain so up to {_stiffness(good)}; the margin vanishes at {_stiffness(gone)}."
            )
    elif loop_margins.stable:
        text = f"{at} the loop is stable, but not comfortable ({requirement}). "
        text += f"The margin vanishes at {_stiffness(gone)}"
        text += f"; it would be comfortable up to {_stiffness(good)}." if good is not None else "."
    else:
        text = f"{at} the linear loop is unstable: the margin vanishes at {_stiffness(gone)}."
        text += f" It would be comfortable up to {_stiffness(good)}." if good is not None else ""
    return text + follows


def cycle_sentence(analysis: Analysis) -> str:
    """Describe the predicted limit cycle in comparison with the measured limit cycle."""
    predicted, amplitude, steps = analysis.predicted, analysis.steady_peak_to_peak, analysis.steps_per_second
    if predicted is None:
        unstable = analysis.loop is not None and not analysis.loop.margins.stable
        why = "the loop is unstable by itself, quantised or not" if unstable else "this loop has none"
        text = f"No limit cycle of the resolution is predicted: {why}."
        if amplitude is None or steps is None:
            return text
        ratio = amplitude / analysis.step_force
        return f"{text} The command moved {steps:.2f} steps/s, the force within {amplitude:.2f} N, {ratio:.1f} steps."
    text = f"A limit cycle of {predicted.peak_to_peak:.2f} N is predicted for a controller that never pauses"
    if amplitude is None or steps is None:
        return f"{text}; the run has no steady state to compare it with."
    if steps < _PRINTED_RATE_MIN:
        return f"{text}; the command did not move: 0 steps/s, with the steady force within {amplitude:.2f} N."
    ratio = amplitude / predicted.peak_to_peak
    text += f"; the command moved {steps:.2f} steps/s, the force varied by {amplitude:.2f} N, {ratio:.1f} times that"
    if (period := analysis.dominant_period) is not None:
        text += f", with a period of {period:.2f} s ({predicted.period:.2f} s predicted)"
    least, most = _PREDICTED_RATIO
    if ratio < least:
        return f"{text}. The moves do not form the limit cycle."
    if ratio > most:
        return f"{text}. The resolution alone does not explain that: gain, surface or noise contribute."
    return f"{text}. This is the limit cycle due to the resolution."


def _loop_rows(analysis: Analysis) -> list[Row]:
    plant = analysis.plant
    return [
        Row("sample time", concise(plant.period, 1e3, ".1f", "ms"), "measured, median from cycle to cycle"),
        Row(
            "delay",
            concise(plant.delay, 1e3, ".1f", "ms"),
            "from the force to the set point at the servo",
        ),
        *(Row(f"– {p.label}", concise(p.seconds, 1e3, ".1f", "ms"), p.source) for p in analysis.delay),
        Row(
            "servo",
            f"{plant.natural_frequency:g} rad/s, {plant.damping_ratio:g}",
            f"natural frequency and damping ratio, {analysis.servo_source}",
        ),
        Row("stiffness", _stiffness(analysis.stiffness), analysis.stiffness_source),
        Row(
            "position resolution",
            concise(analysis.resolution, 1e3, "g", "mm"),
            analysis.servo_source,
        ),
    ]


def _margin_rows(loop: LinearLoop) -> list[Row]:
    loop_margins = loop.margins
    phase_margin = _format_margin(loop_margins.phase_margin_deg, ".0f", "°")
    if loop_margins.phase_margin_deg > 0.0 and not loop_margins.stable:
        phase_margin = "none"  # the gain never falls to 1, or only beyond one turn of phase
    return [
        Row(
            "gain margin",
            _format_margin(loop_margins.gain_margin, ".2f", ""),
            "factor on the gain until it oscillates",
        ),
        Row("phase margin", phase_margin, "remaining phase where the gain is 1"),
        Row(
            "gain crossover",
            _format_margin(loop_margins.gain_crossover_rad_s, ".2f", "rad/s"),
            "where the gain is 1: roughly how fast errors are corrected",
        ),
        Row(
            "phase crossover",
            _format_margin(loop_margins.phase_crossover_rad_s, ".2f", "rad/s"),
            "where the phase is −180°: the frequency at which it would oscillate",
        ),
    ]


def _cycle_table(analysis: Analysis) -> str:
    predicted = analysis.predicted
    amplitude, period = (predicted.peak_to_peak, predicted.period) if predicted else (None, None)
    lines = [
        ("one resolution step, k_e·Δx_res", concise(analysis.step_force, 1, ".2f", "N"), ""),
        (
            "force, peak to peak",
            concise(amplitude, 1, ".2f", "N"),
            concise(analysis.steady_peak_to_peak, 1, ".2f", "N"),
        ),
        (
            "period",
            concise(period, 1, ".2f", "s"),
            concise(analysis.dominant_period, 1, ".2f", "s")
            if analysis.dominant_period is not None
            else "none dominant",
        ),
        (
            "resolution steps of the command",
            "",
            concise(analysis.steps_per_second, 1, ".2f", "1/s"),
        ),
    ]
    substitute = (
        f"an integrator that corrects {100 * SUBSTITUTE_GAIN:g} % of the error per sample and never pauses"
    )
    note = (
        f'<p class="note">Predicted by describing function for {"this controller" if analysis.loop else substitute},'
        f" a servo that lets the position be off by {analysis.dead_band:g} resolution steps, and a target half-way"
        " between two forces that whole steps reach; anywhere else the period is longer.</p>"
    )
    return cells(("", "predicted", "measured"), lines, "narrow") + note


def _stiffness(stiffness: float) -> str:
    """Format a stiffness with three digits, because more digits are not known."""
    digits = max(0, 2 - math.floor(math.log10(stiffness))) if stiffness < 100 else 0
    rounded = round(stiffness, digits - max(0, math.floor(math.log10(stiffness)) - 2))
    return f"{rounded:,.{digits}f} N/m".replace(",", " ")


def _format_margin(value: float, form: str, unit: str) -> str:
    if math.isnan(value):
        return "nowhere"
    return concise(value, 1, form, unit).replace(" °", "°") if math.isfinite(value) else "∞"
