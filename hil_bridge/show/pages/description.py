"""Drawings as plain values: stacked charts with linked axes, encoded as JSON for `charts.js`, and maps.

A page embeds the encoded `Charts` in the document and calls `HilCharts.draw(element, description)`. A live page appends
rows with the `append(rows)` method of the result. `charts.js` lists all methods.
"""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from msgspec import Struct

Values: TypeAlias = Sequence[float | None]
"""Column of a source. None and NaN are gaps."""
Source: TypeAlias = Mapping[str, Values]
"""Columns of equal length by name. The column `x` increases: seconds since the start of the run on a time axis."""


class Axis(Struct, frozen=True, omit_defaults=True):
    """Shared axis of several charts, which zoom, pan and display their values together."""

    label: str
    unit: str
    wall_start_s: float | None = None
    """UTC at x = 0, s since 1970; the values at the cursor then include it."""
    log: bool = False
    """Logarithmic; every x must then be above 0."""
    names: Sequence[str] = ()
    """Names of x = 0, 1, 2 … on a categorical axis, which shows only them."""


class Series(Struct, frozen=True, omit_defaults=True):
    """One line of a chart."""

    source: str
    """Key in `Charts.sources`."""
    column: str
    label: str
    colour: str = "1"
    """`1` to `8`, or a role: `target`, `limit`, `stop`, `truth`, `faint`. Defined in `pages.css` for light and dark."""
    style: str = "line"
    """`line`, `step` (holds until the next), `points`, `bars`."""
    dashed: bool = False
    width: float = 1.5
    """px"""
    layer: str = ""
    """Layer that shows and hides it; empty: always visible."""
    values: Sequence[str] = ()
    """Texts for 0, 1, 2 …, if a number represents a state."""


class Band(Struct, frozen=True, omit_defaults=True):
    """Area between two columns of a source, such as the least and greatest values of a stream."""

    source: str
    low: str
    high: str
    label: str
    colour: str = "faint"
    layer: str = ""


class Limit(Struct, frozen=True, omit_defaults=True):
    """Level across a chart. If it is outside the picture, the chart indicates it at its edge."""

    value: float
    """In the chart's unit."""
    label: str
    kind: str = "limit"
    """`limit` or `target`."""
    shown: bool = False
    """Whether automatic zoom always includes it; otherwise only after a value has reached half of it."""
    column: str = ""
    """Column to which it applies; empty: all."""


class Chart(Struct, frozen=True, omit_defaults=True):
    """One of the stacked charts."""

    id: str
    title: str
    unit: str
    series: Sequence[Series] = ()
    bands: Sequence[Band] = ()
    limits: Sequence[Limit] = ()
    axis: str = "time"
    """Key in `Charts.axes`."""
    log: bool = False
    """Logarithmic; values of 0 and below are gaps."""
    height_px: int = 180
    least_span: float = 0.0
    """Least y range, in the chart's unit."""
    zero: bool = False
    """Whether the y range always includes 0."""
    quiet_span: float | None = None
    """The chart is omitted while no series spans more than this, in the chart's unit."""


class Mark(Struct, frozen=True, omit_defaults=True):
    """Moment, drawn as a line across every chart of the axis, with its text at the cursor."""

    x: float
    text: str
    kind: str = "event"
    """`event`, `step`, `fault`, `stop`, `note`. The first chart displays the texts of the last three."""
    axis: str = "time"
    layer: str = ""


class Span(Struct, frozen=True, omit_defaults=True):
    """Named interval, shaded behind every chart of the axis; the page can zoom to it."""

    begin: float
    end: float
    text: str
    kind: str = ""
    """Name of a phase, or `fault`; selects the colour."""
    axis: str = "time"
    short: str = ""
    """Short name for little room; empty: none."""


class Layer(Struct, frozen=True, omit_defaults=True):
    """Curves that the user shows and hides together."""

    id: str
    label: str
    shown: bool = True


class Charts(Struct, frozen=True, omit_defaults=True):
    """Complete input of `HilCharts.draw`."""

    axes: Mapping[str, Axis]
    charts: Sequence[Chart]
    sources: Mapping[str, Source]
    marks: Sequence[Mark] = ()
    spans: Sequence[Span] = ()
    layers: Sequence[Layer] = ()


Range: TypeAlias = tuple[float, float]
"""Least and greatest value."""


class Scale(Struct, frozen=True, omit_defaults=True):
    """Colour scale of values."""

    palette: str
    """`amount`, sequential, or `sign`, diverging."""
    low: float
    high: float
    unit: str


class Trace(Struct, frozen=True, omit_defaults=True):
    """Line on a map, through points in the map's unit. A NaN point interrupts it."""

    x: Values
    y: Values
    colour: str = "text"
    """A variable of `pages.css`, or `#rrggbb`."""
    width: float = 1.0
    """px"""
    dashed: bool = False
    values: Values = ()
    """Value for each point, which colours the segment that begins there; empty: `colour` applies."""


class Spot(Struct, frozen=True, omit_defaults=True):
    """Dot with a label."""

    x: float
    y: float
    text: str


class Grid(Struct, frozen=True, omit_defaults=True):
    """Values on a grid that fills the map: rows from the least y to the greatest, each with the least x first."""

    rows: Sequence[Values]


class Map(Struct, frozen=True, omit_defaults=True):
    """Picture of the surface from above, with equal scales along x and y."""

    id: str
    title: str
    x_label: str
    y_label: str
    x: Range
    y: Range
    scale: Scale
    traces: Sequence[Trace] = ()
    spots: Sequence[Spot] = ()
    grid: Grid | None = None
    heights_px: tuple[int, int] = (160, 520)
    """Least and greatest height."""


def room_of(drawn: Map, width_px: float) -> tuple[float, float, Range]:
    """Return width and height of a map, px, for the free width, and its y range: a flat map has a larger one."""
    (left, right), (low, high) = drawn.x, drawn.y
    least, most = drawn.heights_px
    height = width_px * (high - low) / (right - left)
    if height > most:
        return width_px * most / height, float(most), drawn.y
    if height >= least:
        return width_px, height, drawn.y
    half = least * (right - left) / width_px / 2
    middle = (low + high) / 2
    return width_px, float(least), (middle - half, middle + half)
