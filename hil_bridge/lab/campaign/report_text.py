"""Report of a campaign as text for a terminal, as Markdown for a build server's summary, and as JUnit XML."""

import shlex
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from hil_bridge.errors.rounding import three_digits
from hil_bridge.lab.campaign.criteria import figure_text
from hil_bridge.lab.campaign.digest import CriterionResult, Digest, FailedRun, FigureResult, Tally, unmet_by
from hil_bridge.lab.campaign.run_text import faults_of_run
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.lab.junit import RECORDING, REQUIREMENT, JunitCase, Verdict, attachment, encode_junit
from hil_bridge.lab.text_tables import aligned, markdown_table
from hil_bridge.record.analysis.definition import UNKNOWN, concise
from hil_bridge.record.analysis.figures import FIGURES

FAILING_MOST = 30
"""Maximum number of failed runs listed in a text. Chosen: longer lists are rarely read."""


class Section(NamedTuple):
    """Table with its title."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    more: str = ""
    """Sentence below the table; empty if there is none."""


def headline(digest: Digest) -> str:
    """Return the name and the counts of a campaign as one line."""
    of_all = (
        ""
        if digest.tally.total == digest.planned
        else f", {digest.tally.total} of {digest.planned} runs done"
    )
    return f"{digest.name}: {digest.tally.text}{of_all}"


def sections(digest: Digest) -> Iterator[Section]:
    """Yield the matrix, failed runs, criteria, figures by cell, and facts."""
    yield _matrix(digest)
    if digest.failing:
        listed = digest.failing[:FAILING_MOST]
        left = len(digest.failing) - len(listed)
        yield Section(
            "Runs that did not pass",
            ("key", "seed", "cell", "fault", "outcome", "not met"),
            [
                (
                    run.key,
                    str(run.seed),
                    run.cell,
                    run.fault,
                    run.outcome,
                    "; ".join(one.text for one in run.unmet),
                )
                for run in listed
            ],
            (f"{left} more did not pass. " if left else "")
            + f"`{rerun_command(digest.results, 'KEY')}` repeats one.",
        )
    if digest.primary:
        yield figures_section(digest.primary, "Primary figures")
    yield criteria_section(digest.criteria)
    yield figures_section(digest.figures)
    yield Section("Facts", ("fact", "value"), list(digest.facts.items()))


def _matrix(digest: Digest) -> Section:
    cells = list(dict.fromkeys(case.cell for case in digest.cases))
    faults = list(dict.fromkeys(_fault(case.fault, case.phase) for case in digest.cases))
    fields = {
        (_fault(case.fault, case.phase), case.cell): _field(case.tally, case.impossible)
        for case in digest.cases
    }
    rows = [(cell, *(fields.get((fault, cell), "·") for fault in faults)) for cell in cells]
    note = "Passed / total. · the cell does not support the fault; ? the case has no run yet."
    return Section("Matrix", ("cell", *faults), rows, note)


def _fault(fault: str, phase: str) -> str:
    return f"{fault} {phase}".rstrip()


def _field(tally: Tally, impossible: str) -> str:
    if impossible:
        return "·"
    if not tally.total:
        return "?"
    return f"{tally.passed}/{tally.total}" + ("" if tally.good else " ✗")


def criteria_section(criteria: Iterable[CriterionResult]) -> Section:
    """Return the table with the number of runs that met each criterion."""
    rows = [(one.criterion, str(one.met), str(one.not_met), str(one.no_concern)) for one in criteria]
    return Section("Criteria", ("criterion", "met", "not met", "not applicable"), rows)


def figures_section(figures: Iterable[FigureResult], title: str = "Figures by cell") -> Section:
    """Return the table of the distribution of each figure in each cell, or of its value if each is of one run."""
    listed, rows = list(figures), []
    single = all(one.runs == 1 for one in listed)
    for one in listed:
        definition = FIGURES[one.figure]
        values = (one.median,) if single else (one.least, one.median, one.largest, one.mean, one.deviation)
        some = f", {one.endless} {definition.infinite}" if 0 < one.endless < one.runs else ""
        runs = () if single else (f"{one.runs}{some}",)
        numbers = (_value(one, value) for value in values)
        rows.append((one.title or definition.words, one.cell, *runs, *numbers))
    spread = ("runs", "least", "median", "largest", "mean", "deviation")
    return Section(title, ("figure", "cell", *(("value",) if single else spread)), rows)


def _value(result: FigureResult, value: float | None) -> str:
    """Format a value of a figure, so that it agrees with the criteria on the figure."""
    definition = FIGURES[result.figure]
    if result.endless == result.runs:
        return definition.infinite
    if value is None or not result.bounds:
        return concise(value, definition.scale, definition.form, definition.unit)
    return f"{three_digits(value, result.bounds)} {definition.unit}".rstrip()


def rerun_command(results: str, key: str) -> str:
    """Return the command that repeats a run."""
    return f"hil-bridge campaign rerun {shlex.quote(results)} {key}"


def text_report(digest: Digest) -> Iterator[str]:
    """Yield the report for a terminal, line by line."""
    yield headline(digest)
    for one in sections(digest):
        if one.rows:
            yield ""
            yield one.title
            yield from (f"  {line}" for line in aligned(one.columns, one.rows))
            if one.more:
                yield f"  {one.more}"


def failing_lines(digest: Digest, most: int) -> Iterator[str]:
    """Yield two lines for each of the worst runs: key and unmet criteria; then the number of further failed runs."""
    for run in digest.failing[:most]:
        yield f"{run.key}: seed {run.seed}, {run.cell}, fault {run.fault}"
        yield f"  {_reason(run)}"
    if (left := len(digest.failing) - most) > 0:
        yield f"and {left} more that did not pass"


def _reason(run: FailedRun) -> str:
    return "; ".join(one.text for one in run.unmet) or run.cause or UNKNOWN


def markdown_report(digest: Digest) -> str:
    """Return the report as Markdown."""
    sign = "✅" if digest.tally.good else "❌"
    parts = [f"## {sign} Campaign {headline(digest)}"]
    for one in sections(digest):
        if not one.rows:
            continue
        table = markdown_table(one.columns, one.rows)
        more = f"\n\n{one.more}" if one.more else ""
        if one.title in ("Figures by cell", "Facts"):  # long tables that are rarely read
            parts.append(f"<details><summary>{one.title}</summary>\n\n{table}{more}\n\n</details>")
        else:
            parts.append(f"### {one.title}\n\n{table}{more}")
    return "\n\n".join(parts) + "\n"


def junit_report(store: Store, digest: Digest) -> bytes:
    """Return the report as JUnit XML: one test case per run, with its figures as properties."""
    plan, cases = store.plan(), []
    required = [(REQUIREMENT, name) for name in plan.requirements]
    for run in store.runs():
        case, unmet = plan.cases[run.number], "; ".join(one.text for one in unmet_by(plan, run))
        verdict = Verdict.PASSED
        if not run.passed:
            verdict = Verdict.ERROR if run.outcome == "error" else Verdict.FAILED
        lines = (unmet, f"{run.outcome}: {run.cause}", rerun_command(digest.results, run.key))
        kept = _recordings(store, run)
        cases.append(
            JunitCase(
                case.cell,
                f"{faults_of_run(case, run)}, seed {run.seed}",
                run.wall_s,
                verdict,
                unmet or run.cause,
                "\n".join(filter(None, lines)),
                [
                    *required,
                    *((RECORDING, recording) for recording in kept),
                    ("key", run.key),
                    *((key, figure_text(value)) for key, value in run.figures.items()),
                ],
                "\n".join(map(attachment, kept)),
            )
        )
    return encode_junit(f"hil-bridge campaign {plan.name}", cases, digest.facts.items())


def _recordings(store: Store, run: Done) -> list[str]:
    """Return the path of a run's recording relative to the working directory; nothing if the recording does not
    exist.
    """
    place = store.folder / run.recording
    return [str(place)] if run.recording and place.is_file() else []
