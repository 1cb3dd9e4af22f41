"""Tables of docs/explanation/performance.md, generated from the results file in the same folder."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from tools.bench.figures import Report
from tools.pages import table

BENCHMARKS = (
    "control_step",
    "wake_up",
    "virtual_time",
    "policies",
    "link_use",
    "answers",
    "web_clients",
    "long_run",
)
"""Modules of this package, in the order of the page."""
HEAD = ("figure", "measured", "baseline", "target", "met")
HIDDEN = (
    "kept awake",
    "asyncio echo",
    "asyncio alone",
    "host kept",
    "without a recorder",
    "packets a second",
    "recording of",
    "slope of",
    "frames recorded",
    "JSON in its messages",
    "median turn",
    "inside the bridge, largest",
    "inside the bridge, late",
    "each of 2 cells",
    "each of 4 cells",
    "each of 8 cells",
    "each of 32 cells",
    "by the wall",
    "at 100 Hz",
)
"""Details that are omitted from the page and appear only in the results file."""


def machine_table(results: Mapping[str, Any]) -> str:
    """Return the table of facts about the machine."""
    return table(("", ""), results["machine"].items())


def benchmark_part(name: str, results: Mapping[str, Any]) -> str:
    """Return the main figures of a benchmark, and the figures that could not be measured."""
    report = Report.from_json(results["benchmarks"][name])
    rows = (
        figure
        for figure in report.figures
        if not any(part in f"{figure.name} {figure.against}" for part in HIDDEN)
    )
    parts = [table(HEAD, ((*cells[:3], *cells[4:]) for cells in (figure.cells() for figure in rows)))]
    parts += (f"Left out: {text}" for text in report.left_out)
    return "\n\n".join(parts)


TABLES: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "machine": machine_table,
    **{name: partial(benchmark_part, name) for name in BENCHMARKS},
}
