"""Pump, which drives a protocol state machine over a wire and handles its deadlines."""

from collections.abc import Callable, Sized
from typing import Any, Generic, TypeVar

from hil_bridge.clock import Clock, Timer
from hil_bridge.errors.failures import RAISED, blame, raise_if_interrupt
from hil_bridge.transports.base import Transport
from protocol.endpoint import Endpoint

Data = TypeVar("Data", bound=Sized)
Event = TypeVar("Event")


STALL_S = 0.02
"""Delay of a timer above which this process counts as stalled, s. Chosen."""
_RECEIVE_S = 0.001
"""Time for which data that arrived during a stall are received before a deadline is judged, s. Chosen: also
sufficient for a device that is emulated in this process.
"""
_STANDING_MAX = 1000
"""Number of consecutive deadlines that do not advance after which virtual time counts as stopped. Chosen: more than a
device handles one by one at the same time.
"""


class PastDeadline(Exception):
    """Error of an endpoint whose next deadline stays in the past, so that virtual time cannot advance."""

    def __init__(self, endpoint: Any, deadline: float, now: float) -> None:
        """Create the error. `deadline` and `now` are times on the endpoint's clock, s."""
        while (wrapped := getattr(endpoint, "wrapped", None)) is not None:
            endpoint = wrapped
        super().__init__(
            f"{type(endpoint).__name__}.next_deadline stays at {deadline:.6f} s, and now is {now:.6f} s; "
            "after handle_deadline, return a time after now, or None"
        )
        blame(self, endpoint, "next_deadline")


class Pump(Generic[Data, Event]):
    """Pump that moves data, events and time between one endpoint and one transport, by callbacks, without a task.

    `on_event` is called with every event in order. `on_end` is called exactly once with the cause: the end of the
    transport, or an exception of the endpoint or of `on_event`. The endpoint is not used afterwards. Whoever opened
    the transport closes it.
    """

    __slots__ = (
        "_armed",
        "_armed_at",
        "_clock",
        "_deadline",
        "_ended",
        "_endpoint",
        "_last_deadline",
        "_on_end",
        "_on_event",
        "_postponed",
        "_standing",
        "_timer",
        "_transport",
        "_turning",
    )

    def __init__(
        self,
        endpoint: Endpoint[Data, Data, Event],
        transport: Transport[Data],
        clock: Clock,
        on_event: Callable[[Event], object],
        on_end: Callable[[BaseException], object],
    ) -> None:
        self._endpoint = endpoint
        self._last_deadline: Callable[[float], float] | None = getattr(endpoint, "last_deadline", None)
        """Method of a device whose deadlines may be handled together: a `Deferrable`."""
        self._transport = transport
        self._clock = clock
        self._on_event = on_event
        self._on_end = on_end
        self._timer: Timer | None = None
        self._armed = 0.0
        """Time for which the timer is set, s, if there is a timer."""
        self._armed_at = 0.0
        """Time at which the timer was set, s."""
        self._deadline: float | None = None
        """Next deadline of the endpoint, s."""
        self._postponed: float | None = None
        """Deadline that was postponed after a stall; each deadline is postponed only once."""
        self._standing = 0
        """Number of consecutive deadlines that did not advance."""
        self._turning = False
        self._ended = False

    def start(self) -> None:
        """Start the pump, once. Data that the transport has already received is processed before this returns."""
        self._transport.start(self._received, self._end)
        self.kick()

    def kick(self) -> None:
        """Process the endpoint after it was given new data or requests. May be called within `on_event`."""
        if self._turning or self._ended:
            return  # the call in progress checks the endpoint again before it ends
        self._turning = True
        try:
            self._turn()
        except RAISED as error:
            raise_if_interrupt(error)
            blame(error, self._endpoint, "data_to_send")
            self._end(error)
        finally:
            self._turning = False

    def _turn(self) -> None:
        endpoint, clock = self._endpoint, self._clock
        while True:
            while (event := endpoint.next_event()) is not None:
                self._on_event(event)
                if self._ended:
                    return
            # read again: a callback may have given the endpoint a later time
            data = endpoint.data_to_send(clock.now())
            if not len(data):
                break
            self._transport.send(data)
            if self._ended:
                return
        deadline = self._deadline = endpoint.next_deadline()
        # a postponed deadline, such as a time-out after every answer, is checked when the timer expires
        if deadline is not None and (self._timer is None or deadline < self._armed):
            self._arm(deadline)

    def _arm(self, deadline: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._armed, self._armed_at = deadline, self._clock.now()
        if self._last_deadline is None:
            self._timer = self._clock.call_at(deadline, self._expired)
        else:
            self._timer = self._clock.call_deferrable(deadline, self._last_deadline, self._expired)

    def _received(self, data: Data) -> None:
        if self._ended:
            return
        try:
            self._endpoint.receive(data, self._clock.now())
        except RAISED as error:
            raise_if_interrupt(error)
            self._end(error)
            return
        self.kick()

    def _expired(self) -> None:
        deadline, self._timer = self._deadline, None
        if self._ended or deadline is None:
            return
        if deadline > self._armed:
            self._arm(deadline)
            return
        now = self._clock.now()
        stalled = self._last_deadline is None and now - max(self._armed, self._armed_at) > STALL_S
        if stalled and deadline != self._postponed:
            self._postponed = deadline
            self._arm(now + _RECEIVE_S)
            return
        try:
            # a timer may expire a rounding step early
            self._endpoint.handle_deadline(max(deadline, now))
        except RAISED as error:
            raise_if_interrupt(error)
            self._end(error)
            return
        self.kick()
        following = self._deadline
        if following is None or following > deadline:
            self._standing = 0
            return
        self._standing += 1
        if self._standing > _STANDING_MAX and self._clock.is_virtual:
            self._end(PastDeadline(self._endpoint, following, now))

    def _end(self, cause: BaseException) -> None:
        if self._ended:
            return
        self._ended = True
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._on_end(cause)
