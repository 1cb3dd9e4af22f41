"""The tables of docs/performance.md, from the file of results beside it."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tools.bench.figures import Figure, Report

QUIET = 1.5
"""Load up to which it is that of the benchmark before."""
BUSY = " The machine was busy with other work: whatever is above a median, and its target, says little."
HEAD = ("figure", "measured", "baseline", "ratio", "target", "met")


def renewed(text: str, results: Mapping[str, Any]) -> str:
    """The page with every table as the results have it; the prose between them stays.

    Raises ValueError for a table without its place on the page.
    """
    text = _placed(text, "machine", _table(("", ""), results["machine"].items()))
    for name, benchmark in results["benchmarks"].items():
        report = Report.from_json(benchmark)
        text = _placed(text, name, benchmark_part(report, benchmark["load"]))
    return text


def benchmark_part(report: Report, load: float) -> str:
    """Figures, what was left out, and how busy the machine was."""
    parts = [figures_table(report.figures), *(f"Left out: {text}" for text in report.left_out)]
    parts.append(
        f"Processes that wanted a processor when it began, average of a minute: {load:.1f}.{BUSY * (load > QUIET)}"
    )
    return "\n\n".join(parts)


def figures_table(figures: Iterable[Figure]) -> str:
    """All figures, one in a row."""
    return _table(HEAD, (figure.cells() for figure in figures))


def _placed(text: str, name: str, content: str) -> str:
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before, has_begin, behind = text.partition(begin)
    _, has_end, after = behind.partition(end)
    if not (has_begin and has_end):
        raise ValueError(f"the page has no place for {name!r}: {begin} … {end}")
    return f"{before}{begin}\n{content}\n{end}{after}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows))
