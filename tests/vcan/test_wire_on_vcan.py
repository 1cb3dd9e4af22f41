"""Tests of the SocketCAN transport on a real kernel, for what its tests with a simulated kernel assume."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.errors import TransportBroken, TransportError, TransportUnavailable
from hil_bridge.transports import Frames, Transport, connect_can
from hil_bridge.transports.can import wire as can_wire
from protocol.can.error import CanErrorReport, ErrorClass, encode_error
from protocol.can.frame import CanFilter, CanFrame

pytestmark = pytest.mark.vcan

PATIENCE = 30.0
"""Maximum wait on a busy machine, s."""
FRAMES = (
    CanFrame(0x201, bytes.fromhex("C80010270000")),
    CanFrame(0x080),
    CanFrame(0x7FF, bytes(range(8))),
    CanFrame(0x1FFFFFFF, b"\xff", extended=True),
    CanFrame(0x123, bytes(4), remote=True),
)


class Node:
    """Socket on the bus and the frames it received."""

    def __init__(self, wire: Transport[Frames], clock: Clock) -> None:
        self.wire = wire
        self.batches: list[Frames] = []
        self.delivered_at: list[float] = []
        self.ends: list[TransportError] = []
        self._clock = clock
        self._changed = asyncio.Event()
        wire.start(self._data, self._end)

    @property
    def frames(self) -> list[CanFrame]:
        return [frame for batch in self.batches for frame in batch]

    async def until(self, happened: Callable[[], bool]) -> None:
        """Wait until something has happened to this node."""
        async with asyncio.timeout(PATIENCE):
            while not happened():
                self._changed.clear()
                await self._changed.wait()

    def _data(self, frames: Frames) -> None:
        self.batches.append(frames)
        self.delivered_at.append(self._clock.now())
        self._changed.set()

    def _end(self, cause: TransportError) -> None:
        self.ends.append(cause)
        self._changed.set()


def on_bus(url: str, script: Callable[..., Awaitable[None]], *accept: Any) -> None:
    """Run a script with the clock and one node for each sequence of filters."""

    async def main() -> None:
        clock = Clock.running()
        async with AsyncExitStack() as stack:
            stack.callback(clock.close)
            nodes = []
            for filters in accept:
                wire = await connect_can(url, clock, filters)
                stack.push_async_callback(wire.aclose)
                nodes.append(Node(wire, clock))
            await script(clock, *nodes)

    run_real(main)


def test_frames_arrive_in_order_and_not_at_sender(vcan: Any) -> None:
    async def script(clock: Clock, sender: Node, *others: Node) -> None:
        sender.wire.send(FRAMES)
        for other in others:
            await other.until(lambda other=other: len(other.frames) == len(FRAMES))  # type: ignore[misc]
            assert other.frames == list(FRAMES)
        others[0].wire.send(FRAMES[:1])
        await sender.until(lambda: bool(sender.frames))
        assert sender.frames == [FRAMES[0]]

    on_bus(vcan.url, script, (), (), ())


def test_kernel_filters_frames(vcan: Any) -> None:
    async def script(clock: Clock, sender: Node, filtered: Node) -> None:
        sender.wire.send(FRAMES)
        await filtered.until(lambda: len(filtered.frames) == 2)
        assert filtered.frames == [FRAMES[0], FRAMES[2]]

    on_bus(vcan.url, script, (), (CanFilter(0x201), CanFilter(0x7FF)))


def test_frames_have_kernel_time_stamps(vcan: Any) -> None:
    """While the process is busy, frames wait in the socket; their times are their times of arrival."""

    async def script(clock: Clock, sender: Node, receiver: Node) -> None:
        before = clock.now()
        sender.wire.send([CanFrame(0x601, bytes([number])) for number in range(100)])
        sent = clock.now()
        time.sleep(0.25)  # noqa: ASYNC251 - that nothing else can run is the point
        awake = clock.now()
        await receiver.until(lambda: len(receiver.frames) == 100)
        assert [len(batch) for batch in receiver.batches] == [100]
        assert receiver.delivered_at[0] >= awake
        stamps = [frame.received_at or 0.0 for frame in receiver.frames]
        assert stamps == sorted(stamps)
        # the wall clock of the stamps may be set by a few milliseconds against the loop's
        assert before - 0.05 <= stamps[0] <= stamps[-1] <= sent + 0.05

    on_bus(vcan.url, script, (), ())


@pytest.mark.parametrize("gone", ["down", "deleted"])
def test_short_interface_outage_is_reported(vcan: Any, gone: str) -> None:
    async def script(clock: Clock, sender: Node, receiver: Node) -> None:
        sender.wire.send(FRAMES[:1])
        await receiver.until(lambda: len(receiver.frames) == 1)
        vcan.down() if gone == "down" else vcan.delete()
        for node in (sender, receiver):
            await node.until(lambda node=node: reported_in_band(node, ErrorClass.INTERFACE_DOWN))  # type: ignore[misc]
        await clock.sleep_until(clock.now() + 0.3)
        vcan.up() if gone == "down" else vcan.add()
        for node in (sender, receiver):
            await node.until(lambda node=node: reported_in_band(node, ErrorClass.RESTARTED))  # type: ignore[misc]
        sender.wire.send(FRAMES[2:3])
        await receiver.until(lambda: receiver.frames[-1] == FRAMES[2])
        assert [frame for frame in receiver.frames if not frame.error] == [FRAMES[0], FRAMES[2]]
        assert sender.ends == receiver.ends == []

    on_bus(vcan.url, script, (), ())


def reported_in_band(node: Node, matter: ErrorClass) -> bool:
    """Return whether the wire reported this in band."""
    return encode_error(CanErrorReport(matter)) in node.frames


def test_long_interface_outage_ends_wire(vcan: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can_wire, "LINK_PATIENCE_S", 0.5)

    async def script(clock: Clock, node: Node) -> None:
        vcan.delete()
        await node.until(lambda: bool(node.ends))
        (cause,) = node.ends
        assert isinstance(cause, TransportBroken)
        assert str(cause) == (
            f"{vcan.url}: broke: there is no such CAN interface; `ip -details link show` lists the interfaces"
        )
        with pytest.raises(TransportBroken):
            node.wire.send(FRAMES)

    on_bus(vcan.url, script, ())


def test_interface_down_message_has_remedy(vcan: Any) -> None:
    async def script(clock: Clock) -> None:
        vcan.down()
        with pytest.raises(TransportUnavailable, match=f"is down; `sudo ip link set {vcan.name} up`"):
            await connect_can(vcan.url, clock)

    on_bus(vcan.url, script)
