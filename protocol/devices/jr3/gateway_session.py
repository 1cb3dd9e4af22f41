"""Session with a gateway of a JR3 sensor, shared by the clients of both gateways.

Theory of operation. A session goes through the phases ASKING, the steps of its dialect, SETTLING and READY:

| phase | waits for | ends otherwise |
| --- | --- | --- |
| ASKING | the acknowledge "ready" to the state request | FAILED after `ready_timeout_s` |
| a step: start, full scales | the acknowledge of its order | ASKING on "not ready" |
| SETTLING | the end of `settle_s`; reports SensorReady | ASKING on "not ready" |
| READY | a stop by its owner | FAILED on "not ready", or if the counter is stuck for `still_timeout_s` |
| STOPPING | the acknowledge of the stop; then STOPPED | FAILED after `retries` |

Steps for full scales are skipped if the full scales are known. In every phase except ASKING, an order without an
acknowledge is repeated `retries` times; after that, the session is FAILED. A full scale of 0 makes it FAILED at once. A
boot-up message restarts the session, except in STOPPING and STOPPED. A stop is sent from every phase, including FAILED.

Three parties drive it. The owner makes requests with `zero`, `set_filter` and `stop`. The client passes on what it has
decoded with `acknowledge`, `boot_up`, `sample`, `notice` and `tell`, and encodes the order that `order_to_send`
returns. Time advances with `handle_deadline`. Events for the owner wait in `next_event`.

An acknowledge does not name its order. Therefore only one order is outstanding at a time and the others wait in
`_Orders`. A stop, which ends a stream, is acknowledged only at the end of the current stream period. A gateway takes
its zero with the next sample. A sample taken before the zero may still follow the acknowledge. Therefore `Zeroed` is
reported with the first sample after the acknowledge, and carries that sample. Pauses keep orders and responses in step.
A gateway that cannot receive after an acknowledge gets a pause of `pause_s` each time. A gateway that can always
receive gets a pause only after a repeated order. The pause lasts `ack_timeout_s`, in which late acknowledges arrive.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Generic, Protocol, TypeVar

from protocol.devices.jr3.counts import facts_of, full_scales_si
from protocol.devices.jr3.firmware import HANGS, UNFILTERED, GatewayState, SampleCounter, first_order_delay
from protocol.devices.jr3.range import Range
from protocol.endpoint import LocalProtocolError, Trouble
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import (
    AXES,
    SensorReady,
    SensorRestarted,
    SensorStatistics,
    WrenchFrame,
    Zeroed,
)

Op = TypeVar("Op", bound=IntEnum)


class Phase(Enum):
    """Phase of the session."""

    ASKING = "asking for the state"
    SCALES = "asking for the full scales"
    STARTING = "starting"
    FORCE_SCALES = "asking for the full scales of forces"
    MOMENT_SCALES = "asking for the full scales of moments"
    SETTLING = "settling"
    READY = "ready"
    STOPPING = "stopping"
    STOPPED = "stopped"
    FAILED = "failed"


_ENDED = frozenset({Phase.STOPPING, Phase.STOPPED, Phase.FAILED})
_BEFORE_START = frozenset({Phase.ASKING, Phase.SCALES})
_ASK_SCALES = frozenset({Phase.SCALES, Phase.FORCE_SCALES, Phase.MOMENT_SCALES})

# Used with every sample, so bound to module names: before Python 3.12 an enum member lookup is five times slower.
_ASKING, _SETTLING, _READY = Phase.ASKING, Phase.SETTLING, Phase.READY


class SessionProfile(Protocol):
    """Session settings that the profiles of both clients share; times are in s."""

    @property
    def cutoff_hz(self) -> float: ...
    @property
    def ack_timeout_s(self) -> float: ...
    @property
    def retries(self) -> int: ...
    @property
    def ready_timeout_s(self) -> float: ...
    @property
    def settle_s(self) -> float: ...
    @property
    def still_timeout_s(self) -> float: ...
    @property
    def full_scales(self) -> tuple[float, ...]: ...


@dataclass(frozen=True, slots=True)
class Dialect(Generic[Op]):
    """Differences between the two gateways, as used by the session."""

    name: str
    """Name of the gateway, with which failure texts begin."""
    steps: tuple[tuple[Phase, Op], ...]
    """Phases before SETTLING, each with its order. The first phase is ASKING."""
    zero: Op
    set_filter: Op
    stop: Op
    pause_s: float | None
    """Pause after an acknowledge, s, during which the gateway cannot receive; None if it can always receive."""
    period: float
    """Time between two samples on the gateway's clock, s."""
    counter_step: float
    """Increment of the counter from frame to frame; see `SampleCounter`."""
    counter_behind: int
    """Limit below which a step back of the counter marks an old frame; see `SampleCounter`."""
    check_cutoff: Callable[[float], None]
    """Function that raises ValueError if a cut-off, Hz, cannot be sent."""
    explain_silence: Callable[[str], Trouble]
    """Function that returns the trouble of a gateway that has acknowledged nothing for a time, passed as text."""


