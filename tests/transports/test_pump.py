"""The pump: data, events, deadlines and errors between an endpoint and a wire."""

import asyncio
from asyncio import sleep as pass_time  # in virtual time, without waiting
from collections import deque
from typing import Any, cast

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import TransportBroken, TransportClosed, TransportEnded, TransportError
from hil_bridge.testing.wires import Faults, Faulty
from hil_bridge.transports import memory_pair
from hil_bridge.transports.pump import Pump


class Echo:
    """Endpoint that returns every byte string reversed, counts, and ticks as often as requested."""

    def __init__(self) -> None:
        self.events: deque[tuple[str, object]] = deque()
        self.out: deque[bytes] = deque()
        self.deadline: float | None = None
        self.ticks: list[float] = []
        self.period = 0.0
        self.times: list[float] = []

    def receive(self, data: bytes, now: float) -> None:
        if data == b"fail":
            raise RuntimeError("receive")
        self.times.append(now)
        self.events.append(("data", data))
        self.out.append(data[::-1])

    def next_event(self) -> tuple[str, object] | None:
        return self.events.popleft() if self.events else None

    def data_to_send(self, now: float) -> bytes:
        self.times.append(now)
        if not self.out:
            return b""
        data = self.out.popleft()
        self.events.append(("sent", data))
        return data

    def next_deadline(self) -> float | None:
        return self.deadline

    def handle_deadline(self, now: float) -> None:
        if self.deadline is not None and self.deadline <= now:
            self.ticks.append(now)
            self.deadline = self.deadline + self.period if len(self.ticks) < 3 else None
            if self.period == 0.125:
                raise RuntimeError("deadline")


class Rig:
    """Pumped endpoint at one end; the test controls the other end."""

    def __init__(self) -> None:
        self.clock = Clock.running()
        inner, self.far = memory_pair(self.clock)
        self.near = Faulty(inner, Faults())
        self.received: list[bytes] = []
        self.events: list[tuple[str, object]] = []
        self.causes: list[BaseException] = []
        self.endpoint = Echo()
        self.pump = Pump(self.endpoint, self.near, self.clock, self.on_event, self.causes.append)

    def on_event(self, event: tuple[str, object]) -> None:
        self.events.append(event)
        match event:
            case ("data", b"kick"):
                # as a device does: pass work to the endpoint and kick from within the callback
                self.endpoint.out.append(b"kicked")
                self.pump.kick()
                self.events.append(("kick returned", None))
            case ("data", b"raise"):
                raise KeyError("on_event")

    def start(self) -> None:
        self.far.start(self.received.append, lambda error: None)
        self.pump.start()


def test_pump_moves_data_events_and_answers() -> None:
    async def main() -> None:
        rig = Rig()
        rig.far.send(b"early")
        await pass_time(0.1)
        rig.start()
        rig.far.send(b"abc")
        await pass_time(0.1)
        assert rig.received == [b"ylrae", b"cba"]
        assert rig.events == [("data", b"early"), ("sent", b"ylrae"), ("data", b"abc"), ("sent", b"cba")]
        assert rig.endpoint.times == sorted(rig.endpoint.times)
        assert rig.causes == []

    run_virtual(main)


def test_pump_kick_within_event_is_processed_in_same_turn() -> None:
    async def main() -> None:
        rig = Rig()
        rig.start()
        rig.far.send(b"kick")
        await pass_time(0.1)
        assert rig.received == [b"kcik", b"kicked"]
        # events are not nested
        assert [name for name, _ in rig.events] == ["data", "kick returned", "sent", "sent"]

    run_virtual(main)


def test_pump_deadlines_are_exact_and_follow_changes() -> None:
    async def main() -> None:
        rig = Rig()
        start = rig.clock.now()
        rig.endpoint.deadline, rig.endpoint.period = start + 0.3, 0.1
        rig.start()
        await pass_time(0.05)
        rig.endpoint.deadline = start + 0.2  # sooner
        rig.pump.kick()
        await pass_time(0.1)
        rig.endpoint.deadline = start + 0.25  # later than the one that is armed
        rig.pump.kick()
        await pass_time(1)
        assert rig.endpoint.ticks == [start + 0.25, start + 0.25 + 0.1, start + 0.25 + 0.1 + 0.1]

    run_virtual(main)


