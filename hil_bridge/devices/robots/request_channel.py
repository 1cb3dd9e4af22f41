"""The shell of a robot that answers when asked: one exchange under way, its callers wait in turn."""

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
    """Drives an endpoint over a wire. `on_event` is shown its events, and calls `resolve` for those that answer.

    A caller that gives up leaves its exchange under way: the other side will still answer it. The next caller waits
    until that has come, so that no answer is taken for that of another question.
    """

    def __init__(
        self,
        endpoint: Endpoint[Data, Data, Event],
        wire: Transport[Data],
        clock: Clock,
        on_event: Callable[[Event], None],
        on_failure: Callable[[BridgeError], None],
    ) -> None:
        """`on_failure` is told once why nothing can be asked any more, unless this side has closed the wire."""
        self._name = wire.name
        self._loop = clock.loop
        self._on_failure = on_failure
        self._pump: Pump[Data, Event] = Pump(endpoint, wire, clock, on_event, self._ended)
        self._answer: asyncio.Future[Answer] | None = None
        """Answer of the exchange under way; cancelled when its caller waits no more."""
        self._waiting: deque[asyncio.Future[None]] = deque()
        """Callers that wait for the exchange under way to end."""
        self._failure: BridgeError | None = None

    @property
    def under_way(self) -> bool:
        """Whether an exchange has no answer yet."""
        return self._answer is not None

    @property
    def awaited(self) -> bool:
        """Whether a caller still waits for the answer of the exchange under way."""
        return self._answer is not None and not self._answer.cancelled()

    def start(self) -> None:
        """Begin to listen."""
        self._pump.start()

    async def exchange(self, ask: Callable[[], object]) -> Answer:
        """Have `ask` give the question to the endpoint when it is its turn, and wait for the answer.

        Raises what `ask` raises, what the exchange is resolved with, and why nothing can be asked any more.
        """
        while self._answer is not None:
            ended = self._loop.create_future()
            self._waiting.append(ended)
            await ended
        if self._failure is not None:
            raise self._failure
        ask()
        answer: asyncio.Future[Answer] = self._loop.create_future()
        self._answer = answer
        self._pump.kick()
        return await answer

    def resolve(self, outcome: Answer | BridgeError) -> None:
        """End the exchange under way, if there is one, with its answer or an error."""
        answer, self._answer = self._answer, None
        if answer is None:
            return
        if answer.cancelled():
            pass  # its caller waits no more
        elif isinstance(outcome, BridgeError):
            answer.set_exception(outcome)
            answer.exception()  # seen, also when its caller is cancelled before it looks
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
