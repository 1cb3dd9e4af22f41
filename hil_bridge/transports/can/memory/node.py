"""Node of a CAN bus in memory: a controller with its queue, its error counters and its filters."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Frames
from hil_bridge.transports.can.memory.confinement import RECOVERY_SEQUENCES, ErrorCounters, state_report
from hil_bridge.transports.can.queue import Arrived, CanStatistics, SendQueue
from hil_bridge.transports.delivery import QUEUE_FRAMES, Delivery
from protocol.can.error import CanErrorReport, ErrorClass, ErrorState, encode_error
from protocol.can.frame import CanFilter, CanFrame

_NO_CAUSE = ErrorClass(0)


class Line(Protocol):
    """Bus in the view of its nodes."""

    @property
    def name(self) -> str:
        """URL of the bus."""

    def now(self) -> float:
        """Time of the bus, s."""

    def wake(self, node: "MemoryCanNode") -> None:
        """Report that the node has a frame to send."""

    def disconnect(self, node: "MemoryCanNode") -> None:
        """Remove the node."""


class MemoryCanNode:
    """Transport of CAN frames. Changes of the node's error state are delivered in band, as error frames."""

    __slots__ = (
        "_accept",
        "_bus",
        "_counts",
        "_delivery",
        "_drained",
        "counters",
        "on_bus",
        "queue",
        "recovery",
        "state",
    )

    def __init__(self, bus: Line, accept: Sequence[CanFilter]) -> None:
        self._bus = bus
        self._accept = tuple(accept)
        self._delivery: Delivery[Frames] = Delivery(bus.name, QUEUE_FRAMES)
        self._drained: asyncio.Future[None] | None = None
        self._counts = Arrived()
        self.queue = SendQueue(bus.name)
        self.counters = ErrorCounters()
        self.state = self.counters.state
        """Error state of the node according to its counters."""
        self.on_bus = True
        """Whether the node sends, receives and acknowledges, that is, is not bus-off."""
        self.recovery = 0
        """Number of sequences of eleven recessive bits that the node must still detect while it is bus-off."""

    @property
    def name(self) -> str:
        return self._delivery.name

    @property
    def statistics(self) -> CanStatistics:
        """Counts since the node was connected."""
        return self.queue.statistics(self._counts, self._delivery.overruns)

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)

    def send(self, data: Frames) -> None:
        self._delivery.check()
        self.queue.put(data, self._bus.now())
        if data:
            self._bus.wake(self)

    async def aclose(self) -> None:
        await self._delivery.close(self._until_drained, self._leave)

    def _leave(self) -> None:
        self.queue.clear()
        self._bus.disconnect(self)

    async def _until_drained(self) -> None:
        if len(self.queue):
            self._drained = asyncio.get_running_loop().create_future()
            await self._drained

    # --- for the bus

    def frame_sent(self, at: float) -> None:
        """Handle the acknowledgement of the next frame in the queue."""
        self.queue.left(at)
        if self.counters.transmit:
            self._count(self.counters.sent(), at)
        if self._drained is not None:
            self._settle()

    def frame_received(self, frame: CanFrame, at: float) -> None:
        """Handle a valid frame of another node."""
        if self.counters.receive:
            self._count(self.counters.received(), at)
        if self._accept:
            for choice in self._accept:
                if choice.accepts(frame):
                    break
            else:
                return
        self._counts.frames += 1
        self._delivery.data((frame,))

    def send_failed(self, acknowledge_missing: bool, at: float, times: int) -> None:
        """Handle `times` consecutive failures of a frame of this node."""
        counters = self.counters
        for _ in range(times):
            after = counters.send_failed(acknowledge_missing)
            if after == counters:
                break
            counters = after
        self._count(counters, at, ErrorClass.NO_ACKNOWLEDGE if acknowledge_missing else _NO_CAUSE)

    def receive_failed(self, at: float) -> None:
        """Handle a disturbed frame of another node."""
        self._count(self.counters.receive_failed(), at)

    def recover(self, at: float) -> None:
        """Recover from bus-off after the bus has been free for long enough."""
        self.counters, self.on_bus = ErrorCounters(), True
        self.state = self.counters.state
        self._report(CanErrorReport(ErrorClass.RESTARTED), at)

    def give_up(self, at: float) -> None:
        """Drop the frames that have waited too long, and report this."""
        if self.queue.give_up(at):
            self._report(CanErrorReport(ErrorClass.TX_TIMEOUT), at)
            self._settle()

    def _count(self, counters: ErrorCounters, at: float, cause: ErrorClass = _NO_CAUSE) -> None:
        before, self.counters, self.state = self.state, counters, counters.state
        if self.state is not before:
            if self.state is ErrorState.BUS_OFF:
                self.on_bus, self.recovery = False, RECOVERY_SEQUENCES
                self._counts.bus_off += 1
            self._report(state_report(counters, cause), at)

    def _report(self, report: CanErrorReport, at: float) -> None:
        self._counts.reports += 1
        self._delivery.data((encode_error(report, at),))

    def _settle(self) -> None:
        if self._drained is not None and not self._drained.done() and not len(self.queue):
            self._drained.set_result(None)
