"""Common parts of all transports: a buffer for data that arrive before the client starts, and a queue with times."""

import asyncio
import inspect
from collections import deque
from collections.abc import Awaitable, Callable, Sized
from contextlib import suppress
from functools import partial
from typing import Generic, TypeVar

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportClosed, TransportError

Data = TypeVar("Data", bound=Sized)

QUEUE_BYTES = 65536
"""Maximum length of every queue of bytes. Chosen: a minute of a 9600-baud line."""

QUEUE_FRAMES = 1024
"""Maximum length of every queue of CAN frames. Chosen: an eighth of a second of a full bus at 1 Mbit/s."""

FLUSH_S = 1.0
"""Longest time for which `aclose` sends queued data, s. Part of the transport contract."""


class Delivery(Generic[Data]):
    """Receiving side of a transport. It buffers arrivals until `start`, and ends once, after the last data."""

    __slots__ = (
        "_closing",
        "_early",
        "_limit",
        "_on_data",
        "_on_end",
        "ended",
        "name",
        "overruns",
        "waiting",
    )

    def __init__(self, name: str, limit: int) -> None:
        self.name = name
        self._early: deque[Data] = deque()
        self._limit = limit
        self._on_data: Callable[[Data], None] | None = None
        self._on_end: Callable[[TransportError], None] | None = None
        self._closing = False
        self.waiting = 0
        """Number of bytes or frames that arrived before `start`."""
        self.overruns = 0
        """Number of bytes or frames that were lost because the client had not started the transport."""
        self.ended: TransportError | None = None
        """Reason why the transport has ended; None while it is open."""

    def start(self, on_data: Callable[[Data], None], on_end: Callable[[TransportError], None]) -> None:
        """Start delivery, beginning with the buffered data."""
        if self._on_end is not None:
            raise RuntimeError(f"{self.name} was already started")
        self._on_end = on_end
        while self._early:
            data = self._early.popleft()
            self.waiting -= len(data)
            on_data(data)
        self._on_data = on_data
        if self.ended is not None:
            on_end(self.ended)

    def data(self, data: Data) -> None:
        """Deliver data, or buffer them until `start`."""
        if self.ended is not None:
            return
        if self._on_data is not None:
            self._on_data(data)
        elif self.waiting + len(data) > self._limit:
            self.overruns += len(data)
        else:
            self._early.append(data)
            self.waiting += len(data)

    def end(self, error: TransportError) -> None:
        """End the delivery with this cause, unless it has already ended."""
        if self.ended is None:
            self.ended = error
            if self._on_data is not None and self._on_end is not None:
                self._on_end(error)

    def check(self) -> None:
        """Raise TransportError if the transport has ended or is being closed. Called by `send`."""
        if self.ended is not None:
            raise type(self.ended)(*self.ended.args) from self.ended
        if self._closing:
            raise TransportClosed(f"{self.name}: it is being closed")

    def begin_close(self) -> bool:
        """Return whether there is anything to close. From now on, nothing more can be sent."""
        if self._closing or self.ended is not None:
            return False
        self._closing = True
        return True

    async def close(self, drained: Callable[[], Awaitable[None]], close: Callable[[], object]) -> None:
        """Send queued data, which may take time, then close. Idempotent."""
        if not self.begin_close():
            return
        try:
            await flush(drained())
        finally:
            if inspect.isawaitable(closing := close()):
                await closing
            self.closed()

    def closed(self) -> None:
        """End the delivery because this side has closed the transport."""
        self.end(TransportClosed(f"{self.name}: closed"))


class TimedQueue:
    """Queue of actions that are executed in order, each at its own time. All of them share one timer."""

    __slots__ = ("_actions", "_armed", "_clock", "weight")

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._actions: deque[tuple[float, int, Callable[[], None]]] = deque()
        self._armed = False
        self.weight = 0
        """Number of bytes or frames in transit."""

    def put(self, action: Callable[[], None], weight: int, delay: float) -> None:
        """Execute `action` after `delay`, s, but not before earlier actions. A delay of 0 means the next iteration
        of the loop.
        """
        when = self._clock.now() + delay
        if self._actions:
            when = max(when, self._actions[-1][0])
        self._actions.append((when, weight, action))
        self.weight += weight
        if not self._armed:
            self._arm(at_once=delay <= 0.0)

    def put_timed(self, action: Callable[[float], None], weight: int, when: float) -> None:
        """Execute `action` with its time at `when`, s, but not before earlier actions."""
        if self._actions:
            when = max(when, self._actions[-1][0])
        self._actions.append((when, weight, partial(action, when)))
        self.weight += weight
        if not self._armed:
            self._arm(at_once=when <= self._clock.now())

    async def drained(self) -> None:
        """Return when all actions have been executed."""
        while self._actions:
            await self._clock.sleep_until(self._actions[-1][0])

    def clear(self) -> None:
        """Discard all queued actions."""
        self._actions.clear()
        self.weight = 0

    def _arm(self, at_once: bool) -> None:
        self._armed = True
        if at_once:
            self._clock.call_soon(self._run)
        else:
            self._clock.call_at(self._actions[0][0], self._run)

    def _run(self) -> None:
        self._armed = False
        now = self._clock.now()
        try:
            # data queued by these actions wait for the next call; otherwise two ends that answer each other never end
            for _ in range(len(self._actions)):
                if not self._actions or self._actions[0][0] > now:
                    break
                _, weight, action = self._actions.popleft()
                self.weight -= weight
                action()
        finally:
            if self._actions and not self._armed:
                self._arm(at_once=self._actions[0][0] <= now)


async def flush(drained: Awaitable[None]) -> None:
    """Wait until the queue is drained, for at most the time that a transport may take to close."""
    with suppress(TimeoutError):
        async with asyncio.timeout(FLUSH_S):
            await drained
