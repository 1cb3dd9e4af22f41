import asyncio
import io
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest
from msgspec import structs
from rich.console import Console

from hil_bridge.clock import Clock
from hil_bridge.console import screen
from hil_bridge.control import Limits
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.robots.s3.facts import robot_facts
from hil_bridge.record import CycleRecord, EventKind, EventRecord
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.terminal_view import TerminalView
from hil_bridge.runs.views import scene_of
from hil_bridge.settings.configuration import read_config
from hil_bridge.show.terminal import Health, Scene, Snapshot, ViewModel
from hil_bridge.show.terminal.chart import SCALE_WIDTH, chart
from hil_bridge.show.terminal.live import LiveView, line
from hil_bridge.show.terminal.panel import panel
from protocol.devices.s3.adlp import Count, LinkProfile, NoticeKind
from tests.record.written_recordings import cycle_of

CYCLE = cycle_of(
    cycle=42,
    phase="track",
    started_at=110.0,
    status_at=110.07,
    sensor_at=110.07,
    controlled_at=110.07,
    sent_at=110.07,
    answered_at=110.161,
    sensor_sequence=1,
    force=48.73,
    force_reference=50.0,
    depth=0.002625,
    depth_commanded=0.00275,
    correction=-0.000125,
    stiffness=20_100.0,
    gain=0.5,
    in_contact=True,
)


ROBOT = robot_facts(LinkProfile())


