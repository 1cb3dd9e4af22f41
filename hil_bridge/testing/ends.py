"""Common parts of the transport suites: cases that open two ends, a listener at an end, and a loop for a check."""

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
    """Common fields of both kinds of case."""

    @property
    def open(self) -> Callable[[Clock], AbstractAsyncContextManager[tuple[Any, Any]]]:
        """Open the left and the right end."""

    @property
    def virtual(self) -> bool:
        """Whether the transport works in virtual time; otherwise the tests run in real time."""

    def unpack(self, data: Any) -> bytes:
        """Return the bytes that arrived on a stream."""


@dataclass(frozen=True)
class StreamCase:
    """Reliable, ordered transport under test. The checks use bytes; the case defines how the transport carries them."""

    name: str
    open: Callable[[Clock], AbstractAsyncContextManager[Ends]]
    frames: bool = False
    """Whether it carries CAN frames."""
    peer_end: type[TransportError] | None = TransportEnded
    """Error with which the left end ends when the right one closes; None if the transport does not report it."""
    peer_end_right: type[TransportError] | None = TransportEnded
    volume: int = 100_000
    """Size of the large transfer, bytes; less than a queue if the peer of a slow line can send without limit."""
    virtual: bool = False

    def pack(self, data: bytes) -> Any:
        """Convert bytes to what the transport sends."""
        if not self.frames:
            return data
        return [CanFrame(0x100, data[k : k + 8]) for k in range(0, len(data), 8)]

    def unpack(self, data: Any) -> bytes:
        """Return the bytes that arrived."""
        return b"".join(frame.data for frame in data) if self.frames else data


@dataclass(frozen=True)
class DatagramCase:
    """Unreliable datagram transport under test. A faulty one loses less than half of the datagrams."""

    name: str
    open: Callable[[Clock], AbstractAsyncContextManager[tuple[DatagramWire, DatagramWire]]]
    cut: Callable[[Any], None] | None = None
    """Breaks the left end, which may become known when the other side sends next. None: not possible in a test."""
    peer_end: type[TransportError] | None = None
    """Error with which an end ends when the other one closes; None if the transport does not report it."""
    virtual: bool = False

    def unpack(self, data: Any) -> bytes:
        """Return nothing: datagrams are not joined."""
        return b""


class Ear:
    """Listener at one end, which checks every arrival."""

    def __init__(self, case: Case, transport: Any) -> None:
        self._case = case
        self._news = asyncio.Event()
        self._thread = threading.get_ident()
        self.data = b""
        """All data that arrived on a stream, joined."""
        self.batches: list[Any] = []
        """Arrivals as delivered."""
        self.ends: list[TransportError] = []
        transport.start(self._on_data, self._on_end)

    @property
    def datagrams(self) -> list[bytes]:
        """Datagrams in order of arrival."""
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
        """Wait until the condition holds, at most `limit` s."""
        async with asyncio.timeout(limit):
            while not holds():
                self._news.clear()
                await self._news.wait()


def run_check(case: Case, check: Callable[[Any, Any, Any], Awaitable[None]]) -> None:
    """Open the ends, check, close; in virtual time if supported. Errors of callbacks are raised here."""
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
