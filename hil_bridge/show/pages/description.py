"""Drawings as plain values: stacked charts with linked axes, encoded as JSON for `charts.js`, and maps.

A page embeds the encoded `Charts` in the document and calls `HilCharts.draw(element, description)`. A live page appends
rows with the `append(rows)` method of the result. `charts.js` lists all methods.
"""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from msgspec import Struct

Values: TypeAlias = Sequence[float | None]
"""Values of a source's column. None and NaN are gaps."""
Source: TypeAlias = Mapping[str, Values]
"""Columns of equal length by name. The column `x` increases; on a time axis it is in seconds since the start of the
run.
"""


class Axis(Struct, frozen=True, omit_defaults=True):
    """Shared axis of several charts, which zoom and pan together and share a cursor."""

    label: str
    unit: str
    wall_start_s: float | None = None
    """UTC time at x = 0, s since 1970. If it is set, the values at the cursor include the UTC time."""
    log: bool = False
    """Whether the axis is logarithmic; every x must then be above 0."""
    names: Sequence[str] = ()
    """Names of x = 0, 1, 2 … on a categorical axis, which shows only these names."""
    view: "Range | None" = None
    """Range that is visible at first; if None, everything is."""


class Series(Struct, frozen=True, omit_defaults=True):
    """One line of a chart."""

    source: str
    """Key of the source in `Charts.sources`."""
    column: str
    label: str
    colour: str = "1"
    """Colour: `1` to `8`, or a role: `target`, `limit`, `stop`, `truth`, `faint`. Defined in `pages.css` for light
    and dark.
    """
    style: str = "line"
    """Style of the line: `line`, `step` (constant until the next value), `points` or `bars`."""
    dashed: bool = False
    width: float = 1.5
    """Line width, px."""
    layer: str = ""
    """Layer that shows and hides the series; if empty, the series is always visible."""
    values: Sequence[str] = ()
    """Texts for the values 0, 1, 2 …, if a number represents a state."""


class Band(Struct, frozen=True, omit_defaults=True):
    """Area between two columns of a source, such as the smallest and largest values of a stream."""

    source: str
    low: str
    high: str
    label: str
    colour: str = "faint"
    layer: str = ""


class Limit(Struct, frozen=True, omit_defaults=True):
    """Level across a chart. If the level is outside the visible range, the chart indicates it at its edge."""

    value: float
    """Level in the unit of the chart."""
    label: str
    kind: str = "limit"
    """Kind of the level: `limit` or `target`."""
    shown: bool = False
    """Whether automatic zoom always includes the level; if not, automatic zoom includes it once a value has reached
    half of it.
    """
    column: str = ""
    """Column to which the level applies; if empty, it applies to all columns."""


class Chart(Struct, frozen=True, omit_defaults=True):
    """One chart in the stack of charts."""

    id: str
    title: str
    unit: str
    series: Sequence[Series] = ()
    bands: Sequence[Band] = ()
    limits: Sequence[Limit] = ()
    axis: str = "time"
    """Key of the axis in `Charts.axes`."""
    log: bool = False
    """Whether the y axis is logarithmic; values of 0 and below are then gaps."""
    height_px: int = 180
    least_span: float = 0.0
    """Smallest y range, in the chart's unit."""
    zero: bool = False
    """Whether the y range always includes 0."""
    quiet_span: float | None = None
    """Span of the values, in the chart's unit, that at least one series must exceed; otherwise the chart is omitted."""


class Mark(Struct, frozen=True, omit_defaults=True):
    """Time that is drawn as a line across every chart of the axis, with its text at the cursor."""

    x: float
    text: str
    kind: str = "event"
    """Kind of the mark: `event`, `step`, `fault`, `stop` or `note`. The first chart displays the texts of the last
    three kinds.
    """
    axis: str = "time"
    layer: str = ""
    short: str = ""
    """Text in the first chart; empty if it is `text`."""


class Span(Struct, frozen=True, omit_defaults=True):
    """Named interval, shaded behind every chart of the axis. The page can zoom to it."""

    begin: float
    end: float
    text: str
    kind: str = ""
    """Name of a phase, or `fault`; it selects the colour."""
    axis: str = "time"
    short: str = ""
    """Short name for a narrow span; empty if the span has no short name."""


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
"""Smallest and largest value of a range."""


class Scale(Struct, frozen=True, omit_defaults=True):
    """Colour scale of values."""

    palette: str
    """Kind of the palette: `amount` (sequential) or `sign` (diverging)."""
    low: float
    high: float
    unit: str


class Trace(Struct, frozen=True, omit_defaults=True):
    """Line on a map through points in the map's unit. A NaN point interrupts the line."""

    x: Values
    y: Values
    colour: str = "text"
    """Colour of the line: a variable of `pages.css`, or `#rrggbb`."""
    width: float = 1.0
    """Line width, px."""
    dashed: bool = False
    values: Values = ()
    """Value for each point, which colours the segment that begins at the point; if empty, `colour` applies."""


class Spot(Struct, frozen=True, omit_defaults=True):
    """Dot with a label on a map."""

    x: float
    y: float
    text: str


class Grid(Struct, frozen=True, omit_defaults=True):
    """Values on a grid that fills the map.

    Rows are in order of increasing y, and values in a row in order of increasing x.
    """

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
    """Smallest and largest height of the map, px."""


def room_of(drawn: Map, width_px: float) -> tuple[float, float, Range]:
    """Return width and height of a map, px, and its y range, for the available width.

    A flat map gets a larger y range.
    """
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
