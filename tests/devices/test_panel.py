"""The panel of an emulated controller over its control socket, and an emergency stop in mid-track."""

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from emulators.devices.s3 import S3_CONTROLS, read_state
from emulators.panel import Panel
from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.panel import (
    CLIENT_LIMIT,
    REQUEST_LIMIT,
    PanelServer,
    ask,
    decode,
    encode,
    faults_text,
    panel_address,
    state_text,
)
from hil_bridge.errors import ConfigError, DeviceError, TransportUnavailable
from hil_bridge.record import CycleRecord, EventKind, Outcome, read
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.runs.compose import emulated_cell, make_cell, open_devices
from hil_bridge.runs.notes import Notes
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import Config, read_config
from hil_bridge.transports.pump import Pump
from tests.paper_cell import CELL_FAULTS, PaperCell, PaperCellProfile, s3_jr3_cell

LOOPBACK = "tcp-listen://127.0.0.1:0"


def on_a_server(
    use: Callable[[str], Awaitable[None]], perform: Callable[[Any], Any] = lambda request: {"said": request}
) -> None:
    """Run `use` with the URL of a panel whose answers come from `perform`."""

    async def main() -> None:
        clock = Clock.running()
        server = PanelServer(perform, clock)
        try:
            await use(await server.listen(LOOPBACK))
        finally:
            await server.aclose()
            clock.close()

    run_real(main)


async def opened(url: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    host, _, port = url.removeprefix("tcp://").rpartition(":")
    return await asyncio.open_connection(host, int(port))


async def said_to(url: str, *lines: bytes) -> list[dict[str, Any]]:
    """All answers on one connection until it is closed by the other side, or after as many as lines."""
    reader, writer = await opened(url)
    writer.write(b"".join(lines))
    answers: list[dict[str, Any]] = []
    while len(answers) < len(lines) and (line := await reader.readline()):
        answers.append(json.loads(line))
    writer.close()
    await writer.wait_closed()
    return answers


def test_requests_of_one_connection_are_answered_in_turn() -> None:
    async def use(url: str) -> None:
        requests = [{"do": "show", "number": number} for number in range(200)]
        answers = await said_to(url, *map(encode, requests))
        assert answers == [{"said": request} for request in requests]

    on_a_server(use)


def test_a_request_may_come_in_pieces() -> None:
    async def use(url: str) -> None:
        reader, writer = await opened(url)
        for byte in b'{"do":"show"}\r\n':
            writer.write(bytes((byte,)))
            await writer.drain()
        assert await reader.readline() == b'{"said":{"do":"show"}}\n'
        writer.close()
        await writer.wait_closed()

    on_a_server(use)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (b"GET / HTTP/1.1\r\n", "not a line of JSON"),
        (b"[" * 1000 + b"\n", "not a line of JSON"),
        (b"\xff\n", "not a line of JSON"),
        (b"9" * 1000 + b"\n", "not a JSON object"),
        (b'["show"]\n', "not a JSON object"),
        (b"x" * (REQUEST_LIMIT + 1), "at most 1024 bytes"),
        (b"x" * 100_000 + b"\n", "at most 1024 bytes"),
    ],
)
def test_what_is_no_request_is_told_so_and_sent_away(line: bytes, text: str) -> None:
    async def use(url: str) -> None:
        reader, writer = await opened(url)
        writer.write(line)
        assert text in json.loads(await reader.readline())["error"]
        with suppress(ConnectionError):  # it had not read everything that we said
            assert await reader.read() == b""
        writer.close()
        assert await said_to(url, encode({})) == [{"said": {}}], "others are served"

    on_a_server(use)


