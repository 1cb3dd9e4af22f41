"""A board's registers from outside: URLs, a sensor behind them, a PCI board whose memory is a file."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from emulators.devices.jr3 import Jr3Sensor, SensorProfile
from emulators.devices.jr3.board import Board, BoardProfile, IsaPorts, IsaProfile
from emulators.sensing import KnownWrench
from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import LogTo
from hil_bridge.devices.sensors.jr3.registers import (
    ListenerProfile,
    Watcher,
    board_wire,
    connect_board,
    open_pci,
    read_program,
    serve_board,
)
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import BridgeError, ConfigError, DeviceError, TransportUnavailable
from hil_bridge.record import CycleRecord, EventRecord, Outcome, SensorRecord
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.runs.watching import Listener
from hil_bridge.settings.configuration import read_config
from protocol.devices.jr3.board import REGISTERS, Registers, check_range, pack_words, to_signed
from protocol.devices.jr3.registers import (
    BoardClient,
    BoardClientProfile,
    Op,
    ProgramWord,
    Read,
    Request,
    Reset,
    ResetRefused,
    Response,
    Status,
    Wait,
    Write,
    encode_request,
    response_reader,
    start_up,
)
from protocol.endpoint import RemoteProtocolError
from protocol.wrench import WrenchFrame


class Memory:
    """A board of plain words that does every command at once, and counts filter2's outputs."""

    def __init__(self) -> None:
        self.words = [0] * 0x4000
        self.begin: float | None = None
        for name, values in {
            "serial_no": (1,),
            "model_no": (2,),
            "units": (1,),
            "max_full_scale": (200, 200, 400, 50, 50, 60),
            "filter2": (0, 0, 0xF000, 0, 0, 0, 0, 0),
        }.items():
            at = REGISTERS[name].address
            self.words[at : at + len(values)] = values

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        check_range(address, count)
        self.begin = self.begin or now
        self.words[0xE9] = round((now - self.begin) * 2000) % 65536
        return tuple(self.words[address : address + count])

    def load(self, address: int, words: Sequence[int], now: float) -> None:
        raise RemoteProtocolError("this board takes no program")

    def burst(self, address: int, count: int, now: float) -> bytes:
        return pack_words(self.read(address, count, now))

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        check_range(address, len(words))
        self.words[address : address + len(words)] = words
        self.words[0xE7] = 0

    def reset(self, now: float) -> None:
        pass


# --- URLs


def test_a_board_url_is_a_byte_wire_and_a_filter() -> None:
    profile = BoardClientProfile()
    assert board_wire("tcp://127.0.0.1:1762", profile) == ("tcp://127.0.0.1:1762", profile)
    assert board_wire("tcp://[::1]:1762?filter=5", profile) == (
        "tcp://[::1]:1762",
        BoardClientProfile(filter=5),
    )
    assert board_wire("memory:b?filter=0&latency_ms=2", profile) == (
        "memory:b?latency_ms=2",
        BoardClientProfile(filter=0),
    )


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("tcp://h:1?filter=7", "filter must be at most 6, got 7"),
        ("tcp://h:1?filter=x", "filter must be a whole number, got 'x'"),
        ("tcp://h:1?filter=1&filter=2", "'filter' is given twice"),
        ("tcp://h:1?reconnect_s=5", "reconnect_s means nothing here"),
        ("tcp://h:1?rate=1", "unknown option 'rate'"),
        ("tcp://h", "host and port"),
        (
            "serial:///dev/ttyS0",
            r"'serial:///dev/ttyS0': unknown scheme 'serial'; allowed: tcp",
        ),
        ("tcp://[h", "Invalid IPv6"),
    ],
)
def test_wrong_board_urls(url: str, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        board_wire(url, BoardClientProfile())


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("pty:", "unknown scheme 'pty'; allowed: tcp-listen, memory"),
        ("tcp-listen://127.0.0.1:0?baudrate=9600", "a board's wire has no baud rate"),
    ],
)
def test_wrong_listening_urls(url: str, text: str) -> None:
    async def main() -> None:
        await serve_board(url, Memory(), ListenerProfile(), Clock.running(), Watcher(print, print))

    with pytest.raises(ConfigError, match=text):
        run_virtual(main)


# --- a sensor in virtual time


