"""Program section of the page: steps and their outcomes."""

from collections.abc import Iterator, Sequence
from html import escape

from hil_bridge.errors.rounding import three_digits
from hil_bridge.record.analysis.definition import concise, quantity
from hil_bridge.record.analysis.steps import CUT, StepOutcome
from hil_bridge.record.analysis.summary import Summary
from hil_bridge.record.reader import Recording
from hil_bridge.show.report.markup import across, table

_TITLES = "step", "time", "distance", "mean force", "within", "required", "outcome", "result"
_SCROLL_ROWS = 40
"""Number of rows above which the table scrolls. Chosen."""


def steps_section(recording: Recording, summary: Summary) -> str:
    """Render the section; empty for a run without a program."""
    if not any(cycle.step for cycle in recording.cycles):
        return ""
    steps = _table([_line(step) for step in summary.steps])
    if len(summary.steps) > _SCROLL_ROWS:
        steps = f'<div class="scroll">{steps}</div>'
    return f"<h2>Steps</h2>\n{steps}\n"


def _table(lines: Sequence[Sequence[str]]) -> str:
    """Render the columns that have a value in any line. On a phone, each value has the title of its column."""
    used = [column for column in range(len(_TITLES)) if any(line[column] for line in lines)]
    head = "".join(f"<th>{_TITLES[column]}</th>" for column in used)

    def row(line: Sequence[str]) -> Iterator[str]:
        for column in used:
            yield f'<td data-title="{_TITLES[column]}">{escape(line[column])}</td>'

    rows = ("".join(row(line)) for line in lines)
    return across(table(rows, "wide steps", f"<thead><tr>{head}</tr></thead>"))


def criteria_paragraph(summary: Summary) -> str:
    """Describe which steps met their criterion; return an empty text if no step has a criterion."""
    judged = [step for step in summary.steps if step.wanted is not None or step.criterion_failed]
    failed = [step for step in judged if step.criterion_failed]
    if not judged:
        return ""
    if not failed:
        many = {1: "The criterion", 2: "Both criteria"}.get(len(judged), f"All {len(judged)} criteria")
        return f"<p>{many} passed.</p>"
    named = ", ".join(step.label for step in failed)
    passed = f"; {len(judged) - len(failed)} of {len(judged)} passed."
    return f"<p>Criterion failed in step <strong>{escape(named)}</strong>{passed}</p>"


def _line(step: StepOutcome) -> tuple[str, ...]:
    position = ""
    if step.found_mm is not None:
        position = f"{step.name}: " + " ".join(quantity(part, 1, ".2f", "") for part in step.found_mm) + " mm"
    required = step.wanted
    bounds = [] if required is None else [100 * required]
    return (
        step.label,
        concise(step.seconds, 1, ".1f", "s"),
        concise(step.way_mm, 1, ".1f", "mm") if step.way_mm else "",
        "" if step.force_mean_n is None else concise(step.force_mean_n, 1, ".2f", "N"),
        "" if step.within is None else f"{three_digits(100 * step.within, bounds)} %",
        "" if required is None else concise(required, 100, "g", "%"),
        _outcome(step),
        position,
    )


def _outcome(step: StepOutcome) -> str:
    """Describe whether the step met its criterion or was cut short, and why; without either, its own description."""
    if step.passed and step.wanted is None:
        return step.text or "done"
    verdict = "passed" if step.passed else "failed" if step.criterion_failed else CUT
    return ": ".join(filter(None, (verdict, step.text)))
