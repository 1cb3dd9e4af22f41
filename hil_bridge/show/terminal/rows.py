"""Rows of the panel. Each function renders one or a few lines of text from a snapshot."""

import math
import textwrap
from collections.abc import Sequence

from rich.text import Text

from hil_bridge.devices.facts import LATE, Pacing
from hil_bridge.errors.text_files import harmless
from hil_bridge.record.analysis.times import in_ms
from hil_bridge.show.charts.catalogue import FORCE, MOMENT, PULL, RESULTANT
from hil_bridge.show.terminal.chart import error_style
from hil_bridge.show.terminal.model import Snapshot, ViewEvent

_LABEL = 11
"""Width of a row's label, in characters."""
_BAR, _SHORT_BAR = 20, 10
_NARROW = 66
"""Panel width below which a bar is shortened, in characters."""
_NEAR, _CLOSE = 0.5, 0.8
"""Shares of a limit above which a bar is yellow and red, respectively. Chosen."""
_ALARM_ROWS = 4
_HOPS_MAX = 4
"""Number of hops that fit on a line; those with the largest medians are shown."""
_STALE_SENSOR_S = 0.1
"""Age of the newest sensor frame above which a warning is displayed, s. Chosen. The supervisor has a stricter limit."""
_VERDICT_STYLES = {"allow": "green", "clamp": "yellow", "stop": "bold red"}


def _row(label: str, *parts: str | tuple[str, str] | Text) -> Text:
    visible = [
        part
        if isinstance(part, Text)
        else (harmless(part), "")
        if isinstance(part, str)
        else (harmless(part[0]), part[1])
        for part in parts
    ]
    return Text.assemble((f"{label:<{_LABEL}} ", "dim"), *visible, no_wrap=True, overflow="ellipsis")


def force(snapshot: Snapshot) -> Text:
    """Render force, target and error."""
    reference, newest = snapshot.reference_n, snapshot.newest
    if newest is None or not math.isfinite(newest.force):
        return _row("force", (f"{'–':>8}     target {reference:6.2f} N", "dim"))
    value = (f"{newest.force:z8.2f} N", "bold")
    if not snapshot.is_force_controlled:
        return _row("force", value, "   in free space")
    line = _row("force", value, f"  target {reference:6.2f} N")
    if newest.in_contact:
        line.append(f"  off by {newest.force - reference:+.2f} N", error_style(newest.force, reference))
    else:
        line.append("   no contact", "yellow")
    return line


def margins(snapshot: Snapshot, width: int) -> list[Text]:
    """Render forces and moment as shares of the limits that stop the run."""
    limits, newest, bar = snapshot.scene.limits, snapshot.newest, _BAR if width >= _NARROW else _SHORT_BAR
    force = math.nan if newest is None else newest.force
    pulls = force < 0 and -force / limits.pull_limit_n > -force / limits.force_limit_n
    lateral = "–" if snapshot.lateral_n is None else f"{snapshot.lateral_n:.2f} N"
    travel = _mm(None if newest is None else newest.travel_commanded)
    return [
        _margin(PULL.label, -force, limits.pull_limit_n, PULL.unit, bar)
        if pulls
        else _margin(FORCE.label, abs(force), limits.force_limit_n, FORCE.unit, bar),
        _margin(RESULTANT.words, snapshot.resultant_n, limits.resultant_limit_n, RESULTANT.unit, bar),
        _margin(MOMENT.words, snapshot.moment_nm, limits.moment_limit_nm, MOMENT.unit, bar),
        _row("lateral", f"{lateral}   travel {travel}   frames ", _count("lost ", snapshot.frames_lost)),
    ]


def _margin(label: str, value: float, limit: float, unit: str, bar: int) -> Text:
    if not math.isfinite(value):
        return _row(label, ("─" * bar, "dim"), f"  – of {limit:g} {unit}")
    share = value / limit if limit else math.inf
    filled = min(bar, round(share * bar))
    style = "bold red" if share >= _CLOSE else "yellow" if share >= _NEAR else "green"
    room = f"{limit - value:.1f} {unit} left" if value < limit else "BEYOND"
    return _row(
        label,
        ("━" * filled, style),
        ("─" * (bar - filled), "dim"),
        f"  {value:.1f} of {limit:g} {unit}, {room}",
    )


