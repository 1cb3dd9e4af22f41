"""The experiments on one page for a browser: claims, numbers, and their curves as charts that zoom."""

from collections.abc import Iterator, Mapping, Sequence
from html import escape

from msgspec.structs import replace

from hil_bridge.devices.facts import RobotFacts
from hil_bridge.lab.experiments.results import Experiment, Findings, Row, digits, distinct, rows_where
from hil_bridge.record.analysis.figures import title_of
from hil_bridge.show.charts.catalogue import catalogue
from hil_bridge.show.charts.facts import ChartFacts
from hil_bridge.show.pages import Axis, Chart, Charts, Limit, Series, document, room

_TIMED = {"force_n": "force", "depth_mm": "depth", "stiffness_n_m": "stiffness"}
"""Charts of the catalogue that show the columns over time."""


def html_page(found: Mapping[str, Findings], experiments: Sequence[Experiment], command: str) -> str:
    """The page, which needs nothing beside itself."""
    claims, sections = [], []
    for experiment in experiments:
        findings = found[experiment.name]
        text, claimed = experiment.describe(findings.table)
        claims += [(experiment.name, claim.paper, claim.found) for claim in claimed]
        parts = [f"<h2>{escape(experiment.title)}</h2>", f"<p>{escape(text)}</p>"]
        if findings.series:
            parts.append(room(f"{experiment.name}", curves(findings.series, findings.reference_n)))
        if experiment.page_columns:
            columns = experiment.page_columns
            lines = [[digits(row[column]) for column in columns] for row in findings.table]
            parts.append(_table([title_of(column) for column in columns], lines))
        sections.append("\n".join(parts))
    body = (
        "<h1>The paper's results, repeated</h1>\n<p>“A Fuzzy Adaptive Control Design for Compliant Motion of a"
        " Manipulator” (IEEE, 1994): what it says, and what comes out here. The curves are those of the first noise"
        f" seed. This page is written by one command, and repeats exactly:</p>\n<pre>{escape(command)}</pre>\n"
        + _table(["experiment", "the paper says", "what came out"], claims)
        + "\n".join(sections)
    )
    return document("The paper's results, repeated", body)


def curves(rows: Sequence[Row], reference_n: float | None) -> Charts:
    """The curves of an experiment: over time, or over samples with a chart for each wall."""
    timed = "time_s" in rows[0]
    names = distinct(rows, "controller")
    sources: dict[str, dict[str, list[float | None]]] = {}
    charts = list(_over_time(rows, names, sources) if timed else _walls(rows, names, sources))
    if reference_n is not None:
        wanted = [Limit(reference_n, "wanted", "target", shown=True)]
        charts = [replace(chart, limits=wanted) if chart.unit == "N" else chart for chart in charts]
    axis = Axis("time since contact", "s") if timed else Axis("sample", "control cycles")
    return Charts({"time": axis}, charts, sources)


def _over_time(
    rows: Sequence[Row], names: Sequence[str], sources: dict[str, dict[str, list[float | None]]]
) -> Iterator[Chart]:
    for place, name in enumerate(names):
        found = rows_where(rows, controller=name)
        sources[f"c{place}"] = {"x": _numbers(found, "time_s")} | {
            key: _numbers(found, key) for key in _TIMED
        }
    described = {chart.id: chart for chart in catalogue(ChartFacts(RobotFacts(), {}))}
    for key, chart in _TIMED.items():
        told = [
            Series(f"c{place}", key, name, str(place % 8 + 1))
            for place, name in enumerate(names)
            if any(value is not None for value in sources[f"c{place}"][key])
        ]
        if told:
            yield replace(described[chart], id=key, series=told, bands=())


def _walls(
    rows: Sequence[Row], names: Sequence[str], sources: dict[str, dict[str, list[float | None]]]
) -> Iterator[Chart]:
    for wall, stiffness in enumerate(distinct(rows, "stiffness_n_m")):
        series = []
        for place, name in enumerate(names):
            found = rows_where(rows, controller=name, stiffness_n_m=stiffness)
            if not found:
                continue
            source = f"w{wall}c{place}"
            sources[source] = {"x": _numbers(found, "sample"), "force_n": _numbers(found, "force_n")}
            series.append(Series(source, "force_n", name, str(place % 8 + 1)))
        yield Chart(f"w{wall}", f"Contact force on {digits(stiffness)} N/m", "N", series)


def _numbers(rows: Sequence[Row], column: str) -> list[float | None]:
    values = (row[column] for row in rows)
    return [float(value) if isinstance(value, (int, float)) else None for value in values]


def _table(titles: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(title)}</th>" for title in titles)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in line)}</tr>" for line in lines)
    return f'<div class="across"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
