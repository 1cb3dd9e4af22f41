"""Program section of the page: steps and their outcomes."""

from html import escape

from hil_bridge.record.analysis.figures import concise, quantity
from hil_bridge.record.analysis.steps import StepOutcome, verdict_of
from hil_bridge.record.analysis.summary import Summary
from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.maps import path_map
from hil_bridge.show.pages.maps import map_svg
from hil_bridge.show.report.markup import across, cells

_TITLES = "step", "time", "distance", "mean force", "within", "required", "outcome", "result"
_SCROLL_ROWS = 40
"""Number of rows above which the table scrolls. Chosen."""


def steps_section(recording: Recording, summary: Summary) -> str:
    """Render the section; empty for a run without a program."""
    if not any(cycle.step for cycle in recording.cycles):
        return ""
    steps = cells(_TITLES, (_line(step) for step in summary.steps), "wide")
    if len(summary.steps) > _SCROLL_ROWS:
        steps = f'<div class="scroll">{steps}</div>'
    path = path_map(recording)
    drawn = "" if path is None else across(map_svg(path))
    return f"<h2>Steps</h2>\n{steps}\n{drawn}\n"


def criteria_paragraph(summary: Summary) -> str:
    """Describe which steps met their criterion; return an empty text if no step has a criterion."""
    judged = [step for step in summary.steps if step.wanted is not None or step.criterion_failed]
    failed = [step for step in judged if step.criterion_failed]
    if not judged:
        return ""
    if not failed:
        return f"<p>criteria: all {len(judged)} passed</p>"
    named = ", ".join(step.label for step in failed)
    passed = f"; {len(judged) - len(failed)} of {len(judged)} passed"
    return f"<p>criterion failed in step <strong>{escape(named)}</strong>{passed}</p>"


def _line(step: StepOutcome) -> tuple[str, ...]:
    position = ""
    if step.found_mm is not None:
        position = f"{step.name}: " + " ".join(quantity(part, 1, ".2f", "") for part in step.found_mm) + " mm"
    verdict = verdict_of(step)
    text = step.text if verdict and step.text else step.text or "done"
    return (
        step.label,
        concise(step.seconds, 1, ".1f", "s"),
        concise(step.way_mm, 1, ".1f", "mm") if step.way_mm else "",
        "" if step.force_mean_n is None else concise(step.force_mean_n, 1, ".2f", "N"),
        "" if step.within is None else concise(step.within, 100, ".1f", "%"),
        "" if step.wanted is None else concise(step.wanted, 100, "g", "%"),
        f"{verdict}: {text}" if verdict else text,
        position,
    )
