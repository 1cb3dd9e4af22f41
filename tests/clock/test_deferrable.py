"""Deferrable timers: messages of a device are handed over together, and each keeps its own time."""

import math

import pytest

from emulators.devices.netft import NETFT_FAULTS, NetBox, NetFtProfile
from emulators.faults import Ledger
from emulators.sensing import KnownWrench
from hil_bridge import simulate
from hil_bridge.clock import VIRTUAL_EPOCH, Clock, run_virtual
from hil_bridge.clock.order import VirtualOrder
from hil_bridge.clock.virtual import VirtualLoop
from hil_bridge.transports import connect_datagrams, listen_datagrams
from hil_bridge.transports.pump import Pump
from protocol.datagram import Datagram
from protocol.devices.netft import Command, encode_request
from tests.emulation.quiet_sensor import QUIET

T0 = VIRTUAL_EPOCH
PERIOD = 1e-3
STREAMED = {
    "run": {"duration_s": 0.2, "seed": 7},
    "robot": {"emulated": "egm"},
    "sensor": {"emulated": "netft"},
}


def every_millisecond(until: float) -> float:
    """Return the last millisecond since the epoch up to a time."""
    return T0 + math.floor((until - T0) / PERIOD + 1e-6) * PERIOD


def called_at(other: float | None, may_defer: bool = True, cancel: bool = False) -> list[float]:
    """Return the times since the epoch at which a deferrable timer for 1 ms and another timer are called."""

    async def main() -> list[float]:
        clock, times = Clock.running(), []
        clock.may_defer = may_defer

        def call() -> None:
            times.append(round((clock.now() - T0) * 1e3, 6))

        timer = clock.call_deferrable(T0 + PERIOD, every_millisecond, call)
        if cancel:
            timer.cancel()
        if other is not None:
            clock.call_at(T0 + other, call)
        await clock.sleep_until(T0 + 0.1)
        return times

    return run_virtual(main)


@pytest.mark.parametrize(
    ("other", "times"),
    [
        pytest.param(0.0045, [4.0, 4.5], id="as-late-as-possible"),
        pytest.param(0.001, [1.0, 1.0], id="before-another-of-equal-time"),
        pytest.param(0.0005, [0.5, 100.0], id="not-before-its-time"),
    ],
)
def test_deferrable_timer_runs_before_next_other(other: float, times: list[float]) -> None:
    assert called_at(other) == times


def test_nothing_is_deferred_while_a_task_waits() -> None:
    assert called_at(0.0045, may_defer=False) == [1.0, 4.5]


def test_cancelled_deferrable_timer_is_never_called() -> None:
    assert called_at(0.0045, cancel=True) == [4.5]


def received(path: str = "", fault: str = "", may_defer: bool = True) -> list[tuple[float, float]]:
    """Return arrival and handover of each record of a box in 20 ms, with another timer every 4 ms, ms."""

    async def main() -> list[tuple[float, float]]:
        clock = Clock.running()
        source = KnownWrench(lambda times: times[:, None] * [[0.0] * 6])
        box = NetBox(NetFtProfile(**{**QUIET, "boot_s": 0.0, "latency_s": 0.0}), source, clock.now(), 7)
        if fault:
            ledger = Ledger(NETFT_FAULTS)
            for target, handlers in box.handlers.items():
                ledger.attach(target, handlers)
            ledger.inject("sensor-wire", fault, clock.now(), {"ms": 5.0})
        came: list[tuple[float, float]] = []

        def take(data: object) -> None:
            assert isinstance(data, list)
            for one in data:
                assert isinstance(one, Datagram)
                came.append((one.received_at - T0, clock.now() - T0))

        listening = await listen_datagrams("udp+memory:box", clock)
        Pump(box.endpoint, listening.transport, clock, _ignore, _ignore).start()
        wire = await connect_datagrams(f"udp+memory:box{path}", clock, lambda kind, text: None)
        wire.start(take, _ignore)
        wire.send([encode_request(Command.START)])
        clock.may_defer = may_defer
        for k in range(1, 6):
            await clock.sleep_until(T0 + k * 4e-3 + 1e-4)
        await wire.aclose()
        return [(round(at * 1e3, 4), round(now * 1e3, 4)) for at, now in came]

    return run_virtual(main)


def _ignore(thing: object) -> None:
    pass


def test_records_handed_over_together_keep_their_times() -> None:
    together, singly = received(), received(may_defer=False)
    assert [at for at, _ in together] == [at for at, _ in singly] == [now for _, now in singly]
    assert len({now for _, now in together}) == 5
    assert all(0.0 <= now - at < 4.0 for at, now in together)


def test_delayed_records_arrive_at_their_times() -> None:
    together, singly = received("?latency_ms=0.7"), received("?latency_ms=0.7", may_defer=False)
    assert [at for at, _ in together] == [at for at, _ in singly] == [now for _, now in singly]


def test_nothing_is_deferred_behind_a_faulty_wire() -> None:
    late = received(fault="late")
    assert late == received(fault="late", may_defer=False)
    assert late
    assert all(at == now for at, now in late), "a delayed record has the time at which it arrives"


def test_run_is_the_same_with_and_without_deferring(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(VirtualLoop, "usual_order", VirtualOrder())  # another order changes the last digits
    deferred = simulate(STREAMED)
    monkeypatch.setattr(Clock, "_defers", lambda clock: False)
    assert deferred.cycles == simulate(STREAMED).cycles
    assert deferred.cycles
