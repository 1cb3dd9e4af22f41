"""A CAN bus inside one event loop: frames take their time, one after another, by priority."""

import asyncio
from collections import deque
from collections.abc import Callable
from weakref import WeakKeyDictionary

from hil_bridge.clock import Clock, Timer
from hil_bridge.errors import ConfigError, TransportError
from hil_bridge.transports.base import Frames, Transport
from hil_bridge.transports.delivery import QUEUE_FRAMES, Delivery, flush
from protocol.can import CanFrame

BITRATE = 1_000_000
"""Bit/s where nobody names one."""


def frame_bits(frame: CanFrame) -> int:
    """Nominal bit times of a frame with the three of the pause after it; stuff bits are not counted.

    Source: ISO 11898-1, data and remote frame formats: 44 + 3 bits around the data, 20 more when extended.
    """
    return (67 if frame.extended else 47) + (0 if frame.remote else 8 * len(frame.data))


class MemoryCanBus:
    """Any number of nodes on one bus.

    Each sends its own frames in order; among the nodes that wait, the frame that would win on a real bus goes
    first. A frame reaches all others at its end, stamped with that time.

    Not modelled: stuff bits, errors, and that a frame which nobody acknowledges is repeated for ever.
    """

    def __init__(self, clock: Clock, bitrate: int = BITRATE, name: str = "can+memory:bus") -> None:
        self.name = name
        self.bitrate = bitrate
        self._clock = clock
        self._nodes: list[_Node] = []
        self._begun = 0.0
        """When the present unbroken traffic began."""
        self._bits = 0
        """Bit times of it that are over."""
        self._frame: tuple[_Node, int, Timer] | None = None
        """What is on the bus: its sender, its bit times and the timer of its end."""
        self._delivering = False

    @property
    def empty(self) -> bool:
        """Whether nobody is connected."""
        return not self._nodes

    def connect(self) -> Transport[Frames]:
        """A new node."""
        node = _Node(self)
        self._nodes.append(node)
        return node

    def disconnect(self, node: "_Node") -> None:
        """Take a node off the bus."""
        self._nodes.remove(node)

    async def idle(self, node: "_Node") -> None:
        """Return when this node has sent everything."""
        while node.outgoing:
            bits = self._frame[1] if self._frame is not None else 0
            await self._clock.sleep_until(self._at(self._bits + bits))
            await asyncio.sleep(0)

    def wake(self) -> None:
        """A node has something to send."""
        if self._delivering:
            return  # the next arbitration is about to come
        now = self._clock.now()
        if self._frame is None:
            if now != self._at(self._bits):
                self._begun, self._bits = now, 0
            self._arbitrate()
        elif now == self._at(self._bits):
            # who begins at the very instant at which the frame began takes part in the arbitration
            self._frame[2].cancel()
            self._arbitrate()

    def _at(self, bits: int) -> float:
        return self._begun + bits / self.bitrate

    def _arbitrate(self) -> None:
        self._frame = None
        waiting = [node for node in self._nodes if node.outgoing]
        if waiting:
            sender = min(waiting, key=_priority) if len(waiting) > 1 else waiting[0]
            bits = frame_bits(sender.outgoing[0])
            self._frame = sender, bits, self._clock.call_at(self._at(self._bits + bits), self._frame_ends)

    def _frame_ends(self) -> None:
        assert self._frame is not None
        sender, bits, _ = self._frame
        self._bits += bits
        self._delivering = True
        try:
            if sender.outgoing:  # else it has left the bus
                self._deliver(sender, sender.outgoing.popleft())
        finally:
            self._delivering = False
            self._arbitrate()

    def _deliver(self, sender: "_Node", sent: CanFrame) -> None:
        at = self._at(self._bits)
        frame = CanFrame(sent.identifier, sent.data, sent.extended, sent.remote, sent.error, at)
        for node in tuple(self._nodes):
            if node is not sender:
                node.delivery.data((frame,))


def _priority(node: "_Node") -> tuple[int, bool, int, bool]:
    """Order of arbitration of the node's next frame: a dominant 0 wins at the first bit that differs."""
    frame = node.outgoing[0]
    base = frame.identifier >> 18 if frame.extended else frame.identifier
    return base, frame.extended, frame.identifier, frame.remote


class _Node:
    """One controller on the bus."""

    __slots__ = ("_bus", "delivery", "outgoing")

    def __init__(self, bus: MemoryCanBus) -> None:
        self._bus = bus
        self.delivery: Delivery[Frames] = Delivery(bus.name, QUEUE_FRAMES)
        self.outgoing: deque[CanFrame] = deque()

    @property
    def name(self) -> str:
        return self._bus.name

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        self.delivery.start(on_data, on_end)

    def send(self, data: Frames) -> None:
        self.delivery.check()
        if len(self.outgoing) + len(data) > QUEUE_FRAMES:
            raise TransportError(
                f"{self.name}: the queue of {QUEUE_FRAMES} frames is full; the bus is slower"
            )
        if data:
            self.outgoing.extend(data)
            self._bus.wake()

    async def aclose(self) -> None:
        if not self.delivery.begin_close():
            return
        try:
            await flush(self._bus.idle(self))
        finally:
            self.outgoing.clear()
            self._bus.disconnect(self)
            self.delivery.closed()


_BUSES: WeakKeyDictionary[asyncio.AbstractEventLoop, dict[str, MemoryCanBus]] = WeakKeyDictionary()
"""The buses of each loop by name."""


def join_memory_can(name: str, bitrate: int | None, clock: Clock) -> Transport[Frames]:
    """A node on the bus of this name in this loop; the first one makes the bus and sets its bit rate.

    Raises ConfigError when the bus is there with another bit rate.
    """
    buses = _BUSES.setdefault(clock.loop, {})
    bus = buses.get(name)
    if bus is None or bus.empty:
        bus = buses[name] = MemoryCanBus(clock, bitrate or BITRATE, f"can+memory:{name}")
    elif bitrate is not None and bitrate != bus.bitrate:
        raise ConfigError(f"{bus.name}: bitrate={bitrate}, but the others on this bus use {bus.bitrate}")
    return bus.connect()
