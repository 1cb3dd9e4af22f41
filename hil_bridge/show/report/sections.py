"""Page sections on the stability of the loop and on the controller's decisions."""

import math
from html import escape

from hil_bridge.record.analysis.figures import quantity
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
    STAND_IN_GAIN,
    Analysis,
    LinearLoop,
    analyse,
)

_AS_PREDICTED = (0.5, 2.0)
"""Measured over predicted swing that still counts as predicted. The prediction is for the least favourable place
between two positions, and noise widens the measured swing.
"""
_MOVES_TOLD = 0.005
"""Fewest resolution steps a second that print as more than 0.00."""


def stability_section(recording: Recording, summary: Summary) -> str:
    """Render the stability section; empty if the recording lacks the data."""
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
            "<p>No margins: they are defined for the linear controllers alone (pi, admittance without a"
            " spring).</p>"
        )
    parts += [
        f"<h3>Limit cycle of the quantised position</h3>{_cycle_table(analysis)}",
        f'<p class="verdict">{escape(cycle_sentence(analysis))}</p>',
    ]
    return "\n".join(parts) + "\n"


def controller_section(recording: Recording) -> str:
    """Render the controller section; empty if nothing was tracked."""
    found = decisions(recording, start_time(recording))
    if found is None:
        return ""
    parts = ["<h2>What the controller did</h2>"]
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
    shown, cycles = len(found.rows), found.cycles
    what = f"all {cycles}" if shown == cycles else f"{shown} of {cycles}, evenly chosen"
    parts.append(
        f"<details><summary>Tracked cycles ({what})</summary>"
        f'<div class="scroll">{cells(found.titles, found.rows, "dense")}</div></details>'
    )
    return "\n".join(parts) + "\n"


def margins_sentence(analysis: Analysis, loop: LinearLoop) -> str:
    """Describe whether the margins are comfortable, and the stiffness at which they vanish."""
    at, found = f"At {_stiffness(analysis.stiffness)}", loop.margins
    asked = f"phase margin at least {PHASE_MARGIN_DEG:g}°, gain margin at least {GAIN_MARGIN:g}"
    gone, good = loop.unstable_from, loop.comfortable_to
    follows = (
        " The gain follows the estimate, so this holds for a surface harder than its estimate, not for one"
        " that is estimated well."
        if loop.scheduled
        else ""
    )
    if loop.comfortable:
        text = f"{at} the loop is comfortable ({asked})."
        if good is not None:
            text += f" It would be so up to {_stiffness(good)}, and the margin gone at {_stiffness(gone)}."
    elif found.stable:
        text = f"{at} the loop is stable, but not comfortable ({asked}). "
        text += f"The margin would be gone at {_stiffness(gone)}"
        text += f"; it would be comfortable up to {_stiffness(good)}." if good is not None else "."
    else:
        text = f"{at} the linear loop is unstable: the margin is gone from {_stiffness(gone)} on."
        text += f" It would be comfortable up to {_stiffness(good)}." if good is not None else ""
    return text + follows


def cycle_sentence(analysis: Analysis) -> str:
    """Render predicted next to measured values."""
    predicted, swing, steps = analysis.predicted, analysis.steady_peak_to_peak, analysis.steps_per_second
    if predicted is None:
        unstable = analysis.loop is not None and not analysis.loop.margins.stable
        why = "the loop is unstable by itself, quantised or not" if unstable else "this loop has none"
        text = f"No limit cycle of the resolution is predicted: {why}."
        if swing is None or steps is None:
            return text
        ratio = swing / analysis.step_force
        return f"{text} The command moved {steps:.2f} steps/s, the force within {swing:.2f} N, {ratio:.1f} steps."
    text = f"A limit cycle of {predicted.peak_to_peak:.2f} N is predicted for a controller that never rests"
    if swing is None or steps is None:
        return f"{text}; the run has no steady state to compare it with."
    if steps < _MOVES_TOLD:
        return f"{text}; the run rested: 0 steps/s, and a steady force within {swing:.2f} N."
    ratio = swing / predicted.peak_to_peak
    text += f"; the command moved {steps:.2f} steps/s and the force swung by {swing:.2f} N, {ratio:.1f} times that"
    if (period := analysis.dominant_period) is not None:
        text += f", once in {period:.2f} s where {predicted.period:.2f} s are predicted"
    least, most = _AS_PREDICTED
    if ratio < least:
        return f"{text}. The moves did not add up to the limit cycle."
    if ratio > most:
        return f"{text}. The resolution alone does not explain that: gain, surface or noise are part of it."
    return f"{text}. That is the limit cycle that the resolution leaves."


