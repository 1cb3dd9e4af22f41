"""Column chart of the forces of the last cycles, with the target forces as a line behind the columns."""

import itertools
import math
import operator
from collections.abc import Mapping, Sequence

from rich.text import Text

from hil_bridge.show.charts.catalogue import catalogue
from hil_bridge.show.charts.painter import y_range
from hil_bridge.show.pages.description import Chart
from hil_bridge.show.terminal.model import Snapshot

SCALE_WIDTH = 9
"""Width of the labels and the axis, in characters."""
_EIGHTHS = " ▁▂▃▄▅▆▇█"
_LIMIT = "┈"
"""Style of the line of a limit."""


def error_style(force: float, reference: float) -> str:
    """Return the style green for a force near its target, otherwise yellow or red."""
    share = abs(force - reference) / abs(reference) if reference else math.inf
    return "green" if share <= 0.05 else "yellow" if share <= 0.2 else "red"


def chart(snapshot: Snapshot, width: int, rows: int) -> list[Text]:
    """Draw a chart with this number of rows and this width.

    The newest cycle is at the right, and the scale is that of the catalogue.
    """
    columns = max(1, width - SCALE_WIDTH)
    forces = [force if math.isfinite(force) else 0.0 for force in snapshot.forces_n[-columns:]]
    references = [*([snapshot.reference_n] * columns), *snapshot.references_n][-columns:]
    described = described_charts(snapshot)["force"]
    greatest = max([1.25 * abs(snapshot.reference_n), *map(abs, references), *forces, 1e-3])
    top = round_up(max(greatest, y_range(described, 0.0, max([*forces, *map(abs, references)]))[1]))
    targets = [min(rows - 1, math.floor(abs(force) / top * rows)) for force in references]
    limits = {math.floor(limit.value / top * rows) for limit in described.limits}
    heights = [0.0] * (columns - len(forces)) + forces
    drawn = []
    for row in reversed(range(rows)):
        labels = {0: "0 N", targets[-1]: "target", rows - 1: f"{top:g} N"}
        label = labels.get(row, "limit" if row in limits else "")
        line = Text(f"{label:>{SCALE_WIDTH - 2}} │", style="dim", no_wrap=True)
        cells = (
            _cell(
                force / top * rows - row,
                force,
                reference,
                "┄" if row == target else _LIMIT if row in limits else " ",
            )
            for force, reference, target in zip(heights, references, targets, strict=True)
        )
        for style, run in itertools.groupby(cells, key=operator.itemgetter(1)):
            line.append("".join(character for character, _ in run), style)
        drawn.append(line)
    return drawn


def trend(snapshot: Snapshot, key: str, values: Sequence[float], size: tuple[int, int]) -> list[Text]:
    """Draw a chart of the catalogue as columns: a title, then rows.

    `size` is the width and the total number of rows.
    """
    width, rows = size[0], size[1] - 1
    described = described_charts(snapshot)[key]
    columns = max(1, width - SCALE_WIDTH)
    visible = list(values[-columns:])
    known = [value for value in visible if math.isfinite(value)]
    title = Text(f"{described.title}, {described.unit}", style="dim", no_wrap=True, overflow="ellipsis")
    low, high = y_range(described, min(known), max(known)) if known else (0.0, 1.0)
    heights = [math.nan] * (columns - len(visible)) + visible
    lines = [title]
    for row in reversed(range(rows)):
        label = {rows - 1: _label(high, high - low), 0: _label(low, high - low)}.get(row, "")
        line = Text(f"{label:>{SCALE_WIDTH - 2}} │", style="dim", no_wrap=True)
        filled = (
            0.0 if math.isnan(value) else (value - low) / (high - low) * rows - row for value in heights
        )
        line.append("".join(_EIGHTHS[max(0, min(8, round(part * 8)))] for part in filled), "cyan")
        lines.append(line)
    return lines


def _label(value: float, span: float) -> str:
    """Format the value at an end of a scale, with a resolution of a hundredth of the span of the scale."""
    digits = max(0, 1 - math.floor(math.log10(span)))
    return f"{value:z.{digits}f}".replace("-", "−")


def described_charts(snapshot: Snapshot) -> Mapping[str, Chart]:
    """Return the catalogue of the run by chart id."""
    return {chart.id: chart for chart in catalogue(snapshot.scene.chart_facts)}


def _cell(filled: float, force: float, reference: float, background: str) -> tuple[str, str]:
    """Return character and style of one cell of the chart. `filled` is the share of the cell that the column covers."""
    eighths = max(0, min(8, round(filled * 8)))
    if eighths:
        return _EIGHTHS[eighths], error_style(force, reference)
    return background, "red" if background == _LIMIT else "magenta"


def round_up(value: float) -> float:
    """Round up to 1, 1.5, 2, 3, 5 or 7.5 times a power of ten, so that the scale rarely changes."""
    power = 10.0 ** math.floor(math.log10(value))
    return next((step * power for step in (1, 1.5, 2, 3, 5, 7.5) if step * power >= value), 10 * power)