def test_a_sensor_behind_registers_in_virtual_time() -> None:
    frames: list[WrenchFrame] = []

    async def main() -> tuple[float, ...] | None:
        clock = Clock.running()
        logged: list[str] = []
        served = await serve_board(
            "memory:b",
            Memory(),
            ListenerProfile(),
            clock,
            Watcher(logged.append, logged.append),  # type: ignore[arg-type]
        )
        assert served.address == "memory:b"
        wire, profile = await connect_board("memory:b?filter=2", BoardClientProfile(), clock)
        begin = clock.now()
        sensor = ForceSensor(wire, BoardClient(profile, begin), clock, LogTo(frames.append))
        sensor.start()
        scales = (await sensor.ready()).full_scales
        assert clock.now() - begin == pytest.approx(10.224, abs=1e-3)
        await sensor.tare()
        await clock.sleep_until(clock.now() + 1.0)
        await sensor.aclose()
        sent = len(frames)
        await clock.sleep_until(clock.now() + 1.0)
        assert len(frames) == sent
        await served.aclose()
        assert logged == []
        return scales

    assert run_virtual(main) == (200.0, 200.0, 400.0, 5.0, 5.0, 6.0)
    assert len(frames) == pytest.approx(112, abs=1)
    assert frames[-1].values == (0, 0, -4096, 0, 0, 0)


def test_a_memory_wire_survives_a_lost_client() -> None:
    async def main() -> list[str]:
        clock, logged, heard = Clock.running(), list[str](), list[bytes]()
        served = await serve_board(
            "memory:b",
            Memory(),
            ListenerProfile(),
            clock,
            Watcher(logged.append, logged.append),  # type: ignore[arg-type]
        )
        wire, _ = await connect_board("memory:b", BoardClientProfile(), clock)
        wire.start(heard.append, lambda error: None)
        wire.send(b"HELO")
        await clock.sleep_until(clock.now() + 0.1)
        wire.send(encode_request(Request(Op.READ, 1, 0xF8, 1)))
        await clock.sleep_until(clock.now() + 100.0)
        await wire.aclose()
        await served.aclose()
        statuses = [
            item.status for item in response_reader().feed(b"".join(heard)) if isinstance(item, Response)
        ]
        assert statuses == [Status.BAD_FRAME, Status.OK]
        return logged

    assert run_virtual(main) == ["memory:b: no request begins with 48"]


# --- a PCI board whose memory is a file

BLOCK = 0x80000


@pytest.fixture
def sysfs(tmp_path: Path) -> Path:
    """One board of two channels."""
    folder = tmp_path / "0000:03:00.0"
    folder.mkdir()
    (folder / "vendor").write_text("0x1762\n")
    (folder / "device").write_text("0x3112\n")
    (folder / "enable").write_text("1\n")
    (folder / "resource0").write_bytes(bytes(2 * BLOCK))
    return tmp_path


def put(sysfs: Path, byte: int, *values: int) -> None:
    with (sysfs / "0000:03:00.0" / "resource0").open("r+b") as file:
        file.seek(byte)
        for value in values:
            file.write(value.to_bytes(4, "little"))


def get(sysfs: Path, byte: int) -> int:
    data = (sysfs / "0000:03:00.0" / "resource0").read_bytes()
    return int.from_bytes(data[byte : byte + 4], "little")


@pytest.mark.parametrize("address", ["0000:03:00.0", "03:00.0"])
@pytest.mark.parametrize(("channel", "offset"), [(0, 0x18000), (1, 0x18000), (1, 0x10000)])
def test_words_lie_every_four_bytes_of_a_channel(
    sysfs: Path, address: str, channel: int, offset: int
) -> None:
    at = channel * BLOCK + offset
    put(sysfs, at + 4 * 0x90, 0xDEAD4000, 0x0000FFFF)
    board = open_pci(address, channel, offset, sysfs=sysfs)
    assert board.read(0x90, 3) == (0x4000, 0xFFFF, 0)
    board.write(0xE5, (1, 2, 0x0800))
    board.close()
    board.close()
    assert [get(sysfs, at + 4 * word) for word in (0xE5, 0xE6, 0xE7)] == [1, 2, 0x0800]