def test_pump_deadline_after_stall_waits_for_pending_data() -> None:
    """The process stalls for 80 ms, in which a device of the same process should have sent its data."""

    async def main() -> None:
        rig, loop = Rig(), cast(Any, asyncio.get_running_loop())
        start = rig.clock.now()
        rig.endpoint.deadline = start + 0.1

        def stall() -> None:
            loop._now += 0.08

        def hear(event: object) -> None:
            rig.endpoint.deadline = rig.clock.now() + 0.1

        rig.pump = Pump(rig.endpoint, rig.near, rig.clock, hear, rig.causes.append)
        rig.start()
        rig.clock.call_at(start + 0.05, stall)
        rig.clock.call_at(start + 0.09, lambda: rig.far.send(b"data"))
        await pass_time(0.2)
        assert rig.endpoint.ticks == []
        await pass_time(0.1)
        assert rig.endpoint.ticks[0] == pytest.approx(start + 0.23, abs=0.01), "then it is judged"

    run_virtual(main)


def test_pump_past_deadline_is_handled_at_once() -> None:
    async def main() -> None:
        rig = Rig()
        rig.start()
        await pass_time(1)
        rig.endpoint.deadline, rig.endpoint.period = rig.clock.now() - 0.5, 10.0
        rig.pump.kick()
        await pass_time(0)
        await pass_time(0)
        assert rig.endpoint.ticks == [rig.clock.now()]
        rig.endpoint.deadline = None
        rig.pump.kick()
        await pass_time(100)
        assert len(rig.endpoint.ticks) == 1

    run_virtual(main)


@pytest.mark.parametrize(
    ("data", "cause"), [(b"fail", RuntimeError("receive")), (b"raise", KeyError("on_event"))]
)
def test_pump_exception_of_endpoint_or_callback_ends_it(data: bytes, cause: Exception) -> None:
    async def main() -> None:
        rig = Rig()
        rig.endpoint.deadline = rig.clock.now() + 5
        rig.start()
        rig.far.send(data)
        rig.far.send(b"after")
        await pass_time(10)
        rig.pump.kick()
        await rig.near.aclose()
        assert [repr(error) for error in rig.causes] == [repr(cause)]
        assert rig.endpoint.ticks == []
        assert ("data", b"after") not in rig.events

    run_virtual(main)


def test_pump_exception_of_deadline_ends_it() -> None:
    async def main() -> None:
        rig = Rig()
        rig.endpoint.deadline, rig.endpoint.period = rig.clock.now() + 1, 0.125
        rig.start()
        await pass_time(10)
        assert [str(error) for error in rig.causes] == ["deadline"]
        assert len(rig.endpoint.ticks) == 1

    run_virtual(main)


def test_pump_deadline_that_stays_in_past_ends_it() -> None:
    async def main() -> None:
        rig = Rig()
        rig.start()
        now = rig.clock.now()
        rig.endpoint.handle_deadline = lambda now: None  # type: ignore[method-assign]
        rig.endpoint.deadline = now + 1
        rig.pump.kick()
        await pass_time(10)
        assert rig.clock.now() == now + 10
        assert [repr(error) for error in rig.causes] == [
            f"PastDeadline('Echo.next_deadline stays at {now + 1:.6f} s, and now is {now + 1:.6f} s; "
            "after handle_deadline, return a time after now, or None')"
        ]

    run_virtual(main)


def test_pump_deadlines_in_past_that_advance_are_handled() -> None:
    async def main() -> None:
        rig = Rig()
        rig.start()
        start, handled = rig.clock.now(), 0

        def handle(now: float) -> None:
            nonlocal handled
            handled += 1
            rig.endpoint.deadline = start - 1 + handled / 5000 if handled < 10_000 else None

        rig.endpoint.handle_deadline = handle  # type: ignore[method-assign]
        rig.endpoint.deadline = start - 1
        rig.pump.kick()
        await pass_time(10)
        assert (handled, rig.causes) == (10_000, [])

    run_virtual(main)


def test_pump_ends_with_wire() -> None:
    async def main() -> None:
        rig = Rig()
        rig.start()
        await rig.near.aclose()
        assert [type(error) for error in rig.causes] == [TransportClosed]

        rig = Rig()
        rig.start()
        await rig.far.aclose()
        await pass_time(0)
        assert [type(error) for error in rig.causes] == [TransportEnded]

        rig = Rig()
        rig.start()
        rig.near.cut()
        rig.endpoint.out.append(b"x")
        rig.pump.kick()
        assert [type(error) for error in rig.causes] == [TransportBroken]

    run_virtual(main)


def test_pump_ends_if_wire_refuses_data() -> None:
    async def main() -> None:
        rig = Rig()
        rig.start()
        rig.endpoint.out.append(bytes(70_000))
        rig.pump.kick()
        assert [type(error) for error in rig.causes] == [TransportError]
        assert "full" in str(rig.causes[0])

    run_virtual(main)