def test_what_cannot_be_done_is_told_and_the_connection_goes_on() -> None:
    def perform(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "dance":
            raise ValueError("a robot cannot dance")
        return {}

    async def use(url: str) -> None:
        assert await said_to(url, encode({"do": "dance"}), encode({"do": "show"})) == [
            {"error": "a robot cannot dance"},
            {},
        ]

    on_a_server(use, perform)


def test_silent_clients_do_not_keep_the_next_one_out() -> None:
    async def use(url: str) -> None:
        silent = [await opened(url) for _ in range(3 * CLIENT_LIMIT)]
        assert await said_to(url, encode({})) == [{"said": {}}]
        for number, (reader, writer) in enumerate(silent):
            if number < 2 * CLIENT_LIMIT:
                assert "silent longest" in json.loads(await reader.readline())["error"]
                assert await reader.read() == b""
            writer.close()

    on_a_server(use)


def test_the_client_that_was_silent_longest_makes_room() -> None:
    async def use(url: str) -> None:
        there = [await opened(url) for _ in range(CLIENT_LIMIT)]
        for reader, writer in there[::-1]:  # the last that came is heard first
            writer.write(encode({}))
            assert await reader.readline() == b'{"said":{}}\n'
        assert await said_to(url, encode({})) == [{"said": {}}]
        assert "silent longest" in json.loads(await there[-1][0].readline())["error"]
        for reader, writer in there[:-1]:
            writer.write(encode({"still": "here"}))
            assert await reader.readline() == b'{"said":{"still":"here"}}\n'
        for _, writer in there:
            writer.close()

    on_a_server(use)


def test_clients_that_read_nothing_do_not_keep_the_next_one_out() -> None:
    async def use(url: str) -> None:
        deaf = [await opened(url) for _ in range(CLIENT_LIMIT)]
        for reader, writer in deaf:
            reader._transport.pause_reading()  # type: ignore[attr-defined]
            writer.write(encode({"much": "x" * 900}) * 20_000)
        for _ in range(500):
            await asyncio.sleep(0)
        assert await said_to(url, encode({})) == [{"said": {}}]
        for _, writer in deaf:
            writer.transport.abort()

    on_a_server(use)


def test_a_client_that_does_not_read_is_not_answered_for_ever() -> None:
    answered = 0

    def perform(request: dict[str, Any]) -> dict[str, Any]:
        nonlocal answered
        answered += 1
        return {"much": "x" * 50_000}

    async def use(url: str) -> None:
        _, writer = await opened(url)
        writer.write(encode({}) * 20_000)
        before = -1
        while answered != before:
            before = answered
            for _ in range(200):
                await asyncio.sleep(0)
        assert answered < 2000
        writer.transport.abort()

    on_a_server(use, perform)


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("tcp-listen://0.0.0.0:0", "this computer only"),
        ("tcp-listen://192.168.1.5:7000", "this computer only"),
        ("tcp-listen://example.org:7000", "this computer only"),
        ("tcp-listen://127.0.0.1:0?baudrate=9600", "no options"),
        ("tcp://127.0.0.1:7000", "tcp-listen"),
        ("pty:", "tcp-listen"),
    ],
)
def test_a_panel_listens_on_loopback_alone(url: str, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        panel_address(url)


def test_loopback_has_several_names() -> None:
    assert panel_address("tcp-listen://localhost:7000") == ("localhost", 7000)
    assert panel_address("tcp-listen://[::1]:0") == ("::1", 0)
    assert panel_address("tcp-listen://127.0.0.2:0") == ("127.0.0.2", 0)


def test_a_port_that_is_taken_is_named() -> None:
    async def use(url: str) -> None:
        taken = url.replace("tcp:", "tcp-listen:")
        with pytest.raises(TransportUnavailable, match="another program already listens on this port"):
            await PanelServer(dict, Clock.running()).listen(taken)

    on_a_server(use)


def test_an_answer_of_another_program_is_no_answer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        url = f"tcp://127.0.0.1:{other.getsockname()[1]}"

        async def main() -> None:
            async def answer() -> None:
                connection, _ = await asyncio.to_thread(other.accept)
                connection.sendall(b"SSH-2.0-something\r\n")
                connection.close()

            asking = asyncio.create_task(asyncio.to_thread(ask, url, {"do": "show"}))
            await answer()
            with pytest.raises(DeviceError, match="is not a panel"):
                await asking

        asyncio.run(main())
    with pytest.raises(TransportUnavailable, match="no panel answers"):
        ask(url, {"do": "show"})
    with pytest.raises(ConfigError, match="tcp"):
        ask("show", {"do": "show"})


def test_lines_are_read_strictly() -> None:
    assert decode(encode({"do": "show"})[:-1]) == {"do": "show"}
    for line in (b"", b"{", b"1", b"null"):
        with pytest.raises(ValueError, match="no"):
            decode(line)


def test_each_act_at_the_panel_wakes_robot_and_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    """A device that sleeps until a deadline of its own would tell only then what has happened."""
    woken: list[Pump[Any, Any]] = []
    monkeypatch.setattr(Pump, "kick", lambda pump: woken.append(pump))

    async def main() -> None:
        clock = Clock.running()
        listen = Listen("s3+memory:robot", "jr3+can+memory:sensor", LOOPBACK)
        try:
            async with emulated_cell(
                Setup(Config(), listen), clock, lambda cause: pytest.fail(repr(cause))
            ) as served:
                assert served.panel is not None
                for request in (b'{"do": "key", "to": "manual"}\n', b'{"do": "key", "to": "auto"}\n'):
                    woken.clear()
                    await said_to(served.panel, request)
                    assert len({*map(id, woken)}) == 2
        finally:
            clock.close()

    run_real(main)


def on_a_cell(use: Callable[[str, PaperCell], Awaitable[None]], **sections: Any) -> None:
    """Run `use` with the panel's URL of a served cell, and the cell."""
    config = read_config(sections)

    async def main() -> None:
        clock = Clock.running()
        try:
            async with emulated_cell(
                Setup(config, Listen("s3+memory:robot", None, LOOPBACK)),
                clock,
                lambda cause: pytest.fail(repr(cause)),
            ) as served:
                assert served.panel is not None
                await use(served.panel, served.cell)
        finally:
            clock.close()

    run_real(main)


def invoke(url: str, *arguments: str) -> str:
    result = CliRunner().invoke(cli, ["panel", url, *arguments])
    assert result.exception is None, result.exception
    return result.output


def test_every_command_reaches_the_controller() -> None:
    def flags(cell: PaperCell) -> list[bool]:
        state = cell.robot.state
        return [
            state.emergency_stop,
            state.key_auto,
            state.link_control,
            state.work_stop,
            state.programming_unit,
            state.interrupt_permitted,
        ]

    async def use(url: str, cell: PaperCell) -> None:
        async def do(*arguments: str) -> str:
            return await asyncio.to_thread(invoke, url, *arguments)

        before = flags(cell)
        assert await do() == await do("show")
        for there, back in (
            (("emergency-stop",), ("emergency-stop", "release")),
            (("key", "manual"), ("key", "auto")),
            (("link-control", "take"), ("link-control", "give")),
            (("work-stop", "on"), ("work-stop", "off")),
            (("programming-unit", "connect"), ("programming-unit", "remove")),
            (("interrupt", "permit"), ("interrupt", "forbid")),
        ):
            await do(*there)
            assert sum(a != b for a, b in zip(flags(cell), before, strict=True)) == 1
            await do(*back)
            assert flags(cell) == before
        assert "drop-ack of a bid (2)" in await do("inject", "drop-ack", "of=bid", "count=2")
        assert "standby" in (await do("show")).splitlines()[0]
        assert "none waiting" in await do("disarm")
        assert "signal: scale" in await do("inject", "signal", "scale", "axis=fz", "factor=0.5")
        assert cell.faults[-1].values == {"axis": "fz", "factor": 0.5}
        assert "lasting       none" in await do("mend")
        await do("inject", "line-break", "for_s=0.001")
        assert cell.faults[-1].name == "wire: line-break"
        listed = await do("faults")
        for target, faults in CELL_FAULTS.items():
            assert f"\n{target}\n" in f"\n{listed}"
            assert all(f"\n  {name} " in listed for name in faults)
        for arguments, text in (
            (("inject", "drop-ack", "off=bid"), "drop-ack has no parameter 'off'"),
            (("inject", "flood"), "no fault is called 'flood'"),
            (("inject", "signal", "flood"), "this signal cannot have 'flood'"),
            (("inject", "bus", "off"), "this cell cannot have bus: off"),
        ):
            with pytest.raises(ConfigError, match=text):
                await asyncio.to_thread(ask_as_cli, url, *arguments)
        await do("inject", "power-cycle")
        assert "starting" in await do("show")

    on_a_cell(use)


def ask_as_cli(url: str, *arguments: str) -> None:
    cli.main(["panel", url, *arguments], standalone_mode=False)


def test_a_parameter_without_a_value_is_a_usage_error() -> None:
    result = CliRunner().invoke(cli, ["panel", "tcp://127.0.0.1:1", "inject", "stands", "for_s"])
    assert result.exit_code == 2
    assert "NAME=VALUE" in result.output


def test_what_is_shown_can_be_read_and_survives_an_odd_answer() -> None:
    cell = s3_jr3_cell(PaperCellProfile(), 100.0, 1)
    cell.robot.press_emergency_stop(100.0)
    shown = json.loads(json.dumps(Panel(cell.robot, S3_CONTROLS, cell.ledger).perform({"do": "show"}, 101.0)))
    lines = state_text(shown).splitlines()
    assert lines[0] == "mode          standby"
    assert lines[1] == "state         EMERGENCY STOP, key in AUTO, link control given"
    assert "   900.000  -100.000   600.000 mm reported" in lines[4]
    assert all(len(line) < 100 for line in lines)
    odd: dict[str, Any]
    for odd in ({}, {"rows": []}, {"rows": {}}):
        assert state_text(odd) == "–"
    assert state_text({"rows": {"mode\nx": ["y"], "a": "1\n2"}}) == "mode          ['y']\na             1"
    assert faults_text({}) == ""
    assert faults_text({"robot": {"meaning": "flat"}, "link": 3}) == "robot"


def test_a_panel_has_no_place_in_virtual_time_or_at_a_real_robot() -> None:
    for robot in ("", "s3+tcp://127.0.0.1:1"):
        config = read_config({"run": {"panel_url": LOOPBACK}, "robot": {"url": robot}})

        async def main(config: Config = config) -> None:
            async with open_devices(Setup(config), Clock.running(), CallbackLog()):
                pass

        with pytest.raises(ConfigError, match="--panel"):
            run_virtual(main)


def test_what_is_done_at_the_panel_is_told_to_the_record() -> None:
    cell = s3_jr3_cell(PaperCellProfile(), 100.0, 1)
    said: list[str] = []
    cell.ledger.on_fault = lambda news: said.append(news.text)
    board = Panel(cell.robot, S3_CONTROLS, cell.ledger)
    board.perform({"do": "key", "to": "manual"}, 101.0)
    board.perform({"do": "inject", "target": "surface", "fault": "rises", "with": {"for_s": "2"}}, 101.0)
    assert board.show(102.0)["state"]["lasting"] == ("surface: rises",)
    board.perform({"do": "mend"}, 102.5)
    assert said == [
        "robot: key manual at the panel",
        "surface: rises (mm_s 2) begins for 2 s",
        "surface: rises ends",
    ]
    assert cell.faults[0].ended_at == 102.5


def test_a_cell_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    config = read_config({"cell": {"start_position_mm": (3000.0, 0.0, 0.0)}})
    with pytest.raises(ConfigError, match="cell: the start position"):
        execute(config, True, Outputs(), False)
    (tmp_path / "7.prg").write_text("# emulated program\ndance\n")
    config = read_config({"cell": {"s3": {"robot": {"program_folder": str(tmp_path)}}}})
    with pytest.raises(ConfigError, match="cell: program 7: line 2: expected"):
        execute(config, True, Outputs(), False)


# --- an emergency stop in mid-track


@pytest.mark.full
@pytest.mark.parametrize("offset_ms", [0, 10, 35, 60, 80, 100, 130])
def test_an_emergency_stop_ends_the_orders_and_is_latched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], offset_ms: int
) -> None:
    """Pressed at several places of a cycle of 156 ms: also between a status that knows nothing yet and its move."""
    cells: list[PaperCell] = []
    pressed: list[float] = []

    def made(*arguments: Any) -> PaperCell:
        cells.append(make_cell(*arguments))
        return cells[0]

    monkeypatch.setattr("hil_bridge.runs.compose.make_cell", made)
    told = Notes._cycle

    def cycle(self: Any, record: CycleRecord) -> None:
        told(self, record)
        if record.phase == "track" and not pressed:
            pressed.append(record.answered_at + 1.0 + offset_ms / 1000.0)
            loop = asyncio.get_running_loop()
            loop.call_at(pressed[0], lambda: cells[0].robot.press_emergency_stop(loop.time()))

    monkeypatch.setattr(Notes, "_cycle", cycle)
    record = tmp_path / "r.mcap"
    code = execute(Config(), True, Outputs(record, tmp_path / "s.json"), False)
    assert code == 3
    assert "emergency stop" in capsys.readouterr().err
    recording = read(record)
    assert not recording.truncated
    assert recording.cycles[-1].answered_at < pressed[0] + 0.2, "no order was taken after it"
    texts = [event.text for event in recording.events]
    assert any("operational error 13.0" in text for text in texts)
    summary = summarise(recording)
    assert summary.outcome == Outcome.STOPPED
    refusal = "refused order 24: 13 stop or emergency stop; release the stop"
    causes = [event.text for event in recording.events if event.kind in (EventKind.STOP, EventKind.THEN)]
    assert summary.text == causes[0]
    assert any(refusal in text for text in causes), "by the refusal, or by a status that knew before"
    assert json.loads((tmp_path / "s.json").read_text())["text"] == summary.text
    stood = cells[0].true_state(pressed[0] + 1.0)
    assert stood.velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    shown = read_state(cells[0].robot, pressed[0] + 1.0)
    assert (shown.points_waiting, shown.activity) == (0, "none")
    assert shown.last_refusal == "move: 13 stop or emergency stop"
    assert 2 <= shown.refused <= 20, "the move, its repetitions with patience, and the end of the sequence"