def test_the_copyright_shows_where_the_words_lie(sysfs: Path) -> None:
    put(sysfs, 0x18000 + 4 * 0x40, *(ord(letter) << 8 for letter in "Copyright  JR3,  Inc   1994"[:24]))
    board = open_pci("03:00.0", sysfs=sysfs)
    assert board.text == "Copyright JR3, Inc 1"
    board.close()
    elsewhere = open_pci("03:00.0", offset=0x10000, sysfs=sysfs)
    assert elsewhere.text == ""
    elsewhere.close()


def test_words_outside_the_block_are_refused(sysfs: Path) -> None:
    board = open_pci("03:00.0", offset=0x3FF00, sysfs=sysfs)
    assert board.read(0x3F, 1) == (0,)
    for address, count in ((0x40, 1), (0x3F, 2), (-1, 1), (0, 0)):
        with pytest.raises(RemoteProtocolError):
            board.read(address, count)
    with pytest.raises(RemoteProtocolError):
        board.write(0x40, (1,))
    board.close()


def test_a_reset_needs_the_boards_program(sysfs: Path) -> None:
    board = open_pci("03:00.0", channel=1, sysfs=sysfs)
    with pytest.raises(ResetRefused, match="no program file was given"):
        board.reset()
    board.close()
    put(sysfs, BLOCK + 0x60000, 77)
    program = (ProgramWord(0, 0x1234, 0x56), ProgramWord(0x3FFF, 0xABCD, 0xEF))
    board = open_pci("03:00.0", channel=1, program=program, sysfs=sysfs)
    board.reset()
    board.close()
    at = [BLOCK + byte for byte in (0x60000, 0, 0x40000, 4 * 0x3FFF, 0x40000 + 4 * 0x3FFF)]
    assert [get(sysfs, byte) for byte in at] == [0, 0x1234, 0x56, 0xABCD, 0xEF]


def test_a_client_s_program_goes_where_the_board_s_own_does(sysfs: Path) -> None:
    put(sysfs, BLOCK + 0x60000, 77)
    board = open_pci("03:00.0", channel=1, sysfs=sysfs)
    board.load(0, ())
    board.load(0x3FFE, (0x1234, 0x56, 0xABCD, 0xEF))
    with pytest.raises(RemoteProtocolError, match="not within the program's memory"):
        board.load(0x3FFF, (1, 2, 3, 4))
    board.close()
    at = [BLOCK + byte for byte in (0x60000, 4 * 0x3FFE, 4 * 0x3FFF, 0x40000 + 4 * 0x3FFF)]
    assert [get(sysfs, byte) for byte in at] == [0, 0x1234, 0xABCD, 0xEF]


@pytest.mark.parametrize(
    ("text", "says"), [(None, "cannot read"), ("0002 0000 1 2", "is no board program: it has no end mark")]
)
def test_a_run_with_a_wrong_program_is_refused_in_one_line(
    tmp_path: Path, text: str | None, says: str
) -> None:
    path, config = tmp_path / "p.idm", tmp_path / "run.toml"
    if text is not None:
        path.write_text(text)
    config.write_text(f'[sensor]\nemulated = "jr3-board"\n[sensor.jr3.board]\nprogram = "{path}"\n')
    ended = CliRunner().invoke(cli, ["run", str(config), "--virtual", "--no-view"])
    assert isinstance(ended.exception, ConfigError)
    assert says in str(ended.exception)
    assert "\n" not in str(ended.exception)


def test_a_run_loads_the_program_of_its_settings(tmp_path: Path) -> None:
    path, config = tmp_path / "p.idm", tmp_path / "run.toml"
    path.write_text("0002 0000 1 2 ffff")
    config.write_text(
        f'[sensor]\nemulated = "jr3-board"\n[sensor.jr3.board]\nprogram = "{path}"\n[run]\nduration_s = 1.0\n'
    )
    loaded: list[tuple[int, ...]] = []
    with mock.patch.object(Board, "load", lambda self, address, words, now: loaded.append((address, *words))):
        ended = CliRunner().invoke(cli, ["run", str(config), "--virtual", "--no-view"])
    assert ended.exit_code == 0, ended.stderr
    assert loaded == [(0,), (0, 1, 2)]


