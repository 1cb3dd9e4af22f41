"""A comparison as one page: measured and emulated drawn over each other, and the table of figures."""

from collections.abc import Iterator
from html import escape

import numpy as np

from hil_bridge.lab.fidelity.comparing import Line
from hil_bridge.lab.fidelity.measures import Floats, integral_of
from hil_bridge.lab.fidelity.subjects import Compared
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.telling import tables
from hil_bridge.show.charts.sources import Sources
from hil_bridge.show.pages import Axis, Chart, Charts, Layer, Series, document, room
from hil_bridge.show.report.markup import cells

_MEASURED, _EMULATED = "measured", "emulated"
_COLOURS = {_MEASURED: "1", _EMULATED: "2"}
_TITLES = ("figure", "measured", "emulated", "distance")
_SCALES = {"rad": (1e3, "mrad"), "rad/s": (1e3, "mrad/s"), "m": (1e3, "mm")}
"""Units in which charts show a quantity, where they are not its own."""


def fidelity_page(name: str, compared: Compared) -> str:
    """The page of a comparison; `name` is that of the recording."""
    comparison = compared.comparison
    charts, left_out = _charts(compared)
    title = f"{name} against the emulated {comparison.kind}"
    sections = "\n".join(
        f"<h3>{escape(heading)}</h3>\n{cells(_TITLES, rows, 'narrow')}"
        for heading, rows in tables(comparison)
    )
    notes = "".join(f"<p>Not compared: {escape(text)}.</p>" for text in comparison.left_out)
    body = f"""<h1>{escape(title)}</h1>
<p>{comparison.samples} samples over {comparison.seconds:.2f} s. The emulated device was played the recording's inputs.
A constant between both is taken off in the charts. Below each quantity stands its way from its own input.</p>
<h2>Course</h2>
{room("fidelity", charts)}{f'<p class="quiet">{escape(left_out)}</p>' if left_out else ""}
<h2>Figures</h2>
<p class="quiet">Distance is emulated less measured; of a figure that is no time, their ratio.</p>
{sections}
{notes}"""
    return document(title, body)


def _charts(compared: Compared) -> tuple[Charts, str]:
    sources = Sources()
    charts = [chart for line in compared.comparison.lines for chart in _of_line(line, compared, sources)]
    layers = [Layer(side, side) for side in _COLOURS]
    axis = Axis("time since the recording began", "s")
    return Charts({"time": axis}, charts, sources.held, layers=layers), sources.sentence()


def _of_line(line: Line, compared: Compared, sources: Sources) -> Iterator[Chart]:
    scale, unit = _SCALES.get(line.unit, (1.0, line.unit))
    sides = {_MEASURED: compared.measured, _EMULATED: compared.emulated}
    level = float(np.mean(compared.measured.columns[line.output]))
    drawn = {
        side: table.columns[line.output] + (level - float(np.mean(table.columns[line.output])))
        for side, table in sides.items()
    }
    yield _chart(line.output, line.output, unit, sources, sides, {s: scale * v for s, v in drawn.items()})
    if line.source:
        rests = {side: scale * _rest(line, table) for side, table in sides.items()}
        title = f"{line.output} less {line.source}"
        yield _chart(f"{line.output}-{line.source.strip('∫')}", title, unit, sources, sides, rests, 130)


def _rest(line: Line, table: Table) -> Floats:
    """Output less input without any shift, about its mean."""
    given = table.columns[line.source.removeprefix("∫")]
    if line.source.startswith("∫"):
        given = integral_of(table.times, given)
    rest: Floats = table.columns[line.output] - given
    rest -= rest.mean()
    return rest


def _chart(
    name: str,
    title: str,
    unit: str,
    sources: Sources,
    sides: dict[str, Table],
    values: dict[str, Floats],
    height_px: int = 180,
) -> Chart:
    series = [
        Series(
            sources.add(side, name, table.times, {name: values[side]}), name, side, _COLOURS[side], layer=side
        )
        for side, table in sides.items()
    ]
    return Chart(name, title, unit, series, height_px=height_px)
