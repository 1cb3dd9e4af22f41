"""Registers of a board from the client's side: URLs, a sensor behind them, the emulated board."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.jr3 import Jr3Sensor, SensorProfile
from emulators.devices.jr3.board import Board, BoardProfile
from emulators.sensing import KnownWrench
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.sensors.jr3.registers import (
    ListenerProfile,
    Watcher,
    board_wire,
    connect_board,
    serve_board,
)
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import ConfigError
from hil_bridge.record import CycleRecord, EventRecord, Outcome, SensorRecord
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import read_config
from protocol.devices.jr3.board import REGISTERS, check_range, pack_words, to_signed
from protocol.devices.jr3.registers import (
    BoardClient,
    BoardClientProfile,
    Op,
    Read,
    Request,
    Reset,
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
    """Board of plain words that executes every command at once, and counts filter2's outputs."""

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


def test_board_url_has_byte_wire_and_filter() -> None:
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
        ("tcp://h:1?reconnect_s=5", "reconnect_s is not supported"),
        ("tcp://h:1?rate=1", "unknown option 'rate'"),
        ("tcp://h", "host and port"),
        (
            "serial:///dev/ttyS0",
            r"'serial:///dev/ttyS0': unknown scheme 'serial'; allowed: tcp",
        ),
        ("tcp://[h", "Invalid IPv6"),
    ],
)
def test_board_url_invalid_is_refused(url: str, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        board_wire(url, BoardClientProfile())


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("pty:", "unknown scheme 'pty'; allowed: tcp-listen, memory"),
        ("tcp-listen://127.0.0.1:0?baudrate=9600", "a board's wire has no baud rate"),
    ],
)
def test_board_listening_url_invalid_is_refused(url: str, text: str) -> None:
    async def main() -> None:
        await serve_board(url, Memory(), ListenerProfile(), Clock.running(), Watcher(print, print))

    with pytest.raises(ConfigError, match=text):
        run_virtual(main)


# --- a sensor in virtual time


def test_board_sensor_streams_in_virtual_time() -> None:
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
        sensor = ForceSensor(wire, BoardClient(profile, begin), clock, CallbackLog(frames.append))
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


def test_board_in_memory_survives_lost_client() -> None:
    async def main() -> list[str]:
        clock, logged, received = Clock.running(), list[str](), list[bytes]()
        served = await serve_board(
            "memory:b",
            Memory(),
            ListenerProfile(),
            clock,
            Watcher(logged.append, logged.append),  # type: ignore[arg-type]
        )
        wire, _ = await connect_board("memory:b", BoardClientProfile(), clock)
        wire.start(received.append, lambda error: None)
        wire.send(b"HELO")
        await clock.sleep_until(clock.now() + 0.1)
        wire.send(encode_request(Request(Op.READ, 1, 0xF8, 1)))
        await clock.sleep_until(clock.now() + 100.0)
        await wire.aclose()
        await served.aclose()
        statuses = [
            item.status for item in response_reader().feed(b"".join(received)) if isinstance(item, Response)
        ]
        assert statuses == [Status.BAD_FRAME, Status.OK]
        return logged

    assert run_virtual(main) == ["memory:b: no request begins with 48"]


# --- the emulated board


def press(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a constant force of 50 N on the sensor's z axis."""
    return np.tile([0.0, 0.0, -50.0, 0.0, 0.0, 0.0], (len(times), 1))


def board_at(now: float, **profile: object) -> Board:
    return Board(
        BoardProfile(**profile),  # type: ignore[arg-type]
        Jr3Sensor(SensorProfile(noise_counts=0.0), KnownWrench(press), seed=1),
        now,
    )


def test_board_start_up_of_document_works() -> None:
    begin = now = 4321.5
    registers = board_at(now)
    # Boot and calibration take longer than the pause after the reset, so that the first poll finds nothing.
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
            arguments: dict[type, Any] = {
                CycleRecord: cycles.append,
                EventRecord: events.append,
                SensorRecord: frames.append,
            }
            setup = Setup(read_config(sections))
            async with running(setup, RunLog(clock, [Listener(arguments)])) as run:
                result = await run()
                assert result.outcome is Outcome.COMPLETED, result.text
                assert run.sensor.lost == 0

    run_virtual(main)
    return cycles, [event.text for event in events], frames


@pytest.mark.parametrize("mode", ["stream", "poll"])
def test_board_run_holds_force(mode: str) -> None:
    cycles, notices, frames = closed_loop(mode=mode)
    assert "board: sensor model 1, serial number 1001" in notices
    forces = [record.force for record in cycles if record.phase == "track"]
    assert len(forces) > 20
    assert forces[-1] == pytest.approx(10.0, abs=1.0)
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(frames)} == {20}