def test_a_program_file(tmp_path: Path) -> None:
    path = tmp_path / "jr3pci.idm"
    path.write_text("0004\n0010\n1111 0022\n3333 0044\n0002\n4000\n9999 9999\n0002 0000\n5555 0066\nffff\n")
    assert read_program(path) == (
        ProgramWord(0x10, 0x1111, 0x22),
        ProgramWord(0x11, 0x3333, 0x44),
        ProgramWord(0, 0x5555, 0x66),
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("0004 0010 1111 0022", "has no end mark"),
        ("0001 0010 1111 ffff", "1 words for 0x0010"),
        ("0004 3fff 1 2 3 4 ffff", "4 words for 0x3fff"),
        ("0002 0000 12345 0 ffff", "2 words for 0x0000"),
        ("ffff", "it is empty"),
        ("µ", "is no text in ascii"),
    ],
)
def test_what_is_no_program(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "p.idm"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=says):
        read_program(path)
    with pytest.raises(ConfigError, match="cannot read"):
        read_program(tmp_path / "nothing")


def change(name: str, text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(text)


@pytest.mark.parametrize(
    ("spoil", "options", "kind", "says"),
    [
        (
            None,
            {"address": "3:0"},
            ConfigError,
            "an address is like 0000:03:00.0, got '3:0'; `lspci -d 1762:`",
        ),
        (None, {"address": "03:00.9"}, ConfigError, "an address is like"),
        (None, {"address": "../../x"}, ConfigError, "an address is like"),
        (None, {"address": "04:00.0"}, TransportUnavailable, "PCI device 0000:04:00.0: there is none"),
        (None, {"channel": 2}, ConfigError, r"--channel: this board \(1762:3112\) has 0, 1, got 2"),
        (None, {"channel": -1}, ConfigError, "--channel"),
        (None, {"offset": 0x18001}, ConfigError, "--offset: a multiple of 4 below 0x40000, got 0x18001"),
        (None, {"offset": 0x40000}, ConfigError, "--offset"),
        (change("vendor", "0x8086\n"), {}, DeviceError, "0000:03:00.0 is 8086:3112, not a JR3 board"),
        (change("device", "0x1112\n"), {}, DeviceError, "is 1762:1112, not a JR3 board"),
        (change("device", "?\n"), {}, TransportUnavailable, "cannot tell what it is from"),
        (change("enable", "0\n"), {}, DeviceError, "is switched off"),
        (change("resource0", "x"), {}, DeviceError, "has 1 bytes, channel 0 needs 524288"),
        (lambda folder: (folder / "resource0").unlink(), {}, TransportUnavailable, "it has no memory to map"),
    ],
)
def test_wrong_boards_are_one_clear_line(
    sysfs: Path,
    spoil: Callable[[Path], object] | None,
    options: dict[str, object],
    kind: type[BridgeError],
    says: str,
) -> None:
    if spoil is not None:
        spoil(sysfs / "0000:03:00.0")
    with pytest.raises(kind, match=says) as caught:
        open_pci(**{"address": "03:00.0", "sysfs": sysfs, **options})  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (1, "the kernel forbids it"),
        (13, "no permission; run as root"),
        (22, "the kernel forbids it"),
        (5, "Input"),
    ],
)
def test_what_the_kernel_forbids(
    sysfs: Path, monkeypatch: pytest.MonkeyPatch, number: int, says: str
) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise OSError(number, "Input/output error")

    monkeypatch.setattr("mmap.mmap", refuse)
    with pytest.raises(TransportUnavailable, match=says):
        open_pci("03:00.0", sysfs=sysfs)
    monkeypatch.undo()
    monkeypatch.setattr("os.open", refuse)
    with pytest.raises(TransportUnavailable, match=says):
        open_pci("03:00.0", sysfs=sysfs)


def test_the_command_says_what_is_wrong(sysfs: Path) -> None:
    def says(*options: str) -> str:
        result = CliRunner().invoke(cli, ["serve-jr3", *options])
        assert result.exit_code
        return str(result.exception) if isinstance(result.exception, BridgeError) else result.output

    assert "not a JR3" not in says("--pci", "03:00.0", "--sysfs", str(sysfs), "--channel", "2")
    assert "a number like 0x18000, got 'x'" in says("--pci", "03:00.0", "--offset", "x")
    assert "there is none" in says("--pci", "09:00.0", "--sysfs", str(sysfs))
    assert "host and port must be like" in says("--pci", "03:00.0", "--sysfs", str(sysfs), "--listen", "here")


