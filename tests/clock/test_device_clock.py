"""The clock of emulated devices, which is independent of delays of the computer."""

from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import pytest

from emulators.devices.rsi import RsiController, RsiProfile
from emulators.seams import StartPose
from hil_bridge.clock import Clock, device_clock, run_real, run_virtual
from hil_bridge.clock.devices import EARLY_S
from hil_bridge.devices.wiring import Serving
from hil_bridge.errors import TransportError
from hil_bridge.transports import LineSettings, PacedLine, opening
from protocol.datagram import Datagram
from protocol.devices.rsi import SENSOR, Telegram, decode, encode, pose_tags

LINE = LineSettings(19200)
CHARACTER = LINE.bits / LINE.baudrate
LATE = 0.3 * CHARACTER
"""Delay of every timer after its requested time, s."""
READ_S = 1e-6
"""Time for reading the clock once, s."""
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)


class LateClock:
    """Clock whose timers are called by the test, each late."""

    is_virtual = False

    def __init__(self) -> None:
        self.time = 1000.0
        self.timers: list[tuple[float, Callable[[], object]]] = []

    def now(self) -> float:
        self.time += READ_S
        return self.time

    def call_at(self, when: float, callback: Callable[[], object]) -> "LateClock":
        self.timers.append((when, callback))
        return self

    def cancel(self) -> None:
        """Do nothing: no timer of these tests is cancelled."""

    def next_timer(self, late: float = LATE) -> float:
        when, callback = self.timers.pop(0)
        self.time = max(self.time, when + late)
        callback()
        return when


class Wire:
    """Transport that the test fills."""

    name = "wire"
    arrive: Callable[[bytes], None]

    def __init__(self, clock: Clock) -> None:
        self.sent: list[tuple[float, Any]] = []
        self.waiting: list[Any] = []
        """Data in the system's buffer."""
        self._clock = clock

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self.arrive = on_data

    def send(self, data: bytes) -> None:
        self.sent.append((self._clock.now(), data))

    def take_in(self) -> None:
        if self.waiting:
            self.arrive(self.waiting.pop())

    async def aclose(self) -> None:
        """Do nothing: nothing is open."""


@pytest.mark.parametrize("late", [0.0, EARLY_S, LATE], ids=["at once", "on time", "late"])
def test_device_clock_answer_begins_at_end_of_request(late: float) -> None:
    computer = LateClock()
    clock = device_clock(computer)  # type: ignore[arg-type]
    wire = Wire(clock)
    line = PacedLine(wire, LINE, clock)
    line.start(lambda data: line.send(data * 2), lambda cause: None)
    wire.arrive(b"\x05")
    requested_at = computer.time
    computer.next_timer(late)
    computer.next_timer(late)
    ((ended, answer),) = wire.sent
    assert answer == b"\x05\x05"
    assert ended == pytest.approx(requested_at + 3 * CHARACTER, abs=READ_S / 2)


def test_device_clock_wakes_up_early_and_polls_rest() -> None:
    computer = LateClock()
    clock = device_clock(computer)  # type: ignore[arg-type]
    times: list[float] = []
    clock.call_at(1001.0, lambda: times.append(computer.time))
    assert computer.next_timer(EARLY_S / 3) == 1001.0 - EARLY_S
    assert times == [pytest.approx(1001.0, abs=1.5 * READ_S)]
    assert times[0] >= 1001.0


def test_device_clock_now_is_requested_time_and_monotonic() -> None:
    late = LateClock()
    clock = device_clock(late)  # type: ignore[arg-type]
    times: list[float] = []
    for when in (1001.0, 1002.0):
        clock.call_at(when, lambda: times.append(clock.now()))
    late.next_timer()
    assert times == [1001.0]
    assert clock.now() == late.time >= 1001.0 - EARLY_S + LATE
    late.time = 1005.0
    newest = clock.now()
    assert newest > 1005.0
    late.next_timer()
    assert times == [1001.0, newest]


def test_device_clock_recovers_from_callback_exception() -> None:
    late = LateClock()
    clock = device_clock(late)  # type: ignore[arg-type]
    clock.call_at(1001.0, lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        late.next_timer()
    assert clock.now() == late.time


def test_device_clock_deadline_has_its_own_time() -> None:
    async def main() -> tuple[float, list[float]]:
        real = Clock.running()
        clock, times = device_clock(real), []
        when = real.now() + 0.001
        clock.call_at(when, lambda: times.append(clock.now()))
        await clock.sleep_until(when + 0.001)
        real.close()
        return when, times

    when, times = run_real(main)
    assert times == [when]


def fail(reason: object) -> None:
    pytest.fail(str(reason))


@asynccontextmanager
async def served(
    robot: RsiController, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[tuple[LateClock, Wire]]:
    """Return a robot that sends first, on a computer that wakes it late."""
    computer = LateClock()
    clock = device_clock(computer)  # type: ignore[arg-type]
    wire = Wire(clock)

    async def connect(*_: object) -> Wire:
        return wire

    monkeypatch.setattr(opening, "connect_datagrams", connect)
    async with AsyncExitStack() as stack:
        serving = Serving(clock, stack, fail, fail)
        await serving.serve_datagrams("udp://127.0.0.1:1", robot.endpoint, speak_first=True, counts_late=True)
        computer.next_timer(EARLY_S)
        yield computer, wire


async def test_device_clock_answer_during_stall_is_in_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = RsiController(RsiProfile(), START, 1000.0)
    async with served(robot, monkeypatch) as (computer, wire):
        ((_, (telegram,)),) = wire.sent
        zeros = dict.fromkeys(pose_tags("RKorr"), "0.000000")
        answer = encode(Telegram(SENSOR, "ImFree", zeros, decode(telegram).ipoc))
        wire.waiting.append([Datagram(answer, computer.time + 0.001, "client")])
        computer.next_timer(0.001)
        assert len(wire.sent) == 2
        assert robot.late == 0


def test_device_clock_in_virtual_time_is_clock_itself() -> None:
    async def main() -> None:
        clock = Clock.running()
        assert device_clock(clock) is clock

    run_virtual(main)