class Terminal(io.StringIO):
    """Stream that claims to be a terminal."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


def text_of(snapshot: Snapshot, width: int = 80, height: int = 32) -> str:
    console = Console(width=width, height=height, record=True, file=io.StringIO(), color_system="truecolor")
    console.print(panel(snapshot, width, height))
    return console.export_text()


def model(*records: CycleRecord, total_s: float | None = 30.0) -> ViewModel:
    view = ViewModel(Scene(50.0, ROBOT, total_s))
    view.snapshot(100.0, Health())
    for record in records:
        view.update(record)
    return view


def test_panel_shows_cycle_and_link_values() -> None:
    text = text_of(model(CYCLE).snapshot(110.1617, Health(3, 7, 110.161)))
    for part in (
        "TRACK",
        "48.73 N",
        "target  50.00 N",
        "-1.27 N",
        "2.625 mm",
        "2.750 mm",
        "-0.125 mm ×0.5",
        "20100 N/m",
        "161.0 ms",
        "155.8 ms",
        "0.7 ms",
        "lost 7",
        "allow",
        "cycle 42  10.2 s",
        "29.8 s to track",
    ):
        assert part in text
    assert text.split("link errors")[1].split()[0] == "3"


STEPS = ("1 (approach)", "2.1 (track, pass 1)", "2.1 (track, pass 2)", "3 (retract)")


def program(*records: CycleRecord) -> Snapshot:
    view = ViewModel(Scene(50.0, ROBOT, steps=STEPS))
    view.snapshot(100.0, Health())
    for record in records:
        view.update(record)
    return view.snapshot(110.2, Health())


def test_view_of_program_shows_step_and_target_force() -> None:
    snapshot = program(structs.replace(CYCLE, step=3, force_reference=12.5))
    text = text_of(snapshot)
    assert "TRACK  step 2.1 (track, pass 2)" in text
    assert "target  12.50 N" in text
    assert "step 3 of 4" in text
    assert "to track" not in text
    drawn_text = line(snapshot)
    assert "step 3 of 4: 2.1 (track, pass 2)" in drawn_text
    assert "of 12.50 N" in drawn_text


def test_scene_of_program_lists_tracking_steps() -> None:
    path = {"kind": "line", "length_mm": 5.0}
    steps = [{"do": "approach"}, {"do": "track", "path": path}, {"do": "retract"}]
    setup = Setup(read_config({"task": {"step": steps}}))
    scene = scene_of(setup, ROBOT, setup.loop.program.row.legs, RunPlaces())
    assert scene.steps == ("1 (approach)", "2 (track)", "3 (retract)")
    assert scene.chart_facts.tracks == {2}
    assert scene.total_s is None
    assert (scene.cell, scene.devices) == ("EMULATED", "s3, jr3")


def test_event_with_traceback_shows_exception_line() -> None:
    view = model(CYCLE)
    trace = "Traceback (most recent call last):\n  File somewhere\nValueError: the law is broken\n"
    view.event(EventRecord(110.0, EventKind.TRACEBACK, trace))
    view.event(EventRecord(110.1, EventKind.LINK, "first line\nsecond line"))
    text = text_of(view.snapshot(110.2, Health()))
    assert "traceback: ValueError: the law is broken" in text
    assert "link: first line" in text
    assert "second line" not in text


def test_view_of_program_has_no_target_in_free_space() -> None:
    snapshot = program(structs.replace(CYCLE, step=4, phase="retract", force=0.03))
    assert "target" not in text_of(snapshot).splitlines()[1]
    assert "in free space" in text_of(snapshot)
    assert "0.03 N of" not in line(snapshot)


def test_chart_shows_target_force_of_each_cycle() -> None:
    rising = [structs.replace(CYCLE, step=2, force=0.0, force_reference=5.0 + k) for k in range(60)]
    lines = [line.plain for line in chart(program(*rising), 60 + SCALE_WIDTH, 8)]
    rows = {column: [k for k, one in enumerate(lines) if one[column] == "┄"] for column in (12, 40, 68)}
    assert all(len(result) == 1 for result in rows.values()), lines
    assert rows[12] > rows[40] > rows[68]


def test_pull_is_compared_with_pull_limit() -> None:
    pulled = text_of(model(structs.replace(CYCLE, force=-4.0)).snapshot(110.2, Health()))
    assert re.search(r"pull limit +━+─+ +4\.0 of 10 N, 6\.0 N left", pulled)
    assert "of 50 N" not in pulled


def test_panel_names_link_errors() -> None:
    counted = {
        "bid sent": 617,
        "bid received": 616,
        "blocks sent": 614,
        "blocks received": 613,
        "time-out": 0,
    }
    quiet = text_of(model(CYCLE).snapshot(110.2, Health(link=counted)))
    assert "617 bids sent, 616 received; 614 blocks sent, 613 received" in quiet
    assert "undisturbed" in quiet
    troubled = model(CYCLE).snapshot(
        110.2, Health(link={**counted, "time-out": 3, "missing EOT": 21, "bad checksum": 1})
    )
    lines = text_of(troubled).splitlines()
    (text,) = (line for line in lines if " link  " in line)
    assert "missing EOT 21, time-out 3, bad checksum 1 " in text
    assert len(lines) == len(quiet.splitlines())


STAMPED = structs.replace(
    CYCLE,
    sample=structs.replace(CYCLE.sample, sensor_at=110.064),
    decoded_at=110.064,
    proposed_at=110.0704,
    controlled_at=110.0708,
    sent_at=110.071,
    transmitted_at=110.130,
    answered_at=110.1615,
)


def test_panel_shows_latency_breakdown() -> None:
    lines = text_of(model(STAMPED).snapshot(110.17, Health())).splitlines()
    at = next(k for k, line in enumerate(lines) if "latency" in line)
    assert "98 ms p50, 98 p99, 98 max  sample's arrival to answer" in lines[at]
    assert "waiting 6.0 + line 59 + turnaround 12 + answer 19 ms" in " ".join(lines[at + 1].split())
    unstamped = text_of(model(CYCLE).snapshot(110.17, Health()))
    assert "latency     –" in unstamped
    assert len(unstamped.splitlines()) == len(lines)


def test_warning_remains_in_panel_and_lines() -> None:
    view = model(CYCLE)
    view.warn("unchecked")
    view.warn("incomplete: – full")
    for now in (110.0, 120.0):
        snapshot = view.snapshot(now, Health())
        assert "warning     incomplete: – full; unchecked" in text_of(snapshot)
        assert line(snapshot).endswith("WARNING: incomplete: \\u2013 full; unchecked")


SIZES = [(60, 20), (80, 24), (100, 30), (119, 40), (120, 24), (160, 45), (200, 50)]


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_panel_always_fills_the_terminal(width: int, height: int) -> None:
    stop = structs.replace(CYCLE, force=-1e4, verdict="stop", reasons=("a long cause " * 9,), stiffness=9e6)
    odd = structs.replace(CYCLE, force=math.nan, answered_at=math.nan, stiffness=None, held=True, phase="odd")
    warned = model(*[STAMPED] * 100)
    warned.warn("the disk is full " * 20)
    output = [
        model(),
        warned,
        model(total_s=None),
        model(*[CYCLE] * 100),
        model(*[STAMPED] * 100),
        model(structs.replace(STAMPED, answered_at=1e6)),
        model(stop),
        model(odd),
        model(structs.replace(CYCLE, force_reference=0.0, force=0.0)),
    ]
    counters = {str(kind): 10**6 for kind in (*Count, *NoticeKind)}
    for view in output:
        for k in range(100):
            view.event(EventRecord(101.0 + k, EventKind.FAULT, "a long text " * 30 + "\nand more"))
        snapshot = view.snapshot(140.0, Health(10**6, 10**6, 100.0, counters))
        lines = text_of(snapshot, width, height).splitlines()
        assert len(lines) == height
        assert {len(line) for line in lines} == {width}


@pytest.mark.parametrize(
    ("errors", "label"),
    [(("packets missing",), "packets missing 3"), (("stale packets",), "cycles missing 3")],
)
def test_panel_labels_missing_packets_by_wire(errors: tuple[str, ...], label: str) -> None:
    robot = RobotFacts(errors=errors)
    view = ViewModel(Scene(50.0, robot, 30.0))
    view.snapshot(100.0, Health())
    assert label in text_of(view.snapshot(101.0, Health(link={"packets missing": 3})))


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_panel_of_every_size_shows_essential_values(width: int, height: int) -> None:
    scene = Scene(
        50.0,
        ROBOT,
        30.0,
        cell="REAL",
        devices="s3, gateway",
        real=True,
        places=RunPlaces("runs/a/run.mcap"),
        keys=True,
    )
    view = ViewModel(scene)
    view.snapshot(100.0, Health())
    sample = structs.replace(CYCLE.sample, wrench=(3.0, 4.0, 48.73, 0.0, 1.0, 0.0))
    view.update(structs.replace(CYCLE, sample=sample, travel_commanded=0.0125))
    running = text_of(view.snapshot(110.0, Health()), width, height)
    for part in (
        "REAL  s3, gateway",
        "off by -1.27 N",
        "48.7 of 50 N, 1.3 N left",
        "5.00 N   travel 12.500 mm",
        "retract and end",
    ):
        assert part in running
    assert "STOPPED" not in running
    view.event(EventRecord(109.0, EventKind.STOP, "the force rose"))
    for k in range(70):
        view.event(EventRecord(110.0 + k, EventKind.LINK, "time-out"))
    stopped = text_of(view.snapshot(111.0, Health()), width, height)
    assert "STOPPED     the force rose" in stopped
    assert "TRACK  STOPPED" in stopped
    last = view.snapshot(111.0, Health())
    assert "STOPPED: the force rose" in line(last)
    assert line(last, last.cause).endswith("  STOPPED"), "the cause is in the previous line"


def test_chart_columns_reach_the_target() -> None:
    rising = [structs.replace(CYCLE, force=force) for force in (0.0, 25.0, 50.0)]
    rows = [line.plain for line in chart(model(*rising).snapshot(110.0, Health()), 60 + SCALE_WIDTH, 8)]
    last_three = [[row[column] for row in rows] for column in (-3, -2, -1)]
    assert [column.count("█") for column in last_three] == [0, 2, 5]  # 8 rows for 75 N
    assert "target" in rows[2]


def test_limit_is_drawn_when_force_approaches_it() -> None:
    def labels(force: float) -> str:
        pressed = [structs.replace(CYCLE, force=force, force_reference=10.0)] * 3
        view = ViewModel(Scene(10.0, ROBOT, 30.0, limits=Limits(force_limit_n=50.0)))
        for record in pressed:
            view.update(record)
        return "\n".join(line.plain for line in chart(view.snapshot(110.0, Health()), 60 + SCALE_WIDTH, 12))

    assert "┈" not in labels(20.0)
    assert "limit │┈" in labels(30.0)


def test_wide_view_fills_columns_and_stop_shows_no_green() -> None:
    view = model(*[CYCLE] * 60)
    right = [
        line[line.index(" │ ", 60) :]
        for line in text_of(view.snapshot(110.2, Health()), 200, 50).splitlines()[1:-4]
    ]
    assert sum("█" in line for line in right) > 10
    assert any("Depth along the approach" in line for line in right)
    assert any("Times of the cycle" in line for line in right)
    view.event(EventRecord(111.0, EventKind.STOP, "robot on serial:///dev/ttyS0 refused"))
    stopped = text_of(view.snapshot(111.0, Health()), 200, 50)
    assert "robot on serial:///dev/ttyS0 refused" in stopped
    assert "the run is stopped" in stopped
    assert "allow" not in stopped


def test_device_texts_are_escaped_for_the_terminal() -> None:
    evil = "\x1b[2J\x1b]0;evil\x07[bold]µ"
    view = model(structs.replace(CYCLE, verdict="stop", reasons=(evil,)))
    view.warn(evil)
    view.event(EventRecord(110.0, EventKind.FAULT, f"told {evil}"))
    view.event(EventRecord(110.1, EventKind.STOP, evil))
    snapshot = view.snapshot(110.2, Health())
    assert line(snapshot).isascii()
    assert line(snapshot).isprintable()
    terminal = io.StringIO()
    Console(width=180, height=32, file=terminal).print(panel(snapshot, 180, 32))
    assert not {"\x1b", "\x07"} & set(terminal.getvalue())
    assert "told \\x1b[2J\\x1b]0;evil\\x07[bold]µ" in terminal.getvalue()


def test_end_texts_are_escaped_for_the_terminal() -> None:
    stream = io.StringIO()
    with screen.Screen(stream) as lines:
        lines.say("stopped: \x1b[2J\n\tby\rit µ")
    assert stream.getvalue() == "stopped: \\x1b[2J\n\tby\\rit µ\n"


def test_plain_lines_each_second_and_on_phase_change() -> None:
    stream = io.StringIO()
    with LiveView(Scene(50.0, ROBOT, 30.0), stream) as view:
        for tick in range(40):
            if tick == 3:
                view.event(EventRecord(100.3, EventKind.PHASE, "approach"))
            if tick == 25:
                view.update(CYCLE)
            view.refresh(100.0 + tick / 10, Health(1, 2, None, {"time-out": 1, "bid sent": 9}))
    lines = stream.getvalue().splitlines()
    assert [(line.split()[0], line.split()[2]) for line in lines] == [
        ("0.0", "connect"),
        ("0.3", "approach"),
        ("1.0", "approach"),
        ("2.0", "approach"),
        ("2.5", "track"),
        ("3.0", "track"),
    ]
    assert "48.73 N of 50.00 N" in lines[-1]
    assert "link errors 1 (time-out 1)  frames lost 2  30 s to track" in lines[-1]
    assert stream.getvalue().isascii()


def test_terminal_is_redrawn_and_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    stream = Terminal()
    with LiveView(Scene(50.0, RobotFacts(), 30.0), stream) as view:
        view.update(CYCLE)
        view.refresh(110.0, Health())
        view.refresh(110.2, Health())
    view.close()
    assert stream.getvalue().count("48.73 N") == 3  # two refreshes and the last picture, which stays
    assert "\x1b[?25l" in stream.getvalue()
    assert stream.getvalue().rindex("\x1b[?25h") > stream.getvalue().rindex(
        "48.73 N"
    )  # the cursor is restored


@pytest.mark.parametrize("kind", [io.StringIO, Terminal])
def test_lost_terminal_does_not_end_the_run(kind: type[io.StringIO], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    stream = kind()
    view = LiveView(Scene(50.0, RobotFacts(), 30.0), stream)
    view.refresh(100.0, Health())
    stream.close()
    for tick in range(30):
        view.refresh(101.0 + tick, Health())
    view.close()
    assert view._gone


class Pauses(asyncio.Event):
    """Reports when a task waits for it."""

    def __init__(self) -> None:
        super().__init__()
        self.waited = asyncio.Event()

    async def wait(self) -> Literal[True]:
        self.waited.set()
        return await super().wait()


async def test_terminal_pause_at_end_does_not_block_view(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = TerminalView(screen.Terminal(), is_enabled=True, virtual=False)
    monkeypatch.setattr("hil_bridge.runs.terminal_view.health_of", lambda run: None)
    run: Any = SimpleNamespace(clock=Clock.running())
    view: Any = SimpleNamespace(refresh=lambda now, health: None)
    output._may_draw = pauses = Pauses()
    drawing = asyncio.create_task(output._refresh(view, run))
    await pauses.waited.wait()
    pauses.set()
    await asyncio.sleep(0)
    drawing.cancel()
    done, _ = await asyncio.wait({drawing}, timeout=5.0)
    run.clock.close()
    assert done
