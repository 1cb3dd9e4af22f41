"""Parts that both suites of wires need: cases that open two ends, an ear at an end, and a loop to run a check in."""

import asyncio
import threading
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.errors import TransportEnded, TransportError
from hil_bridge.transports import DatagramWire, Transport
from protocol.can.frame import CanFrame

Ends: TypeAlias = tuple[Transport[Any], Transport[Any]]


class Case(Protocol):
    """Fields that both kinds of case have."""

    @property
    def open(self) -> Callable[[Clock], AbstractAsyncContextManager[tuple[Any, Any]]]:
        """Opens the left and the right end."""

    @property
    def virtual(self) -> bool:
        """Whether the wire works in virtual time; else the tests take real time."""

    def unpack(self, data: Any) -> bytes:
        """The bytes of what arrived on a stream."""


@dataclass(frozen=True)
class StreamCase:
    """One kind of reliable, ordered wire. The checks speak of bytes; a case says how its wire carries them."""

    name: str
    open: Callable[[Clock], AbstractAsyncContextManager[Ends]]
    frames: bool = False
    """Whether it carries CAN frames."""
    peer_end: type[TransportError] | None = TransportEnded
    """Error with which the left end ends when the right one closes; None where a wire does not tell."""
    peer_end_right: type[TransportError] | None = TransportEnded
    volume: int = 100_000
    """Bytes for the big transfer; less than a queue where the peer of a slow line can send without limit."""
    virtual: bool = False

    def pack(self, data: bytes) -> Any:
        """Bytes as the wire takes them."""
        if not self.frames:
            return data
        return [CanFrame(0x100, data[k : k + 8]) for k in range(0, len(data), 8)]

    def unpack(self, data: Any) -> bytes:
        """The bytes of what arrived."""
        return b"".join(frame.data for frame in data) if self.frames else data


@dataclass(frozen=True)
class DatagramCase:
    """One kind of unreliable wire for datagrams. A faulty one loses less than half of them."""

    name: str
    open: Callable[[Clock], AbstractAsyncContextManager[tuple[DatagramWire, DatagramWire]]]
    cut: Callable[[Any], None] | None = None
    """Breaks the left end; it may become known when the other side speaks next. None: cannot be done in a test."""
    peer_end: type[TransportError] | None = None
    """Error with which an end ends when the other one closes; None where a wire does not tell."""
    virtual: bool = False

    def unpack(self, data: Any) -> bytes:
        """Nothing: datagrams are not joined."""
        return b""


class Ear:
    """Listens to one end, and checks what holds for every arrival."""

    def __init__(self, case: Case, transport: Any) -> None:
        self._case = case
        self._news = asyncio.Event()
        self._thread = threading.get_ident()
        self.data = b""
        """Everything that arrived on a stream, joined."""
        self.batches: list[Any] = []
        """Arrivals, as they were delivered."""
        self.ends: list[TransportError] = []
        transport.start(self._on_data, self._on_end)

    @property
    def datagrams(self) -> list[bytes]:
        """Datagrams in the order of their arrival."""
        return [datagram for batch in self.batches for datagram in batch]

    def _on_data(self, data: Any) -> None:
        assert threading.get_ident() == self._thread, "called from another thread"
        assert not self.ends, "data after the end"
        assert len(data), "empty data"
        self.batches.append(data)
        self.data += self._case.unpack(data)
        self._news.set()

    def _on_end(self, error: TransportError) -> None:
        assert threading.get_ident() == self._thread, "called from another thread"
        self.ends.append(error)
        self._news.set()

    async def until(self, holds: Callable[[], bool], limit: float = 30.0) -> None:
        """Wait until it holds, for `limit` s at most."""
        async with asyncio.timeout(limit):
            while not holds():
                self._news.clear()
                await self._news.wait()


def run_check(case: Case, check: Callable[[Any, Any, Any], Awaitable[None]]) -> None:
    """Open the ends, check, close; in virtual time where the wire can. What a callback raised is raised here."""
    raised: list[dict[str, Any]] = []

    async def main() -> None:
        clock = Clock.running()
        if not clock.is_virtual:  # which is strict itself
            clock.loop.set_exception_handler(lambda _, context: raised.append(context))
        try:
            async with case.open(clock) as (left, right):
                try:
                    await check(case, left, right)
                finally:
                    await left.aclose()
                    await right.aclose()
        finally:
            clock.close()

    if case.virtual:
        run_virtual(main)
    else:
        run_real(main)
    assert not raised, raised