@dataclass(slots=True)
class _PendingOrder(Generic[Op]):
    """Order that waits for its acknowledge."""

    op: Op
    due: float
    tries: int = 1
    resend: bool = False


class _Orders(Generic[Op]):
    """The outstanding order and the queue of orders behind it. A pause may precede the next order."""

    def __init__(self, dialect: Dialect[Op], profile: SessionProfile) -> None:
        self._dialect, self._profile = dialect, profile
        self._queue: deque[Op] = deque()
        self.flight: _PendingOrder[Op] | None = None
        self.quiet_until: float | None = None
        """End of the pause, s; None if there is no pause."""

    @property
    def are_idle(self) -> bool:
        """Whether no order is queued or outstanding."""
        return self.flight is None and not self._queue

    def add(self, op: Op) -> None:
        """Queue an order unless it is already queued."""
        if op not in self._queue:
            self._queue.append(op)

    def drop(self) -> None:
        """Drop all orders, including the outstanding one."""
        self.flight = None
        self._queue.clear()

    def timeout(self, op: Op) -> float:
        """Return the time-out for the acknowledge of an order, s."""
        rest = self._dialect.period if op == self._dialect.stop else 0.0
        return self._profile.ack_timeout_s + rest

    def next(self, now: float) -> Op | None:
        """Return the next order to send and count it as sent; None if nothing is to be sent."""
        flight = self.flight
        if flight is None:
            if not self._queue or (self.quiet_until is not None and now < self.quiet_until):
                return None
            self.quiet_until = None
            op = self._queue.popleft()
            flight = self.flight = _PendingOrder(op, now + self.timeout(op))
        elif flight.resend:
            flight.resend = False
            flight.tries += 1
            flight.due = now + self.timeout(flight.op)
        else:
            return None
        return flight.op

    @property
    def due(self) -> float | None:
        """Time of the next time-out or of the end of the pause, s."""
        if self.flight is not None:
            return None if self.flight.resend else self.flight.due
        return self.quiet_until if self._queue else None

    def overdue(self, now: float) -> _PendingOrder[Op] | None:
        """Return the order whose acknowledge is overdue. Also end a pause that has elapsed."""
        if self.quiet_until is not None and now >= self.quiet_until:
            self.quiet_until = None
        flight = self.flight
        return flight if flight is not None and not flight.resend and now >= flight.due else None


class _Scales:
    """Full scales, either configured or requested from the gateway."""

    def __init__(self, known: tuple[float, ...]) -> None:
        self.known = known
        """Six full scales, N and N·m; empty until they are known."""
        self._words: tuple[int, ...] = ()

    def restart(self) -> None:
        """Discard the words received so far, because the first request is sent again."""
        self._words = ()

    def take(self, words: Sequence[int]) -> str:
        """Store the next words. Return the axis whose full scale is 0, or an empty string."""
        for axis, word in zip(AXES[len(self._words) :], words, strict=False):
            if word == 0:
                return axis
        self._words += tuple(words)
        if len(self._words) == len(AXES):
            self.known = full_scales_si(self._words[:3], self._words[3:])
        return ""


