"""Requests to a robot that reports on request. One exchange is in progress at a time; further callers are queued."""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from hil_bridge.clock import Clock
from hil_bridge.errors import BridgeError, TransportClosed
from hil_bridge.errors.failures import code_failed, link_cause
from hil_bridge.transports import Transport
from hil_bridge.transports.pump import Data, Event, Pump
from protocol.endpoint import Endpoint

Answer = TypeVar("Answer")


class RequestChannel(Generic[Data, Event, Answer]):
    """Channel that drives an endpoint over a wire. `on_event` receives the events of the endpoint and calls
    `resolve` with each answer.

    A caller that is cancelled leaves its exchange open, because the other side will still answer. The next caller
    waits for that answer, so that no answer is attributed to the wrong request.
    """

    def __init__(
        self,
        endpoint: Endpoint[Data, Data, Event],
        wire: Transport[Data],
        clock: Clock,
        on_event: Callable[[Event], None],
        on_failure: Callable[[BridgeError], None],
    ) -> None:
        """Create a channel. `on_failure` is called once with the reason when the link fails, unless this side has
        closed the wire.
        """
        self._name = wire.name
        self._loop = clock.loop
        self._on_failure = on_failure
        self._pump: Pump[Data, Event] = Pump(endpoint, wire, clock, on_event, self._ended)
        self._answer: asyncio.Future[Answer] | None = None
        """Answer to the present exchange; cancelled if its caller no longer waits."""
        self._waiting: deque[asyncio.Future[None]] = deque()
        """Callers that wait for the end of the present exchange."""
        self._failure: BridgeError | None = None

    @property
    def under_way(self) -> bool:
        """Whether an exchange is in progress."""
        return self._answer is not None

    @property
    def awaited(self) -> bool:
        """Whether a caller still waits for the answer to the present exchange."""
        return self._answer is not None and not self._answer.cancelled()

    def start(self) -> None:
        """Start receiving."""
        self._pump.start()

    async def exchange(self, send: Callable[[], object]) -> Answer:
        """Call `send` when the link is free, and wait for the answer.

        Raises the exception of `send`, the error with which the exchange is resolved, or the reason why the link
        has failed.
        """
        while self._answer is not None:
            ended = self._loop.create_future()
            self._waiting.append(ended)
            await ended
        if self._failure is not None:
            raise self._failure
        send()
        answer: asyncio.Future[Answer] = self._loop.create_future()
        self._answer = answer
        self._pump.kick()
        return await answer

    def resolve(self, outcome: Answer | BridgeError) -> None:
        """End the present exchange with an answer or an error. Does nothing if no exchange is in progress."""
        answer, self._answer = self._answer, None
        if answer is None:
            return
        if answer.cancelled():
            pass  # the caller no longer waits
        elif isinstance(outcome, BridgeError):
            answer.set_exception(outcome)
            answer.exception()  # mark the exception as retrieved, even if the caller is cancelled before it awaits
        else:
            answer.set_result(outcome)
        while self._waiting:
            ended = self._waiting.popleft()
            if not ended.done():
                ended.set_result(None)

    def _ended(self, cause: BaseException) -> None:
        self._failure = code_failed(f"robot link {self._name}", cause, link_cause(cause))
        if not isinstance(cause, TransportClosed):
            self._on_failure(self._failure)
        self.resolve(self._failure)
