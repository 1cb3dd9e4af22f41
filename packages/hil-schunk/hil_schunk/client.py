"""Client of a SCHUNK FTS: identifies the sensor, selects its filter, starts the stream, and monitors the counter and
the status of the packets.

It never tares the sensor; the host subtracts the zero.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Any, TypeAlias

from hil_schunk.client_settings import FtsClientSettings
from hil_schunk.messages import (
    COUNTERS,
    HARDWARE,
    INVALID,
    MECHANICAL,
    PERIOD_S,
    PRODUCT_NAME,
    PRODUCT_NUMBER,
    READY,
    TEMPERATURE,
    USER,
    Answer,
    Command,
    MessageReader,
    Packet,
    decode_answer,
    decode_packet,
    encode_command,
    encode_message,
    encode_read,
    error_words,
    status_words,
)
from protocol import pieces
from protocol.arrival_clock import ArrivalClock
from protocol.datagram import arrived_at
from protocol.endpoint import RemoteProtocolError
from protocol.outbox import Outbox
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFacts, SensorStatistics


class Port(StrEnum):
    """Connection to the sensor."""

    DATA = "data"
    COMMANDS = "commands"


Piece: TypeAlias = pieces.Piece[Port, Any]
"""Bytes of the commands, or datagrams of the data."""

_BEHIND_LIMIT = 10
"""Number of consecutive packets older than the newest packet that mean that the sensor was restarted. Chosen: fewer
are stragglers.
"""
_ALL_AXES = 0b111111
_FAULTS = INVALID | TEMPERATURE | HARDWARE
_OVERLOADS = MECHANICAL | USER
_TEXT_MAX = 40
"""Maximum number of displayed characters of a name. Chosen."""


class FtsClient(Outbox[Piece]):
    """`SensorClient` over the pieces of two connections."""

    def __init__(self, settings: FtsClientSettings, now: float) -> None:
        super().__init__()
        self.statistics = SensorStatistics()
        self.stop_patience = settings.answer_s
        self._settings = settings
        self._sensor_events = events = SensorEventQueue(
            zero_samples=max(1, round(settings.zero_s / PERIOD_S))
        )
        self.next_event, self.zero = events.next_event, events.zero
        self._reader = MessageReader()
        self._requests = deque(_start_up(settings))
        """Payloads of the requests that must be answered before the stream begins."""
        self._waiting: int | None = None
        """Command of the newest request while its answer is pending."""
        self._identity: list[str] = []
        """Product name and number, as far as they have been received."""
        self._known: list[str] = []
        """Product name and number before the stream was interrupted."""
        self._streams = False
        """Whether the stream has been requested."""
        self._starts = 0
        """Number of requests for the stream since the last packet."""
        self._give_up_at = now + settings.answer_s + settings.ready_s
        """Time until which the sensor may report that it is not ready, s."""
        self._counter = self._sequence = 0
        """Counter of the newest packet, and this counter unwrapped."""
        self._behind = 0
        """Number of consecutive packets older than the newest packet."""
        self._clock = ArrivalClock()
        self._stopping = self._stop_timed = False
        """Whether the client has requested the end of the stream, and whether its timeout has begun."""
        self._ask_next(now)

    # --- Endpoint

    def receive(self, data: Sequence[Piece], now: float) -> None:
        """Process answers and packets."""
        for port, contents in data:
            if port is Port.DATA:
                for datagram in contents:
                    self._process_packet(datagram, now)
            else:
                noises = self._reader.noises
                for message in self._reader.feed(contents):
                    self._process_answer(message.payload, now)
                self.statistics.malformed += self._reader.noises - noises

    def handle_deadline(self, now: float) -> None:
        """Request the stream again, or report a failure."""
        if self._due is None or now < self._due:
            return
        if self._stopping:
            self._time_stop(now)
        elif not self._streams:
            self._fail(
                f"no answer to the command {Command(self._waiting or 0).label} within {self._settings.answer_s:g} s",
                "check its supply, its cable and its address",
            )
        elif self._starts >= self._settings.starts:
            self._fail(
                f"no packet received after {self._starts} requests",
                f"check whether a firewall or another program uses UDP port {self._settings.data_port}",
            )
        else:
            if self._sensor_events.ready and not self._starts:
                self._sensor_events.notice(
                    f"no packet for {self._settings.silence_s * 1e3:g} ms; requested again"
                )
            self._begin_again(now)

    def stop(self) -> None:
        """Stop the stream."""
        if not (self._sensor_events.ended or self._stopping):
            self._stopping, self._due = True, 0.0
            self._send(encode_command(Command.STOP))

    # --- commands

    def _begin_again(self, now: float) -> None:
        """Repeat the start-up: the sensor may have lost its settings, or another one may answer."""
        self._known, self._identity = self._known or self._identity, []
        self._requests = deque(_start_up(self._settings))
        self._starts += 1
        self._ask_next(now)

    def _ask_next(self, now: float) -> None:
        """Send the next request of the start-up, or start the stream after the last one."""
        if self._requests:
            self._send(self._requests.popleft())
        else:
            self._send(encode_command(Command.START))
            self._streams, self._starts = True, max(self._starts, 1)
        self._due = now + (self._settings.silence_s if self._streams else self._settings.answer_s)

    def _send(self, payload: bytes) -> None:
        self._out.append(pieces.Piece(Port.COMMANDS, encode_message(0, payload)))
        self._waiting = payload[0]

    def _process_answer(self, payload: bytes, now: float) -> None:
        if self._sensor_events.ended:
            return
        try:
            answer = decode_answer(payload)
        except RemoteProtocolError:
            self.statistics.malformed += 1
            return
        if answer.command != self._waiting:
            return  # to an earlier request for the stream
        self._waiting = None
        if self._stopping:
            self._finish()
        elif answer.command == Command.READ:
            self._identify(_text(answer.value), now)
        elif answer.error:
            self._refused(answer)
        elif answer.command != Command.START:
            self._ask_next(now)

    def _identify(self, text: str, now: float) -> None:
        known = self._known[len(self._identity) :]
        if known and text != known[0]:
            self._fail(f"another sensor answers: {text} instead of {known[0]}", "start the run again")
            return
        self._identity.append(text)
        self._ask_next(now)

    def _refused(self, answer: Answer) -> None:
        text = f"it answers the command {Command(answer.command).label} with {error_words(answer.error)}"
        if self._sensor_events.ready and answer.command == Command.START:
            self._sensor_events.notice(text)
        else:
            self._fail(text, "restart it; a firmware with other commands is not supported")

    # --- stream

    def _process_packet(self, datagram: bytes, now: float) -> None:
        if self._sensor_events.ended or self._stopping or not self._streams:
            return
        try:
            packet = decode_packet(datagram)
        except RemoteProtocolError:
            self.statistics.malformed += 1
            return
        arrived = arrived_at(datagram, now)
        self._due = max(
            self._due or 0.0, arrived + self._settings.silence_s
        )  # a straggler has an earlier arrival
        events = self._sensor_events
        if not events.ready:
            if not self._is_usable(packet.status, arrived):
                return
            self._counter = self._sequence = packet.counter
            events.begin(self._facts())
        elif not self._is_next(packet.counter):
            return
        if self._starts:
            self._clock, self._starts = ArrivalClock(), 0  # the sensor may not count while it does not send
        saturated = 0
        if packet.status != READY:
            saturated = (
                _ALL_AXES  # the sensor does not name an axis; the values are invalid, so a run retracts
            )
            if not events.knows_status(packet.status):
                events.notice_status(packet.status, _status_text(packet))
        self._behind = self.statistics.standing = 0
        at = self._clock.sent_at(self._sequence * PERIOD_S, arrived)
        events.numbered_sample(packet.wrench, packet.counter, self._sequence, at, saturated)

    def _is_usable(self, status: int, now: float) -> bool:
        """Return whether the stream can begin with this status. Fail if the sensor reports a fault, or is not ready
        for too long.
        """
        if status & READY and status & _FAULTS:
            self._fail(f"it reports: {status_words(status)}", "check the sensor with the maker's tools")
        elif not status & (READY | _OVERLOADS):
            if now < self._give_up_at:
                return False
            self._fail(f"it reports: {status_words(status)}", "wait until it is ready, or restart it")
        return not self._sensor_events.ended

    def _is_next(self, counter: int) -> bool:
        """Return whether a packet is newer than the newest one so far. Count missing and outdated packets."""
        step = (counter - self._counter) % COUNTERS
        if not 0 < step < COUNTERS // 2:
            self.statistics.repeated += 1
            if not step:
                self.statistics.standing += 1
                return False
            self._behind += 1
            if self._behind < _BEHIND_LIMIT:
                return False
            self._sensor_events.restart()
            step = 1
        else:
            self.statistics.lost += step - 1
        self._counter = counter
        self._sequence += step
        return True

    def _facts(self) -> SensorFacts:
        model = " ".join(filter(None, ("SCHUNK", *self._identity)))
        return SensorFacts(model, (1.0,) * 6, None, None, PERIOD_S, self._settings.delay, "host")

    # --- end

    def _time_stop(self, now: float) -> None:
        if self._stop_timed:
            self._finish()
        else:
            self._stop_timed, self._due = True, now + self._settings.answer_s

    def _finish(self) -> None:
        self._due = None
        self._sensor_events.stop()

    def _fail(self, text: str, remedy: str) -> None:
        self._due = None
        self._send(encode_command(Command.STOP))
        self._sensor_events.fail(text, remedy)


def _start_up(settings: FtsClientSettings) -> Iterator[bytes]:
    """Generate the payloads of the requests before the stream, in order."""
    yield encode_read(PRODUCT_NAME)
    yield encode_read(PRODUCT_NUMBER)
    if settings.tool >= 0:
        yield encode_command(Command.SELECT_TOOL, settings.tool)
    yield encode_command(Command.SELECT_FILTER, settings.filter)


def _status_text(packet: Packet) -> str:
    return f"status {packet.status:08X}: {status_words(packet.status)}"


def _text(value: bytes) -> str:
    """Convert the value of a parameter for display: text if it is text, otherwise hexadecimal."""
    text = value.rstrip(b"\0").decode("ascii", errors="replace")
    readable = text.isprintable() and "\N{REPLACEMENT CHARACTER}" not in text
    return (text if readable else value.hex())[:_TEXT_MAX]
