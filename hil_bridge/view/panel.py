"""A snapshot as a panel for terminals of 80 × 24 and more."""

import itertools
import math
import operator
from collections.abc import Sequence

from rich import box
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from hil_bridge.analysis.times import in_ms
from hil_bridge.facts import LATE, Pacing
from hil_bridge.view.model import HISTORY_CYCLES, Snapshot

WIDTH = 80
CHART_ROWS = 8
_EIGHTHS = " ▁▂▃▄▅▆▇█"
_SCALE_WIDTH = 7
_HOPS_SHOWN = 4
"""Hops with the largest medians, that fit a line."""
_STALE_SENSOR_S = 0.1
"""Older than this is shown as a warning; the supervisor has its own, stricter limit. Chosen."""
_PHASE_STYLES = {"approach": "yellow", "track": "green", "retract": "cyan"}
_VERDICT_STYLES = {"allow": "green", "clamp": "yellow", "stop": "bold red"}


def panel(snapshot: Snapshot, width: int = WIDTH) -> RenderableType:
    """The whole view, 22 lines of `width` columns; one more for each of the sensor's check and a warning."""
    style = _PHASE_STYLES.get(snapshot.phase, "blue")
    return Panel(
        Group(
            _force_line(snapshot),
            *_chart(snapshot),
            Text(),
            _values(snapshot),
            _verdict(snapshot),
            *_latency(snapshot),
            *_link(snapshot),
            *_check(snapshot),
            *_warning(snapshot),
            _progress(snapshot),
        ),
        title=Text.assemble(
            "hil-bridge  ", (snapshot.phase.upper(), f"bold {style}"), _step(snapshot), overflow="ellipsis"
        ),
        title_align="left",
        border_style=style,
        box=box.ROUNDED,
        width=width,
    )


def _step(snapshot: Snapshot) -> str:
    """The step of a program that is under way."""
    return f"  step {snapshot.step_label}" if snapshot.step else ""


def _force_line(snapshot: Snapshot) -> Text:
    reference = snapshot.reference_n
    if snapshot.newest is None or not math.isfinite(snapshot.newest.force):
        return Text(f"force      –        target {reference:6.2f} N", style="dim")
    force = snapshot.newest.force
    if not snapshot.wants_force:
        return Text.assemble(("force ", "dim"), (f"{force:z8.2f} N", "bold"), "   in free space")
    line = Text.assemble(("force ", "dim"), (f"{force:z8.2f} N", "bold"), f"   target {reference:6.2f} N")
    if snapshot.newest.in_contact:
        line.append(f"   off by {force - reference:+7.2f} N", _error_style(force, reference))
    else:
        line.append("   no contact", "yellow")
    return line


def _error_style(force: float, reference: float) -> str:
    share = abs(force - reference) / abs(reference) if reference else math.inf
    return "green" if share <= 0.05 else "yellow" if share <= 0.2 else "red"


def _chart(snapshot: Snapshot) -> list[Text]:
    """The force of the last cycles as columns, with the target of each as a line behind them."""
    forces = [force if math.isfinite(force) else 0.0 for force in snapshot.forces_n]
    wanted = [*([snapshot.reference_n] * HISTORY_CYCLES), *snapshot.references_n][-HISTORY_CYCLES:]
    top = _round_up(max([1.25 * abs(snapshot.reference_n), *map(abs, wanted), *forces, 1e-3]))
    targets = [min(CHART_ROWS - 1, math.floor(abs(force) / top * CHART_ROWS)) for force in wanted]
    columns = [0.0] * (HISTORY_CYCLES - len(forces)) + forces
    rows = []
    for row in reversed(range(CHART_ROWS)):
        label = {CHART_ROWS - 1: f"{top:g} N", targets[-1]: "target", 0: "0 N"}.get(row, "")
        line = Text(f"{label:>{_SCALE_WIDTH}} │", style="dim", no_wrap=True)
        cells = (
            _cell(force / top * CHART_ROWS - row, force, reference, "┄" if row == target else " ")
            for force, reference, target in zip(columns, wanted, targets, strict=True)
        )
        for style, run in itertools.groupby(cells, key=operator.itemgetter(1)):
            line.append("".join(character for character, _ in run), style)
        rows.append(line)
    return rows


def _cell(filled: float, force: float, reference: float, background: str) -> tuple[str, str]:
    """Character and style of one place of the chart; `filled` is the part of it that the column covers."""
    eighths = max(0, min(8, round(filled * 8)))
    return (_EIGHTHS[eighths], _error_style(force, reference)) if eighths else (background, "magenta")


def _round_up(value: float) -> float:
    """The next 1, 1.5, 2, 3, 5 or 7.5 times a power of ten: a scale that does not change at every refresh."""
    power = 10.0 ** math.floor(math.log10(value))
    return next((step * power for step in (1, 1.5, 2, 3, 5, 7.5) if step * power >= value), 10 * power)


def _values(snapshot: Snapshot) -> Table:
    table = Table.grid(padding=(0, 2))
    for _ in range(2):
        table.add_column(style="dim", no_wrap=True)
        table.add_column(no_wrap=True, min_width=22)
    for left, right in zip(_motion(snapshot), _health(snapshot), strict=True):
        table.add_row(*left, *right)
    return table


