"""The client's side of a session with a JR3 CAN gateway.

Order of the session as the YARP client of the gateway does it: state, start, full scales, a pause, and on
request zero; stop at the end. An acknowledge does not say what it answers, so one command is under way at a
time, and after a repeated command late acknowledges are let pass before the next.
"""

import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from protocol.can import CanFrame
from protocol.can_error import decode_error
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.jr3.can_gateway.messages import (
    FORCES,
    MOMENTS,
    Command,
    Op,
    decode_acknowledge,
    encode_command,
    identifier,
)
from protocol.jr3.can_gateway.profile import GatewayClientProfile
from protocol.jr3.counts import AXES, full_scales_si
from protocol.jr3.firmware import UNFILTERED, GatewayState, SampleCounter, check_cutoff, first_order_delay
from protocol.jr3.session import (
    SensorEvent,
    SensorFailed,
    SensorFrame,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStatistics,
    SensorStopped,
    Zeroed,
)

STRAGGLER_S = 0.5
"""Chosen: a counter that steps back by less than this is an old frame; by more, it is a far step forward."""


class Phase(Enum):
    """Where the session is."""

    ASKING = "asking for the state"
    STARTING = "starting"
    FORCE_SCALES = "asking for the full scales of forces"
    MOMENT_SCALES = "asking for the full scales of moments"
    SETTLING = "settling"
    READY = "ready"
    STOPPING = "stopping"
    STOPPED = "stopped"
    FAILED = "failed"


_SYNC = CanFrame(Op.SYNC)
_ENDED = frozenset({Phase.STOPPING, Phase.STOPPED, Phase.FAILED})


@dataclass(slots=True)
class _Flight:
    """The command that waits for its acknowledge."""

    op: Op
    due: float
    tries: int = 1
    resend: bool = False


