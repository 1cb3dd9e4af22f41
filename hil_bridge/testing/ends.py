"""Common parts of the transport suites: cases that open two ends, a listener at one end, and an event loop for a
check.
"""

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
    """Common fields of stream cases and datagram cases."""

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
    """Reliable, ordered transport under test. The checks use bytes; the case converts them to what the transport
    carries.
    """

    name: str
    open: Callable[[Clock], AbstractAsyncContextManager[Ends]]
    frames: bool = False
    """Whether the transport carries CAN frames."""
    peer_end: type[TransportError] | None = TransportEnded
    """Error that the left end reports when the right end closes; None if the transport does not report it."""
    peer_end_right: type[TransportError] | None = TransportEnded
    volume: int = 100_000
    """Size of the large transfer, bytes. Must be less than a queue if the peer of a slow line can send without
    limit.
    """
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
    """Function that breaks the left end, which may notice only when the right end sends next; None if a test cannot
    break it.
    """
    peer_end: type[TransportError] | None = None
    """Error that one end reports when the other end closes; None if the transport does not report it."""
    virtual: bool = False

    def unpack(self, data: Any) -> bytes:
        """Return empty bytes: datagrams are not joined."""
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
        """Arrivals, each as it was delivered."""
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
        """Wait until the condition holds, for at most `limit`, s."""
        async with asyncio.timeout(limit):
            while not holds():
                self._news.clear()
                await self._news.wait()


def run_check(case: Case, check: Callable[[Any, Any, Any], Awaitable[None]]) -> None:
    """Open the ends, run the check and close them, in virtual time if the transport supports it. Raises the errors
    of callbacks.
    """
    raised: list[dict[str, Any]] = []

    async def main() -> None:
        clock = Clock.running()
        if not clock.is_virtual:  # a virtual clock raises callback errors itself
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
