"""The tables of docs/explanation/performance.md, from the file of results beside it."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from tools.bench.figures import Report
from tools.pages import table

BENCHMARKS = (
    "control_step",
    "wake_up",
    "virtual_time",
    "link_use",
    "answers",
    "web_clients",
    "long_run",
)
"""Modules of this package, in the order of the page."""
QUIET = 1.5
"""Load up to which it is that of the benchmark before."""
BUSY = " The machine was busy with other work: whatever is above a median, and its target, says little."
HEAD = ("figure", "measured", "baseline", "ratio", "target", "met")


def machine_table(results: Mapping[str, Any]) -> str:
    """What the results were measured on."""
    return table(("", ""), results["machine"].items())


def benchmark_part(name: str, results: Mapping[str, Any]) -> str:
    """Figures of a benchmark, what was left out, and how busy the machine was."""
    benchmark = results["benchmarks"][name]
    report, load = Report.from_json(benchmark), benchmark["load"]
    parts = [table(HEAD, (figure.cells() for figure in report.figures))]
    parts += (f"Left out: {text}" for text in report.left_out)
    parts.append(
        f"Processes that wanted a processor when it began, average of a minute: {load:.1f}.{BUSY * (load > QUIET)}"
    )
    return "\n\n".join(parts)


TABLES: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "machine": machine_table,
    **{name: partial(benchmark_part, name) for name in BENCHMARKS},
}