class GatewayClient:
    """Endpoint of the client: takes and gives sequences of CAN frames, tells GatewayEvents."""

    def __init__(self, profile: GatewayClientProfile, now: float) -> None:
        self._profile = profile
        self._cutoff_hz = profile.cutoff_hz
        self._force_id = identifier(Op.FORCES, profile.node)
        self._moment_id = identifier(Op.MOMENTS, profile.node)
        self._acknowledge_id = identifier(Op.ACKNOWLEDGE, profile.node)
        self._boot_up_id = identifier(Op.BOOT_UP, profile.node)
        samples_per_second = 1e6 / profile.sample_period_us
        step = profile.period_ms * 1e-3 * samples_per_second if profile.mode == "async" else 0.0
        # Answers to SYNC come in order and after any time: there only the same counter is an old sample.
        behind = int(STRAGGLER_S * samples_per_second) if step else 0
        self.statistics = SensorStatistics()
        self._counter = SampleCounter(self.statistics, step, behind)
        self._events: deque[SensorEvent] = deque()
        self._syncs = 0
        self._zero_wanted = False
        self._others_heard = False
        self._phase = Phase.ASKING
        self._ready_by = self._settled_at = now
        self._full_scales: tuple[float, ...] = ()
        self._force_words: tuple[int, ...] = ()
        self._answered = False
        self._flight: _Flight | None = None
        self._queue: deque[Op] = deque()
        self._quiet_until: float | None = None
        self._foreign_acknowledges = 0
        self._forces: bytes | None = None
        self._begin(now)

    @property
    def phase(self) -> Phase:
        """Where the session is."""
        return self._phase

    @property
    def period(self) -> float | None:
        """Between two samples by the gateway's clock, s; None where it answers each SYNC."""
        return self._profile.period_ms * 1e-3 if self._profile.mode == "async" else None

    @property
    def delay(self) -> float:
        """How much later than the force itself a sample with the present cut-off tells of it, s."""
        return first_order_delay(self._cutoff_hz)

    @property
    def stop_patience(self) -> float:
        """How long SensorStopped may take when the first stop was lost, s: a stop and its repetition."""
        return 2 * self._profile.ack_timeout_s

    # --- what the owner asks for

    def zero(self) -> None:
        """Make the present wrench the origin, once settled. Raises LocalProtocolError after the end."""
        self._require_running("zero")
        if self._phase is Phase.READY:
            self._enqueue(Op.ZERO)
        else:
            self._zero_wanted = True

    def set_filter(self, cutoff_hz: float) -> None:
        """Change the cut-off, now and after a reboot; 0 is unfiltered. Raises LocalProtocolError for what cannot be."""
        self._require_running("set the filter")
        try:
            check_cutoff(cutoff_hz)
        except ValueError as error:
            raise LocalProtocolError(str(error)) from error
        self._cutoff_hz = cutoff_hz
        if self._phase is not Phase.ASKING:
            self._enqueue(Op.SET_FILTER)

    def sync(self) -> None:
        """Ask for one sample. Raises LocalProtocolError unless the session is ready."""
        if self._phase is not Phase.READY:
            raise LocalProtocolError(f"cannot ask for a sample while {self._phase.value}")
        self._syncs += 1

    def stop(self) -> None:
        """End the session; SensorStopped tells that the gateway knows. Harmless when called again."""
        if self._phase in (Phase.STOPPING, Phase.STOPPED):
            return
        # What is under way may still be acknowledged: that must not be taken for the stop's acknowledge.
        self._foreign_acknowledges = int(self._flight is not None)
        self._phase, self._flight, self._quiet_until = Phase.STOPPING, None, None
        self._syncs = 0
        self._queue.clear()
        self._enqueue(Op.STOP)

    # --- endpoint

    def receive(self, data: Sequence[CanFrame], now: float) -> None:
        """Take a batch of frames; those of other nodes and ops are ignored, error reports are told."""
        for frame in data:
            if frame.error:
                self._on_error_report(frame)
                continue
            if frame.extended or frame.remote:
                continue
            number = frame.identifier
            if number == self._force_id:
                self._on_forces(frame)
            elif number == self._moment_id:
                self._on_moments(frame, now)
            elif number == self._acknowledge_id:
                self._on_acknowledge(frame, now)
            elif number == self._boot_up_id:
                self._on_boot_up(now)
            else:
                self._others_heard = True

    def next_event(self) -> SensorEvent | None:
        """The oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Sequence[CanFrame]:
        """The command whose turn it is, and a SYNC for every sample asked for."""
        if not (self._queue or self._syncs or self._flight):
            return ()
        frames: list[CanFrame] = []
        if self._quiet_until is not None and now >= self._quiet_until:
            self._quiet_until = None
        if self._flight is None and self._queue and self._quiet_until is None:
            self._flight = _Flight(self._queue.popleft(), now + self._profile.ack_timeout_s)
            frames.append(self._frame(self._flight.op))
        elif self._flight is not None and self._flight.resend:
            self._flight.resend = False
            self._flight.tries += 1
            self._flight.due = now + self._profile.ack_timeout_s
            frames.append(self._frame(self._flight.op))
        frames.extend(itertools.repeat(_SYNC, self._syncs))
        self._syncs = 0
        return frames

    def next_deadline(self) -> float | None:
        """The next time-out or end of a pause."""
        if self._phase is Phase.READY and self._flight is None and self._quiet_until is None:
            return None
        due: list[float] = []
        if self._flight is not None and not self._flight.resend:
            due.append(self._flight.due)
        if self._quiet_until is not None and self._queue:
            due.append(self._quiet_until)
        if self._phase is Phase.ASKING:
            due.append(self._ready_by)
        if self._phase is Phase.SETTLING:
            due.append(self._settled_at)
        return min(due, default=None)

    def handle_deadline(self, now: float) -> None:
        """Ask again, give up, or become ready."""
        if self._quiet_until is not None and now >= self._quiet_until:
            self._quiet_until = None
        if self._phase is Phase.ASKING and now >= self._ready_by:
            self._fail(self._why_not_ready())
        elif self._flight is not None and not self._flight.resend and now >= self._flight.due:
            self._on_timeout(self._flight)
        if self._phase is Phase.SETTLING and now >= self._settled_at:
            self._phase = Phase.READY
            self._events.append(SensorReady(self._full_scales))
            if not self._cutoff_hz:
                self._events.append(SensorNotice(UNFILTERED))
            if self._zero_wanted:
                self._zero_wanted = False
                self._enqueue(Op.ZERO)

    # --- session

    def _begin(self, now: float) -> None:
        self._phase = Phase.ASKING
        self._ready_by = now + self._profile.ready_timeout_s
        self._full_scales = self._profile.full_scales
        self._answered = False
        self._flight = self._quiet_until = None
        self._foreign_acknowledges = 0
        self._forces = None
        self._counter.restart()
        self._syncs = 0
        self._queue.clear()
        self._enqueue(Op.GET_STATE)

    def _require_running(self, wish: str) -> None:
        if self._phase in _ENDED:
            raise LocalProtocolError(f"cannot {wish}: the session is {self._phase.value}")

    def _enqueue(self, op: Op) -> None:
        if op not in self._queue:
            self._queue.append(op)

    def _frame(self, op: Op) -> CanFrame:
        node, cutoff = self._profile.node, round(self._cutoff_hz * 100)
        match op:
            case Op.START_ASYNC:
                return encode_command(Command(op, node, cutoff, round(self._profile.period_ms * 1000)))
            case Op.START_SYNC | Op.SET_FILTER:
                return encode_command(Command(op, node, cutoff))
            case _:
                return encode_command(Command(op, node))

    def _fail(self, text: str) -> None:
        self._phase, self._flight, self._quiet_until = Phase.FAILED, None, None
        self._queue.clear()
        self._syncs = 0
        self._events.append(SensorFailed(f"gateway node {self._profile.node}: {text}"))

    def _why_not_ready(self) -> str:
        waited = f"{self._profile.ready_timeout_s:g} s"
        if self._answered:
            return f"acknowledges but not ready after {waited}: sensor unplugged?"
        if self._others_heard:
            return f"silent for {waited} while others are on the bus: wrong node number?"
        return f"silent: nothing of a gateway on the bus in {waited}: power, bit rate, wiring?"

    def _on_timeout(self, flight: _Flight) -> None:
        if self._phase is Phase.ASKING or flight.tries <= self._profile.retries:
            flight.resend = True
        else:
            name = flight.op.name.lower().replace("_", " ")
            self._fail(f"no acknowledge of {name} after {flight.tries} tries")

    def _on_error_report(self, frame: CanFrame) -> None:
        try:
            self._events.append(SensorNotice(f"CAN bus: {decode_error(frame)}"))
        except RemoteProtocolError:
            self.statistics.malformed += 1

    def _on_boot_up(self, now: float) -> None:
        if self._phase in (Phase.STOPPING, Phase.STOPPED):
            return
        if self._phase is not Phase.ASKING:
            self._events.append(SensorRestarted())
        self._begin(now)

    def _on_acknowledge(self, frame: CanFrame, now: float) -> None:
        try:
            acknowledge = decode_acknowledge(frame.data)
        except RemoteProtocolError:
            self.statistics.malformed += 1
            return
        flight = self._flight
        if flight is None:
            return  # late answer to a command that was repeated
        if self._foreign_acknowledges:
            self._foreign_acknowledges -= 1
            return
        if acknowledge.state != GatewayState.READY and flight.op is not Op.STOP:
            self._on_not_ready(flight, now)
            return
        asks_scales = flight.op in (Op.GET_FORCE_FULL_SCALES, Op.GET_MOMENT_FULL_SCALES)
        if asks_scales and acknowledge.full_scales is None:
            self.statistics.malformed += 1
            return
        self._flight = None
        if flight.tries > 1:
            self._quiet_until = now + self._profile.ack_timeout_s
        self._advance(flight.op, acknowledge.full_scales or (), now)

    def _on_not_ready(self, flight: _Flight, now: float) -> None:
        self._answered = True
        if self._phase is Phase.READY:
            self._fail("acknowledges but not ready any more: sensor unplugged?")
            return
        # Asked again when the acknowledge time-out of this command ends: neither answers nor asks pile up.
        self._phase = Phase.ASKING
        self._queue.clear()
        self._flight = _Flight(Op.GET_STATE, max(flight.due, now), tries=0)

    def _advance(self, answered: Op, words: Sequence[int], now: float) -> None:
        """The next step of the session after the acknowledge of a command."""
        match answered:
            case Op.GET_STATE:
                self._phase = Phase.STARTING
                self._queue.append(Op.START_ASYNC if self._profile.mode == "async" else Op.START_SYNC)
            case Op.START_ASYNC | Op.START_SYNC if self._full_scales:
                self._settle(now)
            case Op.START_ASYNC | Op.START_SYNC:
                self._phase = Phase.FORCE_SCALES
                self._queue.append(Op.GET_FORCE_FULL_SCALES)
            case Op.GET_FORCE_FULL_SCALES:
                if self._accept_scales(words, AXES[:3]):
                    self._force_words = tuple(words)
                    self._phase = Phase.MOMENT_SCALES
                    self._queue.append(Op.GET_MOMENT_FULL_SCALES)
            case Op.GET_MOMENT_FULL_SCALES:
                if self._accept_scales(words, AXES[3:]):
                    self._full_scales = full_scales_si(self._force_words, words)
                    self._settle(now)
            case Op.ZERO:
                self._events.append(Zeroed())
            case Op.STOP:
                self._phase = Phase.STOPPED
                self._events.append(SensorStopped())
            case _:  # a new cut-off changes nothing here
                pass

    def _accept_scales(self, words: Sequence[int], axes: Sequence[str]) -> bool:
        for axis, word in zip(axes, words, strict=True):
            if word == 0:
                self._fail(f"full scale of {axis} is 0: calibration not read?")
                return False
        return True

    def _settle(self, now: float) -> None:
        self._phase, self._settled_at = Phase.SETTLING, now + self._profile.settle_s

    # --- samples: two frames each, up to 1 kHz, so nothing is decoded that is not used

    def _on_forces(self, frame: CanFrame) -> None:
        if self._phase is not Phase.READY:
            return
        if len(frame.data) < FORCES.size:
            self.statistics.malformed += 1
            return
        if self._forces is not None:
            self.statistics.unpaired += 1
        self._forces = frame.data

    def _on_moments(self, frame: CanFrame, now: float) -> None:
        if self._phase is not Phase.READY:
            return
        if len(frame.data) < MOMENTS.size:
            self.statistics.malformed += 1
            return
        if self._forces is None or self._forces[6:] != frame.data[6:]:
            self.statistics.unpaired += 1
            return
        fx, fy, fz, counter = FORCES.unpack_row(self._forces)
        mx, my, mz, _ = MOMENTS.unpack_row(frame.data)
        self._forces = None
        if (sequence := self._counter.follow(counter)) is not None:
            at = now if frame.received_at is None else frame.received_at
            self._events.append(SensorFrame((fx, fy, fz, mx, my, mz), counter, sequence, at))