class _Samples:
    """Samples of a session, with their counter, their range, and the pending zero."""

    def __init__(
        self, counter: SampleCounter, events: SensorEventQueue, still_timeout: float, now: float
    ) -> None:
        self._counter, self._sensor_events, self._still_timeout = counter, events, still_timeout
        self._range = Range()
        self.new_at = now
        """Arrival time of the newest sample with a changed counter, s, but not before READY."""
        self.zeroing = False
        """Whether the next sample is the first one relative to a new zero."""

    def restart(self) -> None:
        """Reset the state after a restart of the gateway."""
        self.zeroing = False
        self._counter.restart()
        self._range.restart()

    def take(self, counts: tuple[int, int, int, int, int, int], counter: int, at: float, ready: bool) -> str:
        """Report a sample. Return the reason why a session that is `ready` has failed, or an empty string."""
        if (sequence := self._counter.follow(counter)) is None:
            stuck_for = at - self.new_at
            if stuck_for >= self._still_timeout and ready:
                return f"its counter has been stuck at {counter} for {stuck_for:.1f} s while samples continue"
            return ""
        self.new_at = at
        if self.zeroing:
            self.zeroing = False
            self._range.zeroed(self._range.newest)
            self._sensor_events.tell(Zeroed(WrenchFrame(counts, counter, sequence, at)))
            return ""
        saturated = self._range.saturated(counts)
        for warning in self._range.warnings:
            self._sensor_events.notice(warning)
        self._sensor_events.tell(WrenchFrame(counts, counter, sequence, at, saturated))
        return ""


