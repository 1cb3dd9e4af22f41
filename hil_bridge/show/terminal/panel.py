"""Panel that displays a snapshot in a terminal of at least 60 × 20, in one or two columns of rows."""

import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from rich import box
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.text import Text

from hil_bridge.show.terminal import rows
from hil_bridge.show.terminal.chart import chart, trend
from hil_bridge.show.terminal.model import Snapshot

WIDE = 120
"""Smallest width for two columns of rows, in characters."""
_GAP = 3
_CHART_SHARE = 4
"""Reciprocal of the smallest share of the rows for the chart. Chosen."""
_EVENTS_MAX = 8
"""Maximum number of event rows if the chart can use the remaining rows. Chosen."""
_TREND_ROWS, _TREND_MOST = 6, 14
"""Minimum and maximum number of rows of a chart next to the facts. Chosen: fewer rows are unreadable."""
_PHASE_STYLES = {"approach": "yellow", "track": "green", "retract": "cyan"}


class _Block(NamedTuple):
    """Rows that stay together.

    If there are too few rows for all blocks, blocks of the largest rank are dropped first.
    """

    lines: Sequence[Text]
    rank: int


def panel(snapshot: Snapshot, width: int, height: int) -> RenderableType:
    """Render the complete view with this width and height."""
    inner, room = width - 4, height - 2
    wide = width >= WIDE
    body = _two_columns(snapshot, inner, room) if wide else _one_column(snapshot, inner, room)
    style = "red" if snapshot.cause else _PHASE_STYLES.get(snapshot.phase, "blue")
    return Panel(
        Group(*_fit(body, inner, room)),
        title=_title(snapshot, style),
        title_align="left",
        border_style=style,
        box=box.ROUNDED,
        width=width,
        height=height,
    )


def _title(snapshot: Snapshot, style: str) -> Text:
    """Render the heading: whether a real robot may move, then the state of the run."""
    scene = snapshot.scene
    named = "  ".join(filter(None, (scene.cell, scene.devices)))
    cell = (f" {named} ", "bold white on red" if scene.real else "bold black on green")
    return Text.assemble(
        "hil-bridge ",
        *(cell,) * bool(scene.cell),
        " ",
        (snapshot.phase.upper(), f"bold {style}"),
        f"  step {snapshot.step_label}" if snapshot.step else "",
        *(("  HELD", "bold yellow"),) * snapshot.held,
        *(("  STOPPED", "bold red"),) * bool(snapshot.cause),
        overflow="ellipsis",
    )


def _one_column(snapshot: Snapshot, width: int, room: int) -> list[Text]:
    limit, resultant, moment, lateral = rows.margins(snapshot, width)
    latency, hops = rows.latency(snapshot)
    troubles, counts = rows.link(snapshot)
    record, *keys = rows.foot(snapshot)
    above = _Block([rows.force(snapshot)], 0)
    below = [
        _Block([limit], 0),
        _Block([resultant, moment], 4),
        _Block([lateral], 1),
        _Block(rows.values(snapshot, width), 0),
        _Block([rows.verdict(snapshot)], 1),
        _Block([latency], 3),
        _Block([hops], 6),
        _Block([troubles], 2),
        _Block([counts], 5),
        _Block(rows.render_alarms(snapshot, width), 0),
    ]
    feet = [_Block([rows.progress(snapshot, width)], 0), _Block([record], 2), _Block(keys, 0)]
    events = rows.events(snapshot, 1)
    least = room // _CHART_SHARE
    kept = _keep([above, *below, *feet], room - least - len(events))
    free = room - sum(len(block.lines) for block in kept)
    events = rows.events(snapshot, min(_EVENTS_MAX, max(len(events), (free - least) // 3)))
    drawn = chart(snapshot, width, max(1, free - len(events)))
    return [
        *above.lines,
        *drawn,
        *_lines(block for block in kept if block in below),
        *events,
        *_lines(block for block in kept if block in feet),
    ]


def _two_columns(snapshot: Snapshot, width: int, room: int) -> list[Text]:
    right = min(90, (width - _GAP) // 2)
    left = width - _GAP - right
    foot = [rows.progress(snapshot, width), *rows.foot(snapshot)]
    high = room - len(foot)
    limits = rows.margins(snapshot, left)
    pressing = [
        rows.force(snapshot),
        *chart(snapshot, left, max(1, high - 1 - len(limits))),
        *limits,
    ]
    facts = [
        *rows.render_alarms(snapshot, right),
        *rows.values(snapshot, right),
        rows.verdict(snapshot),
        *rows.latency(snapshot),
        *rows.link(snapshot),
        Text(),
    ]
    newest = rows.events(snapshot, high - len(facts))
    drawn = _trends(snapshot, right, high - len(facts) - min(len(newest), _EVENTS_MAX) - 1)
    facts += [*drawn, *rows.events(snapshot, high - len(facts) - len(drawn))]
    return [*_beside(pressing, facts, left, right)[:high], *foot]


def _trends(snapshot: Snapshot, width: int, room: int) -> list[Text]:
    """Render depth and durations of the last cycles if the right column has enough rows."""
    values = {"depth": snapshot.depths_mm, "times": snapshot.cycle_times_ms}
    count = min(len(values), room // (_TREND_ROWS + 1))
    if not count or not snapshot.depths_mm:
        return []
    high = min(_TREND_MOST, room // count - 1)
    drawn = [trend(snapshot, key, values[key], (width, high)) for key in list(values)[:count]]
    return [line for lines in drawn for line in (*lines, Text())]


def _beside(left: Sequence[Text], right: Sequence[Text], width: int, other: int) -> list[Text]:
    lines = []
    for one, two in itertools.zip_longest(left, right, fillvalue=Text()):
        line = one.copy()
        line.truncate(width, overflow="ellipsis", pad=True)
        second = two.copy()
        second.truncate(other, overflow="ellipsis")
        lines.append(line.append(" │ ", "dim").append_text(second))
    return lines


def _keep(blocks: Sequence[_Block], room: int) -> list[_Block]:
    """Return the blocks that fit, in their order; blocks of the largest rank are dropped first."""
    kept = list(blocks)
    while sum(len(block.lines) for block in kept) > room:
        last = max(kept, key=lambda block: block.rank)
        if not last.rank:
            break
        kept.remove(last)
    return kept


def _lines(blocks: Iterable[_Block]) -> list[Text]:
    return [line for block in blocks for line in block.lines]


def _fit(lines: Sequence[Text], width: int, room: int) -> list[Text]:
    """Pad or cut the rows to exactly this number of lines and at most this width."""
    for line in lines:
        line.truncate(width, overflow="ellipsis")
    return [*lines[:room], *(Text() for _ in range(room - len(lines)))]
