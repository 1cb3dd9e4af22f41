"""Register server for one connection and any board."""

from collections import deque
from dataclasses import dataclass, field

from protocol.devices.jr3.board import Registers
from protocol.devices.jr3.registers.profile import RegisterServerProfile
from protocol.devices.jr3.registers.telegrams import (
    BURST,
    MAX_PAYLOAD,
    MAX_WORDS,
    Garbage,
    Op,
    Request,
    Response,
    Status,
    encode_head,
    encode_response,
    fits,
    request_reader,
)
from protocol.endpoint import RemoteProtocolError


@dataclass(frozen=True, slots=True)
class ConnectionOver:
    """The connection ends, and the client has been informed. The owner sends the remaining data and closes the
    connection.
    """

    text: str


@dataclass(slots=True)
class _Stream:
    """State of a stream. Burst k is due at `anchor` + k · `period`."""

    head: bytes
    """Header of every delivery."""
    address: int
    count: int
    anchor: float
    period: float
    at_once: int
    delivery: bytes = field(init=False)
    """Delivery that is being filled, including its header."""
    held: int = 0
    """Number of bursts in `delivery`."""
    number: int = 1
    """Number of the next burst. The first burst is due one period after the anchor, so that it needs as much time
    as any other burst.
    """
    due: float = field(init=False)

    def __post_init__(self) -> None:
        self.delivery = self.head
        self.due = self.anchor + self.number * self.period


class ResetRefused(RemoteProtocolError):
    """The board must not be reset. Raised by its registers with the reason."""


class RegisterServer:
    """Endpoint of the server over a byte stream. It reports ConnectionOver if the client can no longer be served.

    After that, the server starts again, because some wires have only one connection.
    """

    def __init__(self, registers: Registers, profile: RegisterServerProfile, now: float) -> None:
        self._registers = registers
        self._profile = profile
        self._events: deque[ConnectionOver] = deque()
        self._begin(now)

    def _begin(self, now: float) -> None:
        self._reader = request_reader()
        self._waiting: deque[Request | Garbage] = deque()
        self._out = b""
        self._stream: _Stream | None = None
        self._heard_at = now

    # --- Endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Buffer received bytes. Requests are answered only when data to send is requested, so that responses
        cannot pile up.
        """
        self._waiting.extend(self._reader.feed(data))

    def next_event(self) -> ConnectionOver | None:
        """Return the oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> bytes:
        """Return responses and bursts, about 16 KiB at a time."""
        while self._waiting and len(self._out) < MAX_PAYLOAD:
            item = self._waiting.popleft()
            if isinstance(item, Garbage):
                self._end(Status.BAD_FRAME, item.text, now)
            else:
                self._heard_at = now
                self._answer(item, now)
        data, self._out = self._out, b""
        return data

    def next_deadline(self) -> float | None:
        """Return the time of the stream's next burst or, without a stream, of the time-out of an idle client, s."""
        if self._stream is not None:
            return self._stream.due
        timeout = self._profile.idle_timeout_s
        return self._heard_at + timeout if timeout else None

    def handle_deadline(self, now: float) -> None:
        """Read the burst that is due. A missed burst is skipped, because its data no longer exists."""
        stream = self._stream
        if stream is None:
            timeout = self._profile.idle_timeout_s
            if timeout and now >= self._heard_at + timeout:
                self._end(Status.IDLE, f"no request for {timeout:g} s", now)
        elif now >= stream.due:
            stream.number = max(stream.number, int((now - stream.anchor) / stream.period)) + 1
            stream.due = stream.anchor + stream.number * stream.period
            stream.delivery += self._burst(stream.address, stream.count, now)
            stream.held += 1
            if stream.held == stream.at_once:
                self._out += stream.delivery
                stream.delivery, stream.held = stream.head, 0

    # --- requests

    def _answer(self, request: Request, now: float) -> None:
        burst = b""
        try:
            match request.op:
                case Op.READ:
                    status = self._check_count(request.count, 1)
                    if status is Status.OK:
                        burst = self._burst(request.address, request.count, now)
                case Op.WRITE:
                    status = Status.OK
                    self._registers.write(request.address, request.words, now)
                case Op.RESET:
                    status = Status.OK
                    self._registers.reset(now)
                case Op.PROGRAM:
                    status = Status.OK
                    self._registers.load(request.address, request.words, now)
                case Op.STREAM:
                    status = self._on_stream(request, now)
                    if status is Status.OK:
                        return
                case _:
                    status = Status.UNKNOWN_OP
        except ResetRefused:
            status = Status.REFUSED
        except RemoteProtocolError:
            status = Status.OUTSIDE_MAP
        self._send(request, status, burst)

    def _on_stream(self, request: Request, now: float) -> Status:
        """Start, change or end the stream. The acknowledge precedes the first burst."""
        if not request.period_us:
            self._stream = None
            self._send(request, Status.OK)
            return Status.OK
        at_once = max(request.bursts, 1)
        if (status := self._check_count(request.count, at_once)) is not Status.OK:
            return status
        if request.period_us < self._profile.shortest_period_us:
            return Status.BAD_PERIOD
        self._burst(request.address, request.count, now)
        self._send(request, Status.OK)
        answer = Response(Op.STREAM, Status.OK, request.tag, request.address, request.count)
        head = encode_head(answer, at_once)
        period = request.period_us * 1e-6
        self._stream = _Stream(head, request.address, request.count, now, period, at_once)
        return Status.OK

    def _check_count(self, count: int, bursts: int) -> Status:
        return Status.OK if 0 < count <= MAX_WORDS and fits(count, bursts) else Status.BAD_COUNT

    def _burst(self, address: int, count: int, now: float) -> bytes:
        return round(now * 1e9).to_bytes(BURST.size) + self._registers.burst(address, count, now)

    def _send(self, request: Request, status: Status, burst: bytes = b"") -> None:
        answer = Response(request.op, status, request.tag, request.address, request.count)
        head = encode_head(answer, 1 if burst else 0)
        self._out += head + burst

    def _end(self, status: Status, text: str, now: float) -> None:
        data = self._out + farewell(status)
        self._begin(now)
        self._out = data
        self._events.append(ConnectionOver(text))


def farewell(status: Status) -> bytes:
    """Return the notice that a server sends before it closes a connection."""
    return encode_response(Response(Op.CONNECTION, status, 0))
