"""The force of the last cycles as columns, with the target of each as a line behind them."""

import itertools
import math
import operator

from rich.text import Text

from hil_bridge.show.terminal.model import Snapshot

SCALE_WIDTH = 9
"""Columns of the labels and the axis beside the chart."""
_EIGHTHS = " ▁▂▃▄▅▆▇█"


def error_style(force: float, reference: float) -> str:
    """Green for a force near the wanted one, yellow, or red."""
    share = abs(force - reference) / abs(reference) if reference else math.inf
    return "green" if share <= 0.05 else "yellow" if share <= 0.2 else "red"


def chart(snapshot: Snapshot, width: int, rows: int) -> list[Text]:
    """So many rows of this width, the newest cycle at the right."""
    columns = max(1, width - SCALE_WIDTH)
    forces = [force if math.isfinite(force) else 0.0 for force in snapshot.forces_n[-columns:]]
    wanted = [*([snapshot.reference_n] * columns), *snapshot.references_n][-columns:]
    top = _round_up(max([1.25 * abs(snapshot.reference_n), *map(abs, wanted), *forces, 1e-3]))
    targets = [min(rows - 1, math.floor(abs(force) / top * rows)) for force in wanted]
    heights = [0.0] * (columns - len(forces)) + forces
    drawn = []
    for row in reversed(range(rows)):
        label = {rows - 1: f"{top:g} N", targets[-1]: "target", 0: "0 N"}.get(row, "")
        line = Text(f"{label:>{SCALE_WIDTH - 2}} │", style="dim", no_wrap=True)
        cells = (
            _cell(force / top * rows - row, force, reference, "┄" if row == target else " ")
            for force, reference, target in zip(heights, wanted, targets, strict=True)
        )
        for style, run in itertools.groupby(cells, key=operator.itemgetter(1)):
            line.append("".join(character for character, _ in run), style)
        drawn.append(line)
    return drawn


def _cell(filled: float, force: float, reference: float, background: str) -> tuple[str, str]:
    """Character and style of one place of the chart; `filled` is the part of it that the column covers."""
    eighths = max(0, min(8, round(filled * 8)))
    return (_EIGHTHS[eighths], error_style(force, reference)) if eighths else (background, "magenta")


def _round_up(value: float) -> float:
    """The next 1, 1.5, 2, 3, 5 or 7.5 times a power of ten: a scale that does not change at every refresh."""
    power = 10.0 ** math.floor(math.log10(value))
    return next((step * power for step in (1, 1.5, 2, 3, 5, 7.5) if step * power >= value), 10 * power)