def _loop_rows(analysis: Analysis) -> list[Row]:
    plant = analysis.plant
    return [
        Row("sample time", quantity(plant.period, 1e3, ".1f", "ms"), "measured, median from cycle to cycle"),
        Row(
            "delay",
            quantity(plant.delay, 1e3, ".1f", "ms"),
            "from the force to the set point at the servo",
        ),
        *(Row(f"– {p.label}", quantity(p.seconds, 1e3, ".1f", "ms"), p.source) for p in analysis.delay),
        Row(
            "servo",
            f"{plant.natural_frequency:g} rad/s, {plant.damping_ratio:g}",
            f"natural frequency and damping ratio, {analysis.servo_source}",
        ),
        Row("stiffness", _stiffness(analysis.stiffness), analysis.stiffness_source),
        Row(
            "position resolution",
            quantity(analysis.resolution, 1e3, "g", "mm"),
            analysis.servo_source,
        ),
    ]


def _margin_rows(loop: LinearLoop) -> list[Row]:
    found = loop.margins
    phase_margin = _endless(found.phase_margin_deg, ".0f", "°")
    if found.phase_margin_deg > 0.0 and not found.stable:
        phase_margin = "none"  # the gain is nowhere as low as 1, or only more than a turn later
    return [
        Row("gain margin", _endless(found.gain_margin, ".2f", ""), "factor on the gain until it oscillates"),
        Row("phase margin", phase_margin, "phase left where the gain is 1"),
        Row(
            "gain crossover",
            _endless(found.gain_crossover_rad_s, ".2f", "rad/s"),
            "where the gain is 1: about how fast errors are made up for",
        ),
        Row(
            "phase crossover",
            _endless(found.phase_crossover_rad_s, ".2f", "rad/s"),
            "where the phase is −180°: the frequency at which it would oscillate",
        ),
    ]


def _cycle_table(analysis: Analysis) -> str:
    predicted = analysis.predicted
    swing, period = (predicted.peak_to_peak, predicted.period) if predicted else (None, None)
    lines = [
        ("one resolution step, k_e·Δx_res", quantity(analysis.step_force, 1, ".2f", "N"), ""),
        (
            "swing, peak to peak",
            quantity(swing, 1, ".2f", "N"),
            quantity(analysis.steady_peak_to_peak, 1, ".2f", "N"),
        ),
        (
            "period",
            quantity(period, 1, ".2f", "s"),
            quantity(analysis.dominant_period, 1, ".2f", "s")
            if analysis.dominant_period is not None
            else "none stands out",
        ),
        (
            "resolution steps of the command",
            "",
            quantity(analysis.steps_per_second, 1, ".2f", "1/s"),
        ),
    ]
    stand_in = (
        f"an integrator that makes up for {100 * STAND_IN_GAIN:g} % of the error in a sample and never rests"
    )
    note = (
        f'<p class="note">Predicted by describing function for {"this controller" if analysis.loop else stand_in},'
        f" a servo that lets the position be off by {analysis.dead_band:g} resolution steps, and a target half-way"
        " between two forces that whole steps reach; anywhere else the period is longer.</p>"
    )
    return cells(("", "predicted", "measured"), lines, "narrow") + note


def _stiffness(stiffness: float) -> str:
    """Three digits are more than is known."""
    digits = max(0, 2 - math.floor(math.log10(stiffness))) if stiffness < 100 else 0
    shown = round(stiffness, digits - max(0, math.floor(math.log10(stiffness)) - 2))
    return f"{shown:,.{digits}f} N/m".replace(",", " ")


def _endless(value: float, form: str, unit: str) -> str:
    if math.isnan(value):
        return "nowhere"
    return quantity(value, 1, form, unit).replace(" °", "°") if math.isfinite(value) else "∞"