def values(snapshot: Snapshot, width: int) -> list[Text]:
    """Render motion and link health. Pairs of rows are side by side if the width allows."""
    left = max(20, min(26, (width - 2 * _LABEL - 4) // 2))
    rows = []
    for (name, one), (other, two) in zip(_motion(snapshot), _health(snapshot, width >= _NARROW), strict=True):
        pair = _row(name, one)
        pair.truncate(_LABEL + 1 + left, pad=True)
        pair.append(f" {other:<{_LABEL}} ", "dim")
        pair.append_text(two)
        rows.append(pair)
    return rows


def _mm(metres: float | None) -> str:
    return "–" if metres is None else f"{metres * 1e3:.3f} mm"


def _motion(snapshot: Snapshot) -> Sequence[tuple[str, Text]]:
    newest = snapshot.newest
    if newest is None:
        return [(name, Text("–")) for name in ("depth", "commanded", "correction", "stiffness")]
    stiffness = "–" if newest.stiffness is None else f"{newest.stiffness:9.0f} N/m"
    correction = f"{newest.correction * 1e3:+9.3f} mm" + (" held" if newest.held else f" ×{newest.gain:g}")
    return [
        ("depth", Text(f"{newest.depth * 1e3:9.3f} mm")),
        ("commanded", Text(f"{newest.depth_commanded * 1e3:9.3f} mm")),
        ("correction", Text(correction)),
        ("stiffness", Text(stiffness)),
    ]


def _health(snapshot: Snapshot, wide: bool) -> Sequence[tuple[str, Text]]:
    robot, cycle_s, age_s = snapshot.scene.robot, snapshot.cycle_time_s, snapshot.sensor_age_s
    floor_s = robot.line_floor_s
    cycle = "–" if cycle_s is None else f"{cycle_s * 1e3:6.1f} ms"
    if cycle_s is not None and cycle_s > 0 and wide:
        cycle += f"  {1 / cycle_s:5.1f} Hz"
    age = "–" if age_s is None else f"{age_s * 1e3:6.1f} ms"
    stale = age_s is not None and age_s > _STALE_SENSOR_S
    return [
        ("cycle time", Text(cycle)),
        _answer(snapshot)
        if robot.pacing is Pacing.STREAMED
        else ("line floor", Text("–" if floor_s is None else f"{floor_s * 1e3:6.1f} ms")),
        ("sensor age", Text(age, "red" if stale else "")),
        ("link errors", _count("", snapshot.link_errors, 6)),
    ]


def _answer(snapshot: Snapshot) -> tuple[str, Text]:
    """Render the newest response time to a robot that drives the cycle, and the number of late responses."""
    seconds = math.nan if snapshot.newest is None else snapshot.newest.answer_s
    value = f"{seconds * 1e3:6.2f} ms" if math.isfinite(seconds) else "–"
    return "answer", Text.assemble(value, _count("  late ", snapshot.link.get(LATE, 0)))


def _count(label: str, number: int, width: int = 0) -> Text:
    return Text.assemble(label, (f"{number:{width}d}", "yellow" if number else "green"))


def verdict(snapshot: Snapshot) -> Text:
    """Render the supervisor's verdict on the newest command."""
    newest = snapshot.newest
    if snapshot.cause:  # the verdict on the last cycle no longer applies
        return _row("supervisor", ("the run is stopped", "bold red"))
    if newest is None:
        return _row("supervisor", "–")
    text = f"{newest.verdict}: {', '.join(newest.reasons)}" if newest.reasons else newest.verdict
    return _row("supervisor", (text, _VERDICT_STYLES.get(newest.verdict, "red")))


def latency(snapshot: Snapshot) -> list[Text]:
    """Render the total latency of the last cycles, and the largest hops."""
    measured = snapshot.latency
    if measured is None:
        return [_row("latency", "–"), Text()]
    p50, p99, largest = map(in_ms, (measured.total.p50_s, measured.total.p99_s, measured.total.max_s))
    largest_hops = sorted(measured.chain, key=lambda part: -part.times.p50_s)[:_HOPS_MAX]
    hops = [f"{part.hop.name} {in_ms(part.times.p50_s)}" for part in measured.chain if part in largest_hops]
    return [
        _row("latency", f"{p50} ms p50, {p99} p99, {largest} max  ", (measured.name, "dim")),
        _row("", (f"{' + '.join(hops)} ms", "dim")),
    ]


def link(snapshot: Snapshot) -> list[Text]:
    """Render the traffic on the robot link, and its error counters."""
    counts = "; ".join(
        f"{snapshot.link.get(one.sent, 0)} {one.what} sent, {snapshot.link.get(one.received, 0)} received"
        for one in snapshot.scene.robot.traffic
    )
    if not snapshot.link:
        return [_row("link", "–"), Text()]
    troubles = ", ".join(f"{name} {count}" for name, count in snapshot.link_troubles.items())
    return [
        _row("link", (troubles, "yellow") if troubles else ("undisturbed", "green")),
        _row("", (counts, "dim")),
    ]


def render_alarms(snapshot: Snapshot, width: int) -> list[Text]:
    """Render the texts that need the operator's immediate attention: stop cause, warning, sensor check."""
    rows = _wrap("STOPPED", snapshot.cause, width) if snapshot.cause else []
    if snapshot.warning:
        rows.append(_row("warning", (snapshot.warning, "bold red")))
    if snapshot.check and not snapshot.cause:
        rows.append(_row("sensor", snapshot.check))
    return rows


def _wrap(label: str, text: str, width: int) -> list[Text]:
    """Wrap an alarm into at most `_ALARM_ROWS` rows."""
    parts = textwrap.wrap(text, max(20, width - _LABEL - 1), max_lines=_ALARM_ROWS, placeholder=" …")
    rows = [_row(label if k == 0 else "", (part, "bold red")) for k, part in enumerate(parts)]
    rows[0].stylize("bold red not dim", 0, _LABEL)
    return rows


def events(snapshot: Snapshot, count: int) -> list[Text]:
    """Render the newest events in this number of rows, oldest first."""
    others = [one for one in snapshot.events if one.text != snapshot.check]  # the check has its own row
    return [_event(one) for one in others[-count:]] if count > 0 else []


def _event(one: ViewEvent) -> Text:
    style = "red" if one.alarm else "yellow" if one.caution else ""
    return _row(f"{one.elapsed_s:8.1f} s", (f"{one.kind}: {one.text}", style))


def progress(snapshot: Snapshot, width: int) -> Text:
    """Render cycle, time and a progress bar."""
    cycle = "" if snapshot.newest is None else f"cycle {snapshot.newest.cycle}  "
    elapsed = f"{cycle}{snapshot.elapsed_s:.1f} s"
    total_s, remaining_s, count = snapshot.scene.total_s, snapshot.remaining_s, len(snapshot.scene.steps)
    if count:
        share, left = max(snapshot.step - 1, 0) / count, f"step {snapshot.step} of {count}"
    elif total_s is not None and remaining_s is not None:
        share, left = snapshot.tracked_s / max(total_s, 1e-9), f"{remaining_s:.1f} s to track"
    else:
        return Text(f"{elapsed} elapsed", style="dim", no_wrap=True)
    room = max(0, width - len(elapsed) - len(left) - 2)
    filled = round(min(1.0, share) * room)
    return Text.assemble(
        elapsed, " ", ("━" * filled, "cyan"), ("─" * (room - filled), "dim"), " ", left, no_wrap=True
    )


def foot(snapshot: Snapshot) -> list[Text]:
    """Render the path of the recording, and the keys."""
    scene = snapshot.scene
    record = [_row("recording", scene.places.record or ("none", "yellow"))]
    if not scene.keys:
        return record
    keys = _row("keys", ("r", "bold"), " or ", ("q", "bold"), " retract and end   ")
    keys.append("p", "bold").append(" hold   ").append("m", "bold").append(" mark")
    return [*record, keys]
