"""The pump: data, events and deadlines between an endpoint and a wire, and no error lost."""

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
    """Endpoint that answers every byte string reversed, counts, and ticks as often as it is told to."""

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
    """A pumped endpoint at one end, the other end in the test's hand."""

    def __init__(self) -> None:
        self.clock = Clock.running()
        inner, self.far = memory_pair(self.clock)
        self.near = Faulty(inner, Faults())
        self.heard: list[bytes] = []
        self.events: list[tuple[str, object]] = []
        self.causes: list[BaseException] = []
        self.endpoint = Echo()
        self.pump = Pump(self.endpoint, self.near, self.clock, self.on_event, self.causes.append)

    def on_event(self, event: tuple[str, object]) -> None:
        self.events.append(event)
        match event:
            case ("data", b"kick"):
                # as a device does: give the endpoint something to do and kick, from within the callback
                self.endpoint.out.append(b"kicked")
                self.pump.kick()
                self.events.append(("kick returned", None))
            case ("data", b"raise"):
                raise KeyError("on_event")

    def start(self) -> None:
        self.far.start(self.heard.append, lambda error: None)
        self.pump.start()


def test_data_goes_in_events_come_out_answers_go_back() -> None:
    async def main() -> None:
        rig = Rig()
        rig.far.send(b"early")
        await pass_time(0.1)
        rig.start()
        rig.far.send(b"abc")
        await pass_time(0.1)
        assert rig.heard == [b"ylrae", b"cba"]
        assert rig.events == [("data", b"early"), ("sent", b"ylrae"), ("data", b"abc"), ("sent", b"cba")]
        assert rig.endpoint.times == sorted(rig.endpoint.times)
        assert rig.causes == []

    run_virtual(main)


def test_a_kick_from_within_an_event_is_served_in_the_same_turn() -> None:
    async def main() -> None:
        rig = Rig()
        rig.start()
        rig.far.send(b"kick")
        await pass_time(0.1)
        assert rig.heard == [b"kcik", b"kicked"]
        # no event is told while another is being told
        assert [name for name, _ in rig.events] == ["data", "kick returned", "sent", "sent"]

    run_virtual(main)


def test_deadlines_come_at_their_exact_time_and_follow_changes() -> None:
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


def test_deadline_after_stall_waits_for_what_came_during_it() -> None:
    """The process stands still for 80 ms, in which a device of the same process should have sent its data."""

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


def test_a_deadline_that_has_passed_is_served_and_none_is_not() -> None:
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
def test_what_endpoint_or_callback_raise_ends_the_pump_with_it(data: bytes, cause: Exception) -> None:
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


def test_what_a_deadline_raises_ends_the_pump_with_it() -> None:
    async def main() -> None:
        rig = Rig()
        rig.endpoint.deadline, rig.endpoint.period = rig.clock.now() + 1, 0.125
        rig.start()
        await pass_time(10)
        assert [str(error) for error in rig.causes] == ["deadline"]
        assert len(rig.endpoint.ticks) == 1

    run_virtual(main)


def test_the_ends_of_the_wire_end_the_pump() -> None:
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


def test_a_wire_that_refuses_data_ends_the_pump() -> None:
    async def main() -> None:
        rig = Rig()
        rig.start()
        rig.endpoint.out.append(bytes(70_000))
        rig.pump.kick()
        assert [type(error) for error in rig.causes] == [TransportError]
        assert "full" in str(rig.causes[0])

    run_virtual(main)
