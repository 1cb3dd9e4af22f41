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


async def open_connection(url: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    host, _, port = url.removeprefix("tcp://").rpartition(":")
    return await asyncio.open_connection(host, int(port))


async def exchange(url: str, *lines: bytes) -> list[dict[str, Any]]:
    """Return all answers on one connection until the peer closes it, or after one per line."""
    reader, writer = await open_connection(url)
    writer.write(b"".join(lines))
    answers: list[dict[str, Any]] = []
    while len(answers) < len(lines) and (line := await reader.readline()):
        answers.append(json.loads(line))
    writer.close()
    await writer.wait_closed()
    return answers


def test_panel_answers_requests_in_order() -> None:
    async def use(url: str) -> None:
        requests = [{"do": "show", "number": number} for number in range(200)]
        answers = await exchange(url, *map(encode, requests))
        assert answers == [{"said": request} for request in requests]

    on_a_server(use)


def test_panel_accepts_request_in_pieces() -> None:
    async def use(url: str) -> None:
        reader, writer = await open_connection(url)
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
def test_panel_disconnects_client_without_request(line: bytes, text: str) -> None:
    async def use(url: str) -> None:
        reader, writer = await open_connection(url)
        writer.write(line)
        assert text in json.loads(await reader.readline())["error"]
        with suppress(ConnectionError):  # it had not read all requests
            assert await reader.read() == b""
        writer.close()
        assert await exchange(url, encode({})) == [{"said": {}}], "other clients are served"

    on_a_server(use)


def test_panel_reports_refused_request_and_continues() -> None:
    def perform(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "dance":
            raise ValueError("a robot cannot dance")
        return {}

    async def use(url: str) -> None:
        assert await exchange(url, encode({"do": "dance"}), encode({"do": "show"})) == [
            {"error": "a robot cannot dance"},
            {},
        ]

    on_a_server(use, perform)


def test_panel_silent_clients_do_not_block_others() -> None:
    async def use(url: str) -> None:
        silent = [await open_connection(url) for _ in range(3 * CLIENT_LIMIT)]
        assert await exchange(url, encode({})) == [{"said": {}}]
        for number, (reader, writer) in enumerate(silent):
            if number < 2 * CLIENT_LIMIT:
                assert "silent longest" in json.loads(await reader.readline())["error"]
                assert await reader.read() == b""
            writer.close()

    on_a_server(use)


def test_panel_replaces_longest_silent_client() -> None:
    async def use(url: str) -> None:
        connections = [await open_connection(url) for _ in range(CLIENT_LIMIT)]
        for reader, writer in connections[::-1]:  # the newest client is served first
            writer.write(encode({}))
            assert await reader.readline() == b'{"said":{}}\n'
        assert await exchange(url, encode({})) == [{"said": {}}]
        assert "silent longest" in json.loads(await connections[-1][0].readline())["error"]
        for reader, writer in connections[:-1]:
            writer.write(encode({"still": "here"}))
            assert await reader.readline() == b'{"said":{"still":"here"}}\n'
        for _, writer in connections:
            writer.close()

    on_a_server(use)


def test_panel_clients_that_do_not_read_do_not_block_others() -> None:
    async def use(url: str) -> None:
        deaf = [await open_connection(url) for _ in range(CLIENT_LIMIT)]
        for reader, writer in deaf:
            reader._transport.pause_reading()  # type: ignore[attr-defined]
            writer.write(encode({"much": "x" * 900}) * 20_000)
        for _ in range(500):
            await asyncio.sleep(0)
        assert await exchange(url, encode({})) == [{"said": {}}]
        for _, writer in deaf:
            writer.transport.abort()

    on_a_server(use)


def test_panel_stops_answering_client_that_does_not_read() -> None:
    answered = 0

    def perform(request: dict[str, Any]) -> dict[str, Any]:
        nonlocal answered
        answered += 1
        return {"much": "x" * 50_000}

    async def use(url: str) -> None:
        _, writer = await open_connection(url)
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
def test_panel_listens_on_loopback_only(url: str, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        panel_address(url)


def test_panel_accepts_all_loopback_names() -> None:
    assert panel_address("tcp-listen://localhost:7000") == ("localhost", 7000)
    assert panel_address("tcp-listen://[::1]:0") == ("::1", 0)
    assert panel_address("tcp-listen://127.0.0.2:0") == ("127.0.0.2", 0)


def test_panel_busy_port_is_named() -> None:
    async def use(url: str) -> None:
        busy = url.replace("tcp:", "tcp-listen:")
        with pytest.raises(TransportUnavailable, match="another program already listens on this port"):
            await PanelServer(dict, Clock.running()).listen(busy)

    on_a_server(use)


def test_panel_client_refuses_answer_of_other_program() -> None:
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


def test_panel_lines_are_parsed_strictly() -> None:
    assert decode(encode({"do": "show"})[:-1]) == {"do": "show"}
    for line in (b"", b"{", b"1", b"null"):
        with pytest.raises(ValueError, match="no"):
            decode(line)


def test_panel_request_wakes_robot_and_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise a sleeping device would report the change only at its next deadline."""
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
                    await exchange(served.panel, request)
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


def test_panel_commands_reach_controller() -> None:
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
        for action, reversal in (
            (("emergency-stop",), ("emergency-stop", "release")),
            (("key", "manual"), ("key", "auto")),
            (("link-control", "take"), ("link-control", "give")),
            (("work-stop", "on"), ("work-stop", "off")),
            (("programming-unit", "connect"), ("programming-unit", "remove")),
            (("interrupt", "permit"), ("interrupt", "forbid")),
        ):
            await do(*action)
            assert sum(a != b for a, b in zip(flags(cell), before, strict=True)) == 1
            await do(*reversal)
            assert flags(cell) == before
        assert "drop-ack of a bid (2)" in await do("inject", "drop-ack", "of=bid", "count=2")
        assert "standby" in (await do("show")).splitlines()[0]
        assert "none waiting" in await do("disarm")
        assert "signal: scale" in await do("inject", "signal", "scale", "axis=fz", "factor=0.5")
        assert cell.faults[-1].values == {"axis": "fz", "factor": 0.5}
        assert "lasting       none" in await do("mend")
        await do("inject", "line-break", "for_s=0.001")
        assert cell.faults[-1].name == "wire: line-break"
        fault_list = await do("faults")
        for target, faults in CELL_FAULTS.items():
            assert f"\n{target}\n" in f"\n{fault_list}"
            assert all(f"\n  {name} " in fault_list for name in faults)
        for arguments, text in (
            (("inject", "drop-ack", "off=bid"), "drop-ack has no parameter 'off'"),
            (("inject", "flood"), "unknown fault 'flood'"),
            (("inject", "signal", "flood"), "unknown fault 'flood' for target 'signal'"),
            (("inject", "bus", "off"), "this cell cannot have bus: off"),
        ):
            with pytest.raises(ConfigError, match=text):
                await asyncio.to_thread(ask_as_cli, url, *arguments)
        await do("inject", "power-cycle")
        assert "starting" in await do("show")

    on_a_cell(use)


def ask_as_cli(url: str, *arguments: str) -> None:
    cli.main(["panel", url, *arguments], standalone_mode=False)


def test_panel_parameter_without_value_is_usage_error() -> None:
    result = CliRunner().invoke(cli, ["panel", "tcp://127.0.0.1:1", "inject", "stands", "for_s"])
    assert result.exit_code == 2
    assert "NAME=VALUE" in result.output


def test_panel_text_tolerates_unexpected_answer() -> None:
    cell = s3_jr3_cell(PaperCellProfile(), 100.0, 1)
    cell.robot.press_emergency_stop(100.0)
    state = json.loads(json.dumps(Panel(cell.robot, S3_CONTROLS, cell.ledger).perform({"do": "show"}, 101.0)))
    lines = state_text(state).splitlines()
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


def test_panel_needs_emulated_robot_in_real_time() -> None:
    for robot in ("", "s3+tcp://127.0.0.1:1"):
        config = read_config({"run": {"panel_url": LOOPBACK}, "robot": {"url": robot}})

        async def main(config: Config = config) -> None:
            async with open_devices(Setup(config), Clock.running(), CallbackLog()):
                pass

        with pytest.raises(ConfigError, match="--panel"):
            run_virtual(main)


def test_panel_requests_are_recorded() -> None:
    cell = s3_jr3_cell(PaperCellProfile(), 100.0, 1)
    notices: list[str] = []
    cell.ledger.on_fault = lambda news: notices.append(news.text)
    board = Panel(cell.robot, S3_CONTROLS, cell.ledger)
    board.perform({"do": "key", "to": "manual"}, 101.0)
    board.perform({"do": "inject", "target": "surface", "fault": "rises", "with": {"for_s": "2"}}, 101.0)
    assert board.show(102.0)["state"]["lasting"] == ("surface: rises",)
    board.perform({"do": "mend"}, 102.5)
    assert notices == [
        "robot: key manual at the panel",
        "surface: rises (mm_s 2) begins for 2 s",
        "surface: rises ends",
    ]
    assert cell.faults[0].ended_at == 102.5


def test_panel_of_invalid_cell_is_one_line(tmp_path: Path) -> None:
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
def test_panel_emergency_stop_is_latched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], offset_ms: int
) -> None:
    """Pressed at several times of a cycle of 156 ms, also between a status without the stop and the move after it."""
    cells: list[PaperCell] = []
    pressed: list[float] = []

    def made(*arguments: Any) -> PaperCell:
        cells.append(make_cell(*arguments))
        return cells[0]

    monkeypatch.setattr("hil_bridge.runs.compose.make_cell", made)
    record_cycle = Notes._cycle

    def cycle(self: Any, record: CycleRecord) -> None:
        record_cycle(self, record)
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
    assert recording.cycles[-1].answered_at < pressed[0] + 0.2, "no order was accepted after the stop"
    texts = [event.text for event in recording.events]
    assert any("operational error 13.0" in text for text in texts)
    summary = summarise(recording)
    assert summary.outcome == Outcome.STOPPED
    refusal = "refused order 24: 13 stop or emergency stop; its status is now: emergency stop, in standby; "
    remedy = "; release the stop at the controller's panel, then start again"
    causes = [event.text for event in recording.events if event.kind in (EventKind.STOP, EventKind.THEN)]
    assert summary.text == causes[0]
    stated = any(refusal in text and remedy in text for text in causes)
    assert stated, "detected by the refusal, or by an earlier status"
    assert json.loads((tmp_path / "s.json").read_text())["text"] == summary.text
    position = cells[0].true_state(pressed[0] + 1.0)
    assert position.velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    state = read_state(cells[0].robot, pressed[0] + 1.0)
    assert (state.points_waiting, state.activity) == (0, "none")
    assert state.last_refusal == "move: 13 stop or emergency stop"
    assert 2 <= state.refused <= 20, "the move, its repetitions with patience, and the end of the sequence"
