"""One session with a gateway of a JR3 sensor, as the clients of both gateways lead it.

Theory of operation. A session goes through the phases ASKING, the steps of its dialect, SETTLING and READY:

| phase | waits for | ends otherwise |
| --- | --- | --- |
| ASKING | the acknowledge "ready" of the question for the state | FAILED after `ready_timeout_s` |
| a step: start, full scales | the acknowledge of its order | ASKING when one says "not ready" |
| SETTLING | the end of `settle_s`; tells SensorReady | ASKING when one says "not ready" |
| READY | its owner, who may stop it | FAILED when one says "not ready", or the counter stands for `still_timeout_s` |
| STOPPING | the acknowledge of the stop; then STOPPED | FAILED after `retries` |

Steps for full scales are left out where these are known. In every phase but ASKING an order without acknowledge is
repeated `retries` times, then the session is FAILED; a full scale of 0 makes it FAILED at once. A boot-up begins the
session again, except in STOPPING and STOPPED. A stop goes out from every phase, FAILED too.

Three sides drive it. The owner asks with `zero`, `set_filter` and `stop`. The client tells what it has read by
`acknowledge`, `boot_up`, `sample`, `notice` and `tell`, and encodes the order that `order_to_send` gives. Time comes
with `handle_deadline`. What the owner is told waits in `next_event`.

An acknowledge does not say what it answers. So one order is under way at a time, others wait: `_Orders`.
A stop, which ends a stream, is acknowledged only after the rest of the stream's period.
A gateway takes its zero with the next sample. One that it has sampled before may follow the acknowledge. So `Zeroed`
is told with the first sample after it, and takes that along.
Pauses keep orders and answers in step. A gateway that is deaf after each acknowledge gets one every time, `pause_s`.
One that always listens gets one after a repeated order only, `ack_timeout_s`, in which late acknowledges pass.
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
    """Where the session is."""

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

# Asked for with every sample, by names of this module: until Python 3.12 an enum's own name costs five times that.
_ASKING, _SETTLING, _READY = Phase.ASKING, Phase.SETTLING, Phase.READY


class SessionProfile(Protocol):
    """Settings of a session that the profiles of both clients have; times in s."""

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
    """Differences between the gateways."""

    name: str
    """Begins the text of a failure."""
    steps: tuple[tuple[Phase, Op], ...]
    """The phases before SETTLING and the order of each; the first is ASKING."""
    zero: Op
    set_filter: Op
    stop: Op
    pause_s: float | None
    """Between an acknowledge and the next order, s, for a gateway that is deaf then; None for one that is not."""
    period: float
    """Between two samples by the gateway's clock, s."""
    counter_step: float
    """See SampleCounter."""
    counter_behind: int
    """See SampleCounter."""
    check_cutoff: Callable[[float], None]
    """Raises ValueError for a cut-off in Hz that cannot be sent."""
    explain_silence: Callable[[str], Trouble]
    """Words for a gateway that acknowledged nothing for a time, which is given as text."""


@dataclass(slots=True)
class _Flight(Generic[Op]):
    """The order that waits for its acknowledge."""

    op: Op
    due: float
    tries: int = 1
    resend: bool = False


class _Orders(Generic[Op]):
    """The order under way and those behind it. A pause may come before the next one."""

    def __init__(self, dialect: Dialect[Op], profile: SessionProfile) -> None:
        self._dialect, self._profile = dialect, profile
        self._queue: deque[Op] = deque()
        self.flight: _Flight[Op] | None = None
        self.quiet_until: float | None = None
        """End of the pause, s."""

    @property
    def are_idle(self) -> bool:
        """Whether there is nothing to send and nothing to wait for."""
        return self.flight is None and not self._queue

    def add(self, op: Op) -> None:
        """Queue an order, to be sent once."""
        if op not in self._queue:
            self._queue.append(op)

    def drop(self) -> None:
        """Forget all orders, the one under way too."""
        self.flight = None
        self._queue.clear()

    def timeout(self, op: Op) -> float:
        """Longest time until an acknowledge, s."""
        rest = self._dialect.period if op == self._dialect.stop else 0.0
        return self._profile.ack_timeout_s + rest

    def next(self, now: float) -> Op | None:
        """Return the next order and count it as sent."""
        flight = self.flight
        if flight is None:
            if not self._queue or (self.quiet_until is not None and now < self.quiet_until):
                return None
            self.quiet_until = None
            op = self._queue.popleft()
            flight = self.flight = _Flight(op, now + self.timeout(op))
        elif flight.resend:
            flight.resend = False
            flight.tries += 1
            flight.due = now + self.timeout(flight.op)
        else:
            return None
        return flight.op

    @property
    def due(self) -> float | None:
        """The next time-out or end of a pause, s."""
        if self.flight is not None:
            return None if self.flight.resend else self.flight.due
        return self.quiet_until if self._queue else None

    def overdue(self, now: float) -> _Flight[Op] | None:
        """Return the order whose acknowledge is overdue; end a pause that is over."""
        if self.quiet_until is not None and now >= self.quiet_until:
            self.quiet_until = None
        flight = self.flight
        return flight if flight is not None and not flight.resend and now >= flight.due else None


