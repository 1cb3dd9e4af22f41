"""The client's side of a session with a JR3 UART gateway.

Order of the session: state, full scales, start, a pause, and on request zero; stop at the end. The gateway
acknowledges a command and then sleeps for a second: what is sent to it in that time is lost, or waits in its
driver and hides what comes after it. So every acknowledge, expected or not, is followed by a pause, one command
is under way at a time, and one without acknowledge is repeated only after more than that second.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum

from protocol.endpoint import LocalProtocolError
from protocol.jr3.counts import AXES, full_scales_si
from protocol.jr3.firmware import UNFILTERED, GatewayState, SampleCounter, first_order_delay
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
from protocol.jr3.uart_gateway.messages import (
    FROM_GATEWAY,
    UART_BAUDRATE,
    Command,
    Op,
    decode_acknowledge,
    decode_data,
    encode_command,
)
from protocol.jr3.uart_gateway.profile import UartGatewayClientProfile, check_uart_cutoff
from protocol.jr3.uart_gateway.reader import Reader


class Phase(Enum):
    """Where the session is."""

    ASKING = "asking for the state"
    SCALES = "asking for the full scales"
    STARTING = "starting"
    SETTLING = "settling"
    READY = "ready"
    STOPPING = "stopping"
    STOPPED = "stopped"
    FAILED = "failed"


_ENDED = frozenset({Phase.STOPPING, Phase.STOPPED, Phase.FAILED})

# Asked for with every sample, by names of this module: until Python 3.12 an enum's own name costs five times that.
_ASKING, _SETTLING, _READY = Phase.ASKING, Phase.SETTLING, Phase.READY
_DATA, _ACKNOWLEDGE, _GET_FULL_SCALES = Op.DATA, Op.ACKNOWLEDGE, Op.GET_FULL_SCALES


@dataclass(slots=True)
class _Flight:
    """The command that waits for its acknowledge."""

    op: Op
    due: float
    tries: int = 1
    resend: bool = False


class UartGatewayClient:
    """Endpoint of the client: takes and gives bytes, tells SensorEvents."""

    def __init__(self, profile: UartGatewayClientProfile, now: float) -> None:
        self._profile = profile
        self._cutoff_hz = profile.cutoff_hz
        self._reader = Reader(FROM_GATEWAY)
        self.statistics = SensorStatistics()
        step = profile.period_ms * 1e3 / profile.sample_period_us
        # Bytes do not overtake each other: only the same counter is an old sample.
        self._counter = SampleCounter(self.statistics, step, behind=0)
        self._events: deque[SensorEvent] = deque()
        self._queue: deque[Op] = deque()
        self._zero_wanted = False
        self._begin(now)

    def _begin(self, now: float) -> None:
        self._phase = Phase.ASKING
        self._ready_by = self._settled_at = now + self._profile.ready_timeout_s
        self._full_scales = self._profile.full_scales
        self._frame_heard = self._answered = False
        self._flight: _Flight | None = None
        self._quiet_until: float | None = None
        self._foreign_acknowledges = 0
        self._counter.restart()
        self._queue.clear()
        self._enqueue(Op.GET_STATE)

    @property
    def phase(self) -> Phase:
        """Where the session is."""
        return self._phase

    @property
    def period(self) -> float:
        """Between two samples by the gateway's clock, s."""
        return self._profile.period_ms * 1e-3

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
            check_uart_cutoff(cutoff_hz)
        except ValueError as error:
            raise LocalProtocolError(str(error)) from error
        self._cutoff_hz = cutoff_hz
        if self._phase not in (Phase.ASKING, Phase.SCALES):
            self._enqueue(Op.SET_FILTER)

    def stop(self) -> None:
        """End the session; SensorStopped tells that the gateway knows. Harmless when called again.

        The stop goes out at once, even into the deaf second: the owner may not wait for its end, and a gateway whose
        driver keeps what arrives will read it then. Where it is lost, it is repeated.
        """
        if self._phase in (Phase.STOPPING, Phase.STOPPED):
            return
        # What is under way may still be acknowledged: that must not be taken for the stop's acknowledge.
        self._foreign_acknowledges = int(self._flight is not None)
        self._phase, self._flight, self._quiet_until = Phase.STOPPING, None, None
        self._queue.clear()
        self._enqueue(Op.STOP)

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes; what is no frame of a gateway is skipped and counted."""
        reader = self._reader
        noises = reader.noises
        reader.feed(data)
        while (frame := reader.next_frame(scales_expected=self._scales_expected)) is not None:
            self._frame_heard = True
            if frame.op is _DATA:
                self._on_data(frame.payload, now)
            elif frame.op is _ACKNOWLEDGE:
                self._on_acknowledge(frame.payload, now)
            else:
                self._on_boot_up(now)
        self.statistics.malformed += reader.noises - noises

    def next_event(self) -> SensorEvent | None:
        """The oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> bytes:
        """The command whose turn it is, whole."""
        if self._quiet_until is not None and now >= self._quiet_until:
            self._quiet_until = None
        if self._flight is None:
            if not self._queue or self._quiet_until is not None:
                return b""
            self._flight = _Flight(self._queue.popleft(), now + self._profile.ack_timeout_s)
        elif self._flight.resend:
            self._flight.resend = False
            self._flight.tries += 1
            self._flight.due = now + self._profile.ack_timeout_s
        else:
            return b""
        return self._bytes(self._flight.op)

    def next_deadline(self) -> float | None:
        """The next time-out or end of a pause."""
        if self._phase is _READY and self._flight is None and not self._queue:
            return None
        due: list[float] = []
        if self._flight is not None and not self._flight.resend:
            due.append(self._flight.due)
        if self._quiet_until is not None and self._flight is None and self._queue:
            due.append(self._quiet_until)
        if self._phase is _ASKING:
            due.append(self._ready_by)
        if self._phase is _SETTLING:
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

    def _require_running(self, wish: str) -> None:
        if self._phase in _ENDED:
            raise LocalProtocolError(f"cannot {wish}: the session is {self._phase.value}")

    def _enqueue(self, op: Op) -> None:
        if op not in self._queue:
            self._queue.append(op)

    @property
    def _scales_expected(self) -> bool:
        """Whether the next acknowledge may hold full scales: they are asked for, or were when the stop went out."""
        flight = self._flight
        return flight is not None and (flight.op is _GET_FULL_SCALES or self._foreign_acknowledges > 0)

    def _bytes(self, op: Op) -> bytes:
        cutoff = round(self._cutoff_hz * 100)
        match op:
            case Op.START:
                return encode_command(Command(op, cutoff, round(self._profile.period_ms * 1000)))
            case Op.SET_FILTER:
                return encode_command(Command(op, cutoff))
            case _:
                return encode_command(Command(op))

    def _fail(self, text: str) -> None:
        self._phase, self._flight, self._quiet_until = Phase.FAILED, None, None
        self._queue.clear()
        self._events.append(SensorFailed(f"UART gateway: {text}"))

    def _why_not_ready(self) -> str:
        waited = f"{self._profile.ready_timeout_s:g} s"
        if self._answered:
            return f"acknowledges but not ready after {waited}: sensor unplugged?"
        if self._frame_heard:
            return f"sends but acknowledges nothing in {waited}: is the line to it open?"
        if self._reader.skipped:
            return (
                f"bytes but no frame of a gateway in {waited}: not {UART_BAUDRATE} baud, or another device?"
            )
        return f"silent for {waited}: power, cable, port?"

    def _on_timeout(self, flight: _Flight) -> None:
        if self._phase is Phase.ASKING or flight.tries <= self._profile.retries:
            flight.resend = True
        else:
            name = flight.op.name.lower().replace("_", " ")
            self._fail(f"no acknowledge of {name} after {flight.tries} tries")

    def _on_boot_up(self, now: float) -> None:
        if self._phase in (Phase.STOPPING, Phase.STOPPED):
            return
        if self._phase is not Phase.ASKING:
            self._events.append(SensorRestarted())
        self._begin(now)

    def _on_acknowledge(self, payload: bytes, now: float) -> None:
        acknowledge = decode_acknowledge(payload)
        flight = self._flight
        self._quiet_until = now + self._profile.pause_s
        if flight is None:
            return  # late answer to a command that was repeated
        if self._foreign_acknowledges:
            self._foreign_acknowledges -= 1
            return
        if acknowledge.state != GatewayState.READY and flight.op is not Op.STOP:
            self._on_not_ready()
            return
        if flight.op is Op.GET_FULL_SCALES and acknowledge.full_scales is None:
            self.statistics.malformed += 1  # it understood another command; asked again when the time is up
            return
        self._flight = None
        self._advance(flight.op, acknowledge.full_scales or (), now)

    def _on_not_ready(self) -> None:
        self._answered = True
        if self._phase is Phase.READY:
            self._fail("acknowledges but not ready any more: sensor unplugged?")
            return
        self._phase, self._flight = Phase.ASKING, None
        self._queue.clear()
        self._enqueue(Op.GET_STATE)

    def _advance(self, answered: Op, words: tuple[int, ...], now: float) -> None:
        """The next step of the session after the acknowledge of a command."""
        match answered:
            case Op.GET_STATE if self._full_scales:
                self._start()
            case Op.GET_STATE:
                self._phase = Phase.SCALES
                self._enqueue(Op.GET_FULL_SCALES)
            case Op.GET_FULL_SCALES:
                for axis, word in zip(AXES, words, strict=True):
                    if word == 0:
                        self._fail(f"full scale of {axis} is 0: calibration not read?")
                        return
                self._full_scales = full_scales_si(words[:3], words[3:])
                self._start()
            case Op.START:
                self._phase, self._settled_at = Phase.SETTLING, now + self._profile.settle_s
            case Op.ZERO:
                self._events.append(Zeroed())
            case Op.STOP:
                self._phase = Phase.STOPPED
                self._events.append(SensorStopped())
            case _:  # a new cut-off changes nothing here
                pass

    def _start(self) -> None:
        self._phase = Phase.STARTING
        self._enqueue(Op.START)

    # --- samples

    def _on_data(self, payload: bytes, now: float) -> None:
        if self._phase is not _READY:
            return
        data = decode_data(payload)
        if (sequence := self._counter.follow(data.counter)) is not None:
            self._events.append(SensorFrame(data.counts, data.counter, sequence, now))
