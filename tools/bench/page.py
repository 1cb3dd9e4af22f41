"""The tables of docs/explanation/performance.md, from the file of results beside it."""

from collections.abc import Iterable, Mapping
from typing import Any

from tools.bench.figures import Figure, Report
from tools.pages import placed, table

QUIET = 1.5
"""Load up to which it is that of the benchmark before."""
BUSY = " The machine was busy with other work: whatever is above a median, and its target, says little."
HEAD = ("figure", "measured", "baseline", "ratio", "target", "met")


def renewed(text: str, results: Mapping[str, Any]) -> str:
    """The page with every table as the results have it; the prose between them stays.

    Raises ValueError for a table without its place on the page.
    """
    parts = {"machine": table(("", ""), results["machine"].items())}
    for name, benchmark in results["benchmarks"].items():
        parts[name] = benchmark_part(Report.from_json(benchmark), benchmark["load"])
    return placed(text, parts)


def benchmark_part(report: Report, load: float) -> str:
    """Figures, what was left out, and how busy the machine was."""
    parts = [figures_table(report.figures), *(f"Left out: {text}" for text in report.left_out)]
    parts.append(
        f"Processes that wanted a processor when it began, average of a minute: {load:.1f}.{BUSY * (load > QUIET)}"
    )
    return "\n\n".join(parts)


def figures_table(figures: Iterable[Figure]) -> str:
    """All figures, one in a row."""
    return table(HEAD, (figure.cells() for figure in figures))