# --- the emulated board


class IsaHost:
    """A host on the ISA bus, as registers: every word through the port pair."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._ports = IsaPorts(IsaProfile(), board)

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        self._ports.write_port(0x314, address, now)
        return tuple(self._ports.read_port(0x316, now) for _ in range(count))

    def burst(self, address: int, count: int, now: float) -> bytes:
        return pack_words(self.read(address, count, now))

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        self._ports.write_port(0x314, address, now)
        for word in words:
            self._ports.write_port(0x316, word, now)

    def reset(self, now: float) -> None:
        self._board.reset(now)


def press(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """50 N on the sensor's z axis, always."""
    return np.tile([0.0, 0.0, -50.0, 0.0, 0.0, 0.0], (len(times), 1))


def board_at(now: float, **profile: object) -> Board:
    return Board(
        BoardProfile(**profile),  # type: ignore[arg-type]
        Jr3Sensor(SensorProfile(noise_counts=0.0), KnownWrench(press), seed=1),
        now,
    )


@pytest.mark.parametrize("reach", [lambda board: board, IsaHost], ids=["registers", "isa"])
def test_the_start_up_as_written_brings_the_emulated_board_up(reach: Callable[[Board], Registers]) -> None:
    begin = now = 4321.5
    registers = reach(board_at(now))
    # Boot and calibration take longer than the pause after the reset, so that the first look finds nothing.
    sequence = start_up(BoardClientProfile())
    answer: tuple[int, ...]
    try:
        step = next(sequence)
        while True:
            answer = ()
            match step:
                case Read(address, count):
                    answer = registers.read(address, count, now)
                case Write(address, words):
                    registers.write(address, words, now)
                case Reset():
                    registers.reset(now)
                case Wait(duration):
                    now += duration
            step = sequence.send(answer)
    except StopIteration as end:
        identity = end.value
    assert now - begin == pytest.approx(11.125)
    assert identity.serial_no == 1001
    assert registers.read(0x80, 6, now) == registers.read(0x78, 6, now)
    assert registers.read(0x88, 6, now) == (0,) * 6
    fz = to_signed(registers.read(0xA2, 1, now + 1.0)[0]) * identity.full_scales[2] / 16384
    assert fz == pytest.approx(-50.0, abs=0.05)


def closed_loop(**board: object) -> tuple[list[CycleRecord], list[str], list[SensorRecord]]:
    """A run of five seconds in virtual time whose sensor is the emulated cell's receiver board."""
    cycles, events, frames = list[CycleRecord](), list[EventRecord](), list[SensorRecord]()

    async def main() -> None:
        clock = Clock.running()
        sections: dict[str, dict[str, object]] = {
            "run": {"duration_s": 5.0},
            "sensor": {"jr3": {"board": board}},
            "tool": {"mass_kg": 0.5},
        }
        config = read_config(sections)
        listen = Listen("s3+memory:robot", "jr3-board+memory:sensor")
        async with emulated_cell(Setup(config, listen), clock, lambda cause: None) as served:
            assert served.robot is not None
            assert served.sensor is not None
            sections["robot"] = {"url": served.robot.named_url}
            sections["sensor"] |= {"url": f"{served.sensor.named_url}?filter=2"}
            takes: dict[type, Any] = {
                CycleRecord: cycles.append,
                EventRecord: events.append,
                SensorRecord: frames.append,
            }
            setup = Setup(read_config(sections))
            async with running(setup, RunLog(clock, [Listener(takes)])) as run:
                result = await run()
                assert result.outcome is Outcome.COMPLETED, result.text
                assert run.sensor.lost == 0

    run_virtual(main)
    return cycles, [event.text for event in events], frames


@pytest.mark.parametrize("mode", ["stream", "poll"])
def test_the_loop_holds_its_force_over_the_board(mode: str) -> None:
    cycles, notices, frames = closed_loop(mode=mode)
    assert "board: sensor model 1, serial number 1001" in notices
    forces = [record.force for record in cycles if record.phase == "track"]
    assert len(forces) > 20
    assert forces[-1] == pytest.approx(10.0, abs=1.0)
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(frames)} == {20}
