"""Faulty transports between a transport and its client in a test: latency, losses, flipped bits, and a cut cable."""

import random
from collections.abc import Callable, Sized
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportClosed, TransportError
from hil_bridge.transports.around import Around
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, Delivery, TimedQueue

Data = TypeVar("Data", bound=Sized)


class Delayed(Around[Data]):
    """Transport that delays all data, and its end, by `latency_s` in both directions."""

    __slots__ = ("_in", "_latency", "_out")

    def __init__(self, transport: Transport[Data], latency_s: float, clock: Clock) -> None:
        super().__init__(transport)
        self._latency = latency_s
        self._in = TimedQueue(clock)
        self._out = TimedQueue(clock)

    def send(self, data: Data) -> None:
        self._delivery.check()
        if self._out.weight + len(data) > QUEUE_BYTES:
            raise TransportError(f"{self.name}: more than {QUEUE_BYTES} bytes or frames are in transit")
        self._out.put(partial(self._leave, data), len(data), self._latency)

    async def aclose(self) -> None:
        await self._delivery.close(self._out.drained, self._inner.aclose)

    def _arrived(self, data: Data) -> None:
        self._in.put(partial(self._delivery.data, data), len(data), self._latency)

    def _inner_ended(self, error: TransportError) -> None:
        if isinstance(error, TransportClosed):
            self._delivery.end(error)
        else:
            self._in.put(partial(self._delivery.end, error), 0, self._latency)


@dataclass(frozen=True, slots=True)
class Faults:
    """Fault probabilities per byte, in both directions, 0 to 1."""

    loss: float = 0.0
    corruption: float = 0.0
    """Probability of a flipped bit, per byte."""
    duplication: float = 0.0


class Faulty:
    """Byte wire with faults that are reproducible by seed.

    Each direction draws its own random numbers, so the faults of one direction do not depend on the traffic of the
    other.
    """

    __slots__ = ("_delivery", "_in", "_inner", "_out", "faults")

    def __init__(self, transport: Transport[bytes], faults: Faults, seed: int = 0) -> None:
        self._inner = transport
        self.faults = faults
        """Fault probabilities, which may be replaced while the wire is running. A loss of 1 makes the transport
        silent.
        """
        self._in = random.Random(f"{seed} in")
        self._out = random.Random(f"{seed} out")
        self._delivery: Delivery[bytes] = Delivery(transport.name, QUEUE_BYTES)

    @property
    def name(self) -> str:
        """Name of the wrapped transport."""
        return self._inner.name

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)
        self._inner.start(self._arrived, self._delivery.end)

    def send(self, data: bytes) -> None:
        self._delivery.check()
        if damaged := self._damage(data, self._out):
            self._inner.send(damaged)

    def cut(self) -> None:
        """Cut the cable: this side ends with TransportBroken, and the other side receives no further data."""
        self._delivery.end(TransportBroken(f"{self.name}: the cable was cut"))

    async def aclose(self) -> None:
        await self._inner.aclose()
        self._delivery.closed()

    def _arrived(self, data: bytes) -> None:
        if damaged := self._damage(data, self._in):
            self._delivery.data(damaged)

    def _damage(self, data: bytes, draw: random.Random) -> bytes:
        faults = self.faults
        if faults == Faults():
            return data
        out = bytearray()
        for byte in data:
            # all three are drawn for every byte, so that one probability does not affect the other draws
            lost, corrupted, doubled = draw.random(), draw.random(), draw.random()
            bit = draw.randrange(8)
            if lost < faults.loss:
                continue
            if corrupted < faults.corruption:
                byte ^= 1 << bit
            out.append(byte)
            if doubled < faults.duplication:
                out.append(byte)
        return bytes(out)
