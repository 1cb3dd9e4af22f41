"""Comparison as one page: overlaid charts of measured and emulated values, and the tables of figures."""

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from hil_bridge.lab.fidelity.comparing import INTEGRAL, Line, Sides
from hil_bridge.lab.fidelity.measures import Floats, integral_of
from hil_bridge.lab.fidelity.subjects import Compared
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.text import tables
from hil_bridge.show.charts.sources import Sources
from hil_bridge.show.pages import Axis, Chart, Charts, Layer, Series, document, room
from hil_bridge.show.report.markup import cells

_COLOURS = {"measured": "1", "emulated": "2"}
"""Colour of each side, in the order of `Sides.tables`."""
_TITLES = ("figure", "measured", "emulated", "distance")
_SCALES = {"rad": (1e3, "mrad"), "rad/s": (1e3, "mrad/s"), "m": (1e3, "mm")}
"""Scale and unit in charts, by the unit of a quantity, if they differ from it."""


def fidelity_page(name: str, compared: Compared) -> str:
    """Render the page of a comparison; `name` is the name of the recording."""
    comparison = compared.comparison
    title = f"{name} against the emulated {comparison.kind}"
    sections = "\n".join(
        f"<h3>{escape(heading)}</h3>\n{cells(_TITLES, rows, 'narrow')}"
        for heading, rows in tables(comparison)
    )
    notes = "".join(f"<p>Not compared: {escape(text)}.</p>" for text in comparison.left_out)
    body = f"""<h1>{escape(title)}</h1>
<p>{comparison.samples} samples over {comparison.seconds:.2f} s. The recording's inputs were replayed to the emulated
device. The charts omit a constant offset between both. Below each quantity is its deviation from its own input.</p>
<h2>Course</h2>
{room("fidelity", _charts(compared))}
<h2>Figures</h2>
<p class="quiet">Distance is emulated minus measured for times, and their ratio for all other figures.</p>
{sections}
{notes}"""
    return document(title, body)


def _charts(compared: Compared) -> Charts:
    sources = Sources()
    charts = [
        chart for line in compared.comparison.lines for chart in _of_line(line, compared.sides, sources)
    ]
    layers = [Layer(side, side) for side in _COLOURS]
    axis = Axis("time since the recording began", "s")
    return Charts({"time": axis}, charts, sources.held, layers=layers)


def _of_line(line: Line, sides: Sides, sources: Sources) -> Iterator[Chart]:
    """Yield the charts of a quantity: both sides overlaid, and each side minus its own input."""
    scale, unit = _SCALES.get(line.unit, (1.0, line.unit))
    level = float(np.mean(sides.measured.columns[line.output]))
    drawn = [_about(table.columns[line.output], level) * scale for table in sides.tables]
    yield Chart(line.output, line.output, unit, _over(line.output, sides, drawn, sources))
    if line.source:
        name, rests = f"{line.output}-{line.source}", [_rest(line, table) * scale for table in sides.tables]
        title = f"{line.output} minus {line.source}"
        yield Chart(name, title, unit, _over(name, sides, rests, sources), height_px=130)


def _over(name: str, sides: Sides, values: Sequence[Floats], sources: Sources) -> list[Series]:
    """Return the overlaid lines of both sides."""
    series = []
    for (side, colour), table, column in zip(_COLOURS.items(), sides.tables, values, strict=True):
        source = sources.add(side, name, table.times, {name: column})
        series.append(Series(source, name, side, colour, layer=side))
    return series


def _rest(line: Line, table: Table) -> Floats:
    """Return the output minus the input, without a shift and without its mean."""
    inputs = table.columns[line.source.removeprefix(INTEGRAL)]
    if line.source.startswith(INTEGRAL):
        inputs = integral_of(table.times, inputs)
    return _about(table.columns[line.output] - inputs, 0.0)


def _about(values: Floats, level: float) -> Floats:
    """Shift the values so that their mean is `level`."""
    shifted: Floats = values + (level - float(np.mean(values)))
    return shifted