class GatewaySession(Generic[Op]):
    """State machine of a client's session. The client itself encodes and decodes the messages."""

    def __init__(self, dialect: Dialect[Op], profile: SessionProfile, now: float) -> None:
        self._dialect = dialect
        self._profile = profile
        self.cutoff_hz = profile.cutoff_hz
        """Cut-off for the next order that carries one, Hz; 0 means unfiltered."""
        self.statistics = SensorStatistics()
        self._asks_scales = frozenset(op for phase, op in dialect.steps if phase in _ASK_SCALES)
        self._sensor_events = events = SensorEventQueue(f"{dialect.name}: ")
        self.tell, self.notice, self.next_event = events.tell, events.notice, events.next_event
        counter = SampleCounter(self.statistics, dialect.counter_step, dialect.counter_behind)
        still_timeout = max(profile.still_timeout_s, 5 * dialect.period)
        self._samples = _Samples(counter, events, still_timeout, now)
        self._orders = _Orders(dialect, profile)
        self._zero_wanted = False
        self._begin(now)

    def _begin(self, now: float) -> None:
        self._ready_by = self._settled_at = now + self._profile.ready_timeout_s
        self._scales = _Scales(self._profile.full_scales)
        self._answered = False
        self._orders.quiet_until = None
        self._foreign_acknowledges = 0
        self._samples.restart()
        self._orders.add(self._first_step())

    def _first_step(self) -> Op:
        """Drop all orders, return to ASKING, and return the order of this phase."""
        self._orders.drop()
        self._scales.restart()
        self._steps: Iterator[tuple[Phase, Op]] = iter(self._dialect.steps)
        self.phase, order = next(self._steps)
        return order

    @property
    def stop_patience(self) -> float:
        """Longest time until SensorStopped if the first stop is lost, s: two time-outs of a stop."""
        return 2 * self._orders.timeout(self._dialect.stop)

    @property
    def scales_expected(self) -> bool:
        """Whether the next acknowledge may carry full scales, including those requested before a stop."""
        flight = self._orders.flight
        return flight is not None and (flight.op in self._asks_scales or self._foreign_acknowledges > 0)

    # --- owner's requests

    def zero(self) -> None:
        """Use the present wrench as zero once ready. Raises LocalProtocolError after the end of the session."""
        self._require_running("zero")
        if self.phase is Phase.READY:
            self._orders.add(self._dialect.zero)
        else:
            self._zero_wanted = True

    def set_filter(self, cutoff_hz: float) -> None:
        """Set the cut-off, Hz, now and after each restart of the gateway; 0 means unfiltered. Raises
        LocalProtocolError if the cut-off is invalid or the session has ended.
        """
        self._require_running("set the filter")
        try:
            self._dialect.check_cutoff(cutoff_hz)
        except ValueError as error:
            raise LocalProtocolError(str(error)) from error
        self.cutoff_hz = cutoff_hz
        if self.phase not in _BEFORE_START:  # the start order carries the cut-off too
            self._orders.add(self._dialect.set_filter)

    def stop(self) -> None:
        """End the session. SensorStopped confirms that the gateway has stopped. Idempotent.

        The stop is sent at once, even to a gateway that cannot receive: the owner may not wait for the end of the
        pause, and a driver may buffer the bytes. A lost stop is repeated.
        """
        if self.phase in (Phase.STOPPING, Phase.STOPPED):
            return
        # An outstanding order may still be acknowledged. This must not count as the acknowledge of the stop.
        self._foreign_acknowledges = int(self._orders.flight is not None)
        self._end(Phase.STOPPING)
        self._orders.add(self._dialect.stop)

    # --- client's calls

    def sample(self, counts: tuple[int, int, int, int, int, int], counter: int, at: float) -> None:
        """Report a sample that was complete at time `at`, s. The client calls this only in READY."""
        if failure := self._samples.take(counts, counter, at, self.phase is _READY):
            self._fail(failure, "sensor unplugged? plug it in, then switch the gateway off and on")

    def boot_up(self, now: float) -> None:
        """Restart the session after a restart of the gateway, which does not remember the session."""
        if self.phase in (Phase.STOPPING, Phase.STOPPED):
            return
        if self.phase is not Phase.ASKING:
            self.tell(SensorRestarted())
        self._begin(now)

    def acknowledge(self, state: int, words: Sequence[int] | None, now: float) -> None:
        """Accept an acknowledge. `words` are the full scales that it carries, or None."""
        flight = self._orders.flight
        if self._dialect.pause_s is not None:
            self._orders.quiet_until = now + self._dialect.pause_s
        if flight is None:
            return  # late response to an order that was repeated
        if self._foreign_acknowledges:
            self._foreign_acknowledges -= 1
            return
        if state != GatewayState.READY and flight.op is not self._dialect.stop:
            self._on_not_ready(flight, now)
            return
        if flight.op in self._asks_scales and words is None:
            self.statistics.malformed += 1  # an acknowledge of another order; repeated at the time-out
            return
        self._orders.flight = None
        if self._dialect.pause_s is None and flight.tries > 1:
            self._orders.quiet_until = now + self._profile.ack_timeout_s
        self._advance(flight.op, words or (), now)

    def order_to_send(self, now: float) -> Op | None:
        """Return the next order to send and count it as sent; None if nothing is to be sent."""
        return self._orders.next(now)

    # --- Endpoint

    def next_deadline(self) -> float | None:
        """Return the time of the next time-out or of the end of a pause, s."""
        orders = self._orders
        if self.phase is _READY and orders.are_idle:
            return None
        due = [
            orders.due,
            self._ready_by if self.phase is _ASKING else None,
            self._settled_at if self.phase is _SETTLING else None,
        ]
        return min([moment for moment in due if moment is not None], default=None)

    def handle_deadline(self, now: float) -> None:
        """Repeat an order, report a failure, or become ready."""
        overdue = self._orders.overdue(now)
        if self.phase is _ASKING and now >= self._ready_by:
            waited = f"{self._profile.ready_timeout_s:g} s"
            answered = Trouble(f"acknowledges but is not ready after {waited}", "sensor unplugged?")
            self._fail(*(answered if self._answered else self._dialect.explain_silence(waited)))
        elif overdue is not None:
            self._on_timeout(overdue)
        if self.phase is _SETTLING and now >= self._settled_at:
            self.phase, self._samples.new_at = _READY, now
            self._report_facts()
            if not self.cutoff_hz:
                self.notice(UNFILTERED)
            if self._zero_wanted:
                self._zero_wanted = False
                self._orders.add(self._dialect.zero)

    # --- transitions

    def _require_running(self, wish: str) -> None:
        if self.phase in _ENDED:
            raise LocalProtocolError(f"cannot {wish}: the session is {self.phase.value}")

    def _end(self, phase: Phase) -> None:
        self.phase, self._orders.quiet_until = phase, None
        self._orders.drop()

    def _fail(self, text: str, remedy: str = "") -> None:
        self._end(Phase.FAILED)
        self._sensor_events.fail(text, remedy)

    def _on_timeout(self, flight: _PendingOrder[Op]) -> None:
        name = flight.op.name.lower().replace("_", " ")
        if flight.op is self._dialect.stop and self.statistics.stands:
            self._fail(f"no acknowledge of {name}, and its counter was stuck before", HANGS)
        elif self.phase is Phase.ASKING or flight.tries <= self._profile.retries:
            flight.resend = True
        else:
            self._fail(f"no acknowledge of {name} after {flight.tries} tries", HANGS)

    def _on_not_ready(self, flight: _PendingOrder[Op], now: float) -> None:
        self._answered = True
        if self.phase is Phase.READY:
            self._fail("acknowledges but is not ready any more", "sensor unplugged?")
            return
        order = self._first_step()
        if self._dialect.pause_s is not None:
            self._orders.add(order)
        else:
            # The order is repeated when its acknowledge time-out ends, so neither responses nor requests pile up.
            self._orders.flight = _PendingOrder(order, max(flight.due, now), tries=0)

    def _advance(self, answered: Op, words: Sequence[int], now: float) -> None:
        """Perform the next step of the session after the acknowledge of an order."""
        if answered is self._dialect.zero:
            self._samples.zeroing = True
        elif answered is self._dialect.stop:
            self.phase = Phase.STOPPED
            self._sensor_events.stop()
        elif answered is self._dialect.set_filter:
            if self.phase is _READY:
                self._report_facts()
        else:
            zero_axis = self._scales.take(words) if answered in self._asks_scales else ""
            if zero_axis:
                self._fail(f"full scale of {zero_axis} is 0", "calibration not read?")
            else:
                self._next_step(now)

    def _report_facts(self) -> None:
        delay = first_order_delay(self.cutoff_hz)
        self.tell(SensorReady(facts_of(self._scales.known, self._dialect.period, delay)))

    def _next_step(self, now: float) -> None:
        for phase, order in self._steps:
            if not (self._scales.known and phase in _ASK_SCALES):
                self.phase = phase
                self._orders.add(order)
                return
        self.phase, self._settled_at = Phase.SETTLING, now + self._profile.settle_s


class OfSession(Generic[Op]):
    """Base class of a gateway's client: forwards the owner's requests and the deadlines to the session."""

    def __init__(self, session: GatewaySession[Op]) -> None:
        self._session = session
        self.statistics = session.statistics
        self.zero, self.set_filter, self.stop = session.zero, session.set_filter, session.stop
        self.next_event = session.next_event
        self.next_deadline, self.handle_deadline = session.next_deadline, session.handle_deadline

    @property
    def phase(self) -> Phase:
        """Phase of the session."""
        return self._session.phase

    @property
    def stop_patience(self) -> float:
        """Longest time until SensorStopped if the first stop is lost, s: two time-outs of a stop."""
        return self._session.stop_patience