class _Scales:
    """The full scales, which are known or asked for."""

    def __init__(self, known: tuple[float, ...]) -> None:
        self.known = known
        """N and N·m; empty while they are not known."""
        self._words: tuple[int, ...] = ()

    def restart(self) -> None:
        """They are asked for from the first one on."""
        self._words = ()

    def take(self, words: Sequence[int]) -> str:
        """Take the next words; the axis whose full scale is 0, or an empty string."""
        for axis, word in zip(AXES[len(self._words) :], words, strict=False):
            if word == 0:
                return axis
        self._words += tuple(words)
        if len(self._words) == len(AXES):
            self.known = full_scales_si(self._words[:3], self._words[3:])
        return ""


class _Samples:
    """The samples of a session: their counter, their range, and the zero that comes with one."""

    def __init__(
        self, counter: SampleCounter, telling: SensorEventQueue, still_timeout: float, now: float
    ) -> None:
        self._counter, self._sensor_events, self._still_timeout = counter, telling, still_timeout
        self._range = Range()
        self.new_at = now
        """When the newest sample with another counter than the one before came, s; not before READY."""
        self.zeroing = False
        """The next sample is the first with another zero."""

    def restart(self) -> None:
        """Follow a gateway that restarts."""
        self.zeroing = False
        self._counter.restart()
        self._range.restart()

    def take(self, counts: tuple[int, int, int, int, int, int], counter: int, at: float, ready: bool) -> str:
        """Tell a sample. What has failed in a session that is `ready`, or an empty string."""
        if (sequence := self._counter.follow(counter)) is None:
            stood = at - self.new_at
            if stood >= self._still_timeout and ready:
                return f"its counter has stood at {counter} for {stood:.1f} s while samples continue"
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
    """The state machine of a client; the client itself reads and writes what is on the wire."""

    def __init__(self, dialect: Dialect[Op], profile: SessionProfile, now: float) -> None:
        self._dialect = dialect
        self._profile = profile
        self.cutoff_hz = profile.cutoff_hz
        """Cut-off in an order; 0 is unfiltered."""
        self.statistics = SensorStatistics()
        self._asks_scales = frozenset(op for phase, op in dialect.steps if phase in _ASK_SCALES)
        self._sensor_events = telling = SensorEventQueue(f"{dialect.name}: ")
        self.tell, self.notice, self.next_event = telling.tell, telling.notice, telling.next_event
        counter = SampleCounter(self.statistics, dialect.counter_step, dialect.counter_behind)
        still_timeout = max(profile.still_timeout_s, 5 * dialect.period)
        self._samples = _Samples(counter, telling, still_timeout, now)
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
        """Forget what is under way and go back to ASKING, whose order this is."""
        self._orders.drop()
        self._scales.restart()
        self._steps: Iterator[tuple[Phase, Op]] = iter(self._dialect.steps)
        self.phase, order = next(self._steps)
        return order

    @property
    def stop_patience(self) -> float:
        """How long SensorStopped may take when the first stop was lost, s: a stop and its repetition."""
        return 2 * self._orders.timeout(self._dialect.stop)

    @property
    def scales_expected(self) -> bool:
        """Whether the next acknowledge may hold full scales: they are asked for, or were when the stop went out."""
        flight = self._orders.flight
        return flight is not None and (flight.op in self._asks_scales or self._foreign_acknowledges > 0)

    # --- requests of the owner

    def zero(self) -> None:
        """Make the present wrench the origin, once settled. Raises LocalProtocolError after the end."""
        self._require_running("zero")
        if self.phase is Phase.READY:
            self._orders.add(self._dialect.zero)
        else:
            self._zero_wanted = True

    def set_filter(self, cutoff_hz: float) -> None:
        """Change the cut-off, now and after a reboot; 0 is unfiltered. Raises LocalProtocolError for what cannot be."""
        self._require_running("set the filter")
        try:
            self._dialect.check_cutoff(cutoff_hz)
        except ValueError as error:
            raise LocalProtocolError(str(error)) from error
        self.cutoff_hz = cutoff_hz
        if self.phase not in _BEFORE_START:  # the start carries the cut-off too
            self._orders.add(self._dialect.set_filter)

    def stop(self) -> None:
        """End the session; SensorStopped tells that the gateway knows. Harmless when called again.

        The stop goes out at once, even to a deaf gateway. The owner may not wait for the pause's end, and a driver may
        keep bytes that arrive. Where it is lost, it is repeated.
        """
        if self.phase in (Phase.STOPPING, Phase.STOPPED):
            return
        # Orders under way may still be acknowledged: that must not be taken for the stop's acknowledge.
        self._foreign_acknowledges = int(self._orders.flight is not None)
        self._end(Phase.STOPPING)
        self._orders.add(self._dialect.stop)

    # --- calls of the client

    def sample(self, counts: tuple[int, int, int, int, int, int], counter: int, at: float) -> None:
        """Accept a sample, complete at this time; it is reported only in READY."""
        if stood := self._samples.take(counts, counter, at, self.phase is _READY):
            self._fail(stood, "sensor unplugged? plug it in, then switch the gateway off and on")

    def boot_up(self, now: float) -> None:
        """Follow a gateway that has restarted and knows nothing of this session."""
        if self.phase in (Phase.STOPPING, Phase.STOPPED):
            return
        if self.phase is not Phase.ASKING:
            self.tell(SensorRestarted())
        self._begin(now)

    def acknowledge(self, state: int, words: Sequence[int] | None, now: float) -> None:
        """Accept an acknowledge, with the words of full scales if it has them."""
        flight = self._orders.flight
        if self._dialect.pause_s is not None:
            self._orders.quiet_until = now + self._dialect.pause_s
        if flight is None:
            return  # late answer to an order that was repeated
        if self._foreign_acknowledges:
            self._foreign_acknowledges -= 1
            return
        if state != GatewayState.READY and flight.op is not self._dialect.stop:
            self._on_not_ready(flight, now)
            return
        if flight.op in self._asks_scales and words is None:
            self.statistics.malformed += 1  # it understood another order; asked again when the time is up
            return
        self._orders.flight = None
        if self._dialect.pause_s is None and flight.tries > 1:
            self._orders.quiet_until = now + self._profile.ack_timeout_s
        self._advance(flight.op, words or (), now)

    def order_to_send(self, now: float) -> Op | None:
        """Return the next order and count it as sent."""
        return self._orders.next(now)

    # --- endpoint

    def next_deadline(self) -> float | None:
        """Return the next time-out or end of a pause."""
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
        """Ask again, give up, or become ready."""
        overdue = self._orders.overdue(now)
        if self.phase is _ASKING and now >= self._ready_by:
            waited = f"{self._profile.ready_timeout_s:g} s"
            answered = Trouble(f"acknowledges but not ready after {waited}", "sensor unplugged?")
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

    def _on_timeout(self, flight: _Flight[Op]) -> None:
        name = flight.op.name.lower().replace("_", " ")
        if flight.op is self._dialect.stop and self.statistics.stands:
            self._fail(f"no acknowledge of {name}, and its counter stood still before", HANGS)
        elif self.phase is Phase.ASKING or flight.tries <= self._profile.retries:
            flight.resend = True
        else:
            self._fail(f"no acknowledge of {name} after {flight.tries} tries", HANGS)

    def _on_not_ready(self, flight: _Flight[Op], now: float) -> None:
        self._answered = True
        if self.phase is Phase.READY:
            self._fail("acknowledges but not ready any more", "sensor unplugged?")
            return
        order = self._first_step()
        if self._dialect.pause_s is not None:
            self._orders.add(order)
        else:
            # Asked again when the acknowledge time-out of this order ends: neither answers nor asks pile up.
            self._orders.flight = _Flight(order, max(flight.due, now), tries=0)

    def _advance(self, answered: Op, words: Sequence[int], now: float) -> None:
        """Take the next step of the session after the acknowledge of an order."""
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
    """A client of a gateway without its wire: requests of the owner, and the clock, concern the session alone."""

    def __init__(self, session: GatewaySession[Op]) -> None:
        self._session = session
        self.statistics = session.statistics
        self.zero, self.set_filter, self.stop = session.zero, session.set_filter, session.stop
        self.next_event = session.next_event
        self.next_deadline, self.handle_deadline = session.next_deadline, session.handle_deadline

    @property
    def phase(self) -> Phase:
        """Where the session is."""
        return self._session.phase

    @property
    def stop_patience(self) -> float:
        """How long SensorStopped may take when the first stop was lost, s: a stop and its repetition."""
        return self._session.stop_patience
