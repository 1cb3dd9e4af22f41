"""A drawing as plain values: stacked charts with linked axes, which become JSON for `charts.js`, and maps.

A page puts the encoded `Charts` into the document and calls `HilCharts.draw(element, description)`. A page that lives
appends with `append(rows)` of what `draw` gave. `charts.js` names all of its verbs.
"""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from msgspec import Struct

Values: TypeAlias = Sequence[float | None]
"""A column of a source. None and NaN are a gap."""
Source: TypeAlias = Mapping[str, Values]
"""Columns of equal length by their names. The column `x` rises: seconds since the run began on an axis of time."""


class Axis(Struct, frozen=True, omit_defaults=True):
    """The axis that several charts have in common. Charts of one axis zoom, pan and show their values together."""

    label: str
    unit: str
    wall_start_s: float | None = None
    """UTC at x = 0, s since 1970; the values under the cursor then show it, too."""
    log: bool = False
    """Logarithmic; every x must then be above 0."""
    names: Sequence[str] = ()
    """Names of x = 0, 1, 2 …, where places of a row stand for things; the axis shows them alone."""


class Series(Struct, frozen=True, omit_defaults=True):
    """One line of a chart."""

    source: str
    """Which of `Charts.sources`."""
    column: str
    label: str
    colour: str = "1"
    """`1` to `8`, or a role: `target`, `limit`, `stop`, `truth`, `faint`. `pages.css` holds them for light and dark."""
    style: str = "line"
    """`line`, `step` (holds until the next), `points`, `bars`."""
    dashed: bool = False
    width: float = 1.5
    """px"""
    layer: str = ""
    """The layer that shows and hides it; none: always shown."""
    values: Sequence[str] = ()
    """Words for 0, 1, 2 …, where a number stands for a state."""


class Band(Struct, frozen=True, omit_defaults=True):
    """The area between two columns of a source, such as the least and greatest of a stream."""

    source: str
    low: str
    high: str
    label: str
    colour: str = "faint"
    layer: str = ""


class Limit(Struct, frozen=True, omit_defaults=True):
    """A level across a chart. Where it lies outside of the picture, the chart says so at its edge."""

    value: float
    """In the chart's unit."""
    label: str
    kind: str = "limit"
    """`limit` or `target`."""
    shown: bool = False
    """Whether the chart always makes room for it when it zooms by itself; else once a value has come to half of it."""
    column: str = ""
    """The one column that it is a limit of; none: of all."""


class Chart(Struct, frozen=True, omit_defaults=True):
    """One of the charts above each other."""

    id: str
    title: str
    unit: str
    series: Sequence[Series] = ()
    bands: Sequence[Band] = ()
    limits: Sequence[Limit] = ()
    axis: str = "time"
    """Which of `Charts.axes`."""
    log: bool = False
    """Logarithmic; values of 0 and below are gaps."""
    height_px: int = 180
    least_span: float = 0.0
    """The picture shows at least so much of y, in the chart's unit."""
    zero: bool = False
    """Whether 0 is always in the picture."""
    quiet_span: float | None = None
    """The chart is left out while no series spans more than this, in the chart's unit."""


class Mark(Struct, frozen=True, omit_defaults=True):
    """A moment: a line across every chart of the axis, with its text at the cursor."""

    x: float
    text: str
    kind: str = "event"
    """`event`, `step`, `fault`, `stop`, `note`. The texts of the last three stand in the first chart."""
    axis: str = "time"
    layer: str = ""


class Span(Struct, frozen=True, omit_defaults=True):
    """A stretch with a name, shaded behind every chart of the axis; the page offers to zoom to it."""

    begin: float
    end: float
    text: str
    kind: str = ""
    """Chooses the colour: a phase's name, or `fault`."""
    axis: str = "time"
    short: str = ""
    """Name for where there is little room; empty where it has none but its text."""


class Layer(Struct, frozen=True, omit_defaults=True):
    """Curves that an operator shows and hides together."""

    id: str
    label: str
    shown: bool = True


class Charts(Struct, frozen=True, omit_defaults=True):
    """Everything that `HilCharts.draw` needs."""

    axes: Mapping[str, Axis]
    charts: Sequence[Chart]
    sources: Mapping[str, Source]
    marks: Sequence[Mark] = ()
    spans: Sequence[Span] = ()
    layers: Sequence[Layer] = ()


Range: TypeAlias = tuple[float, float]
"""Least and greatest value."""


class Scale(Struct, frozen=True, omit_defaults=True):
    """Which colour is which value."""

    palette: str
    """`amount`, from little to much, or `sign`, from below to above."""
    low: float
    high: float
    unit: str


class Trace(Struct, frozen=True, omit_defaults=True):
    """A line on a map, through places in the map's unit. A place that is not a number cuts it."""

    x: Values
    y: Values
    colour: str = "text"
    """A variable of `pages.css`, or `#rrggbb`."""
    width: float = 1.0
    """px"""
    dashed: bool = False
    values: Values = ()
    """A value for each place, which colours the piece that begins there; none: the line has its own colour."""


class Spot(Struct, frozen=True, omit_defaults=True):
    """A dot with a text beside it."""

    x: float
    y: float
    text: str


class Grid(Struct, frozen=True, omit_defaults=True):
    """Values on a grid that fills the map: rows from the least y to the greatest, in each the least x first."""

    rows: Sequence[Values]


class Map(Struct, frozen=True, omit_defaults=True):
    """A picture of the surface from above, with equal scales along x and y."""

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
    """Width and height of a map in px, where so much width is free, and the y that it shows: a flat map shows more."""
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