def _motion(snapshot: Snapshot) -> Sequence[tuple[str, Text]]:
    newest = snapshot.newest
    if newest is None:
        return [(name, Text("–")) for name in ("depth", "commanded", "correction", "stiffness")]
    stiffness = "–" if newest.stiffness is None else f"{newest.stiffness / 1e3:9.2f} N/mm"
    correction = f"{newest.correction * 1e3:+9.3f} mm" + (" held" if newest.held else f" ×{newest.gain:g}")
    return [
        ("depth", Text(f"{newest.depth * 1e3:9.3f} mm")),
        ("commanded", Text(f"{newest.depth_commanded * 1e3:9.3f} mm")),
        ("correction", Text(correction)),
        ("stiffness", Text(stiffness)),
    ]


def _health(snapshot: Snapshot) -> Sequence[tuple[str, Text]]:
    cycle_s, floor_s, age_s = snapshot.cycle_time_s, snapshot.line_floor_s, snapshot.sensor_age_s
    cycle = "–" if cycle_s is None else f"{cycle_s * 1e3:6.1f} ms"
    if cycle_s is not None and cycle_s > 0:
        cycle += f"  {1 / cycle_s:5.1f} Hz"
    age = "–" if age_s is None else f"{age_s * 1e3:6.1f} ms"
    stale = age_s is not None and age_s > _STALE_SENSOR_S
    return [
        ("cycle time", Text(cycle)),
        _answer(snapshot)
        if snapshot.robot.pacing is Pacing.STREAMED
        else ("line floor", Text("–" if floor_s is None else f"{floor_s * 1e3:6.1f} ms")),
        ("sensor age", Text.assemble((age, "red" if stale else ""), _count("  lost ", snapshot.frames_lost))),
        ("link errors", _count("", snapshot.link_errors, 6)),
    ]


def _answer(snapshot: Snapshot) -> tuple[str, Text]:
    """Time of the newest answer to a robot that drives the cycle, and how many were late."""
    seconds = math.nan if snapshot.newest is None else snapshot.newest.answer_s
    told = f"{seconds * 1e3:6.2f} ms" if math.isfinite(seconds) else "–"
    return "answer", Text.assemble(told, _count("  late ", snapshot.link.get(LATE, 0)))


def _verdict(snapshot: Snapshot) -> Text:
    newest = snapshot.newest
    line = Text.assemble(("supervisor  ", "dim"), no_wrap=True, overflow="ellipsis")
    if newest is None:
        return line.append("–")
    text = f"{newest.verdict}: {', '.join(newest.reasons)}" if newest.reasons else newest.verdict
    return line.append(text, _VERDICT_STYLES.get(newest.verdict, "red"))


def _latency(snapshot: Snapshot) -> tuple[Text, Text]:
    """The whole of the last cycles, and its larger hops."""
    whole = Text.assemble(("latency     ", "dim"), no_wrap=True, overflow="ellipsis")
    found = snapshot.latency
    if found is None:
        return whole.append("–"), Text()
    p50, p99, largest = map(in_ms, (found.total.p50_s, found.total.p99_s, found.total.max_s))
    whole.append(f"{p50} ms p50, {p99} p99, {largest} max  ").append(found.name, "dim")
    shown = sorted(found.chain, key=lambda part: -part.times.p50_s)[:_HOPS_SHOWN]
    hops = [f"{part.hop.name} {in_ms(part.times.p50_s)}" for part in found.chain if part in shown]
    return whole, Text(f"{'':12}{' + '.join(hops)} ms", style="dim", no_wrap=True, overflow="ellipsis")


def _link(snapshot: Snapshot) -> tuple[Text, Text]:
    """Traffic on the robot's link, and the counters of all troubles there."""
    line = Text("link        ", style="dim", no_wrap=True, overflow="ellipsis")
    counts = (
        f"{snapshot.link.get(one.sent, 0)} {one.what} sent, {snapshot.link.get(one.received, 0)} received"
        for one in snapshot.robot.traffic
    )
    line.append("; ".join(counts))
    troubles = ", ".join(f"{name} {count}" for name, count in snapshot.link_troubles.items())
    found = (troubles, "yellow") if troubles else ("undisturbed", "green")
    return line, Text.assemble(" " * 12, found, no_wrap=True, overflow="ellipsis")


def _check(snapshot: Snapshot) -> tuple[Text, ...]:
    if not snapshot.check:
        return ()
    text = Text.assemble(("sensor      ", "dim"), snapshot.check, no_wrap=True, overflow="ellipsis")
    return (text,)


def _warning(snapshot: Snapshot) -> tuple[Text, ...]:
    if not snapshot.warning:
        return ()
    return (Text(f"warning     {snapshot.warning}", style="bold red", no_wrap=True, overflow="ellipsis"),)


def _count(label: str, number: int, width: int = 0) -> Text:
    return Text.assemble(label, (f"{number:{width}d}", "yellow" if number else "green"))


def _progress(snapshot: Snapshot) -> RenderableType:
    cycle = "" if snapshot.newest is None else f"cycle {snapshot.newest.cycle}  "
    elapsed = f"{cycle}{snapshot.elapsed_s:.1f} s"
    remaining_s = snapshot.remaining_s
    if snapshot.steps:
        count = len(snapshot.steps)
        bar = ProgressBar(total=count, completed=max(snapshot.step - 1, 0))
        left = f"step {snapshot.step} of {count}"
    elif snapshot.total_s is not None and remaining_s is not None:
        bar = ProgressBar(total=max(snapshot.total_s, 1e-9), completed=snapshot.tracked_s)
        left = f"{remaining_s:.1f} s to track"
    else:
        return Text(f"{elapsed} elapsed", style="dim")
    grid = Table.grid(padding=(0, 1), expand=True)
    grid.add_column(no_wrap=True)
    grid.add_column(ratio=1)
    grid.add_column(no_wrap=True)
    grid.add_row(elapsed, bar, left)
    return grid
