"""Retries at growing intervals for a given time, and a wire that is reopened when it breaks."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from typing import TypeVar

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportClosed, TransportError, TransportUnavailable
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, Delivery

FIRST_WAIT_S = 0.1
LONGEST_WAIT_S = 2.0
"""Longest time between two attempts, s. The first one is `FIRST_WAIT_S`, and each is twice the previous one.
Chosen: a device server takes some seconds to start, and a refused connection costs it nothing. There is no jitter,
because there is only one client.
"""

Opened = TypeVar("Opened")
Notice = Callable[[str, str], None]
"""Callback for an event that is relevant for the recording; receives its kind and its text."""


def waits() -> Iterator[float]:
    """Yield the waiting time before each further attempt, s, endlessly."""
    wait = FIRST_WAIT_S
    while True:
        yield wait
        wait = min(2 * wait, LONGEST_WAIT_S)


async def persistent(open_it: Callable[[], Awaitable[Opened]], patience_s: float, clock: Clock) -> Opened:
    """Open a resource. If it is unavailable, retry for `patience_s`; 0 means a single attempt.

    Raises the last TransportUnavailable.
    """
    until = clock.now() + patience_s
    for wait in waits():
        try:
            return await open_it()
        except TransportUnavailable:
            again = clock.now() + wait
            if again > until:
                raise
        await clock.sleep_until(again)
    raise AssertionError("the waits have no end")


class Reconnecting:
    """Byte wire that is reopened when it breaks or the other side ends it.

    Bytes in transit, and bytes sent during the outage, are lost; a link with repeats recovers. `on_notice` receives
    every loss and recovery. If the wire cannot be reopened within `patience_s`, it ends with TransportBroken.
    """

    __slots__ = ("_clock", "_delivery", "_inner", "_on_notice", "_open", "_patience", "_task", "lost")

    def __init__(
        self,
        wire: Transport[bytes],
        open_again: Callable[[], Awaitable[Transport[bytes]]],
        patience_s: float,
        clock: Clock,
        on_notice: Notice,
    ) -> None:
        self._inner: Transport[bytes] | None = wire
        self._open = open_again
        self._patience = patience_s
        self._clock = clock
        self._on_notice = on_notice
        self._delivery: Delivery[bytes] = Delivery(wire.name, QUEUE_BYTES)
        self._task: asyncio.Task[None] | None = None
        self.lost = 0
        """Number of bytes that were sent during an outage and lost."""

    @property
    def name(self) -> str:
        return self._delivery.name

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)
        if self._inner is not None:
            self._inner.start(self._delivery.data, self._broke)

    def send(self, data: bytes) -> None:
        self._delivery.check()
        if self._inner is not None:
            try:
                self._inner.send(data)
            except TransportError as error:
                if type(error) is TransportError:  # a full queue is for the sender to handle
                    raise
            else:
                return
        self.lost += len(data)

    async def aclose(self) -> None:
        if not self._delivery.begin_close():
            return
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self._inner is not None:
            await self._inner.aclose()
        self._delivery.closed()

    def _broke(self, error: TransportError) -> None:
        if isinstance(error, TransportClosed):
            self._delivery.end(error)
            return
        self._inner = None
        self._on_notice(EventKind.WIRE_LOST, f"{error}; trying to reconnect for {self._patience:g} s")
        self._task = self._clock.loop.create_task(self._return(error), name=f"reconnect {self.name}")

    async def _return(self, cause: TransportError) -> None:
        lost_at = self._clock.now()
        try:
            wire = await persistent(self._open, self._patience, self._clock)
        except TransportError as error:
            self._delivery.end(TransportBroken(f"{cause}; no return within {self._patience:g} s: {error}"))
            return
        self._task = None
        self._inner = wire
        self._on_notice(EventKind.WIRE_BACK, f"{self.name}: back after {self._clock.now() - lost_at:.1f} s")
        wire.start(self._delivery.data, self._broke)
