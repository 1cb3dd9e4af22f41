"""Client of an OnRobot HEX: sets rate and filter, switches the sensor's bias off, starts the stream, and monitors the
sequence numbers and the status of the records.

It never biases the sensor; the host subtracts the zero. The requests of a start are spaced as in the maker's example.
"""

from collections import deque
from collections.abc import Iterator, Sequence

from hil_onrobot.client_settings import HexClientSettings
from hil_onrobot.messages import BIAS_OFF, PAUSE_S, RECORD, WRAP, Command, encode_request
from protocol.arrival_clock import ArrivalClock
from protocol.datagram import arrived_at
from protocol.outbox import Outbox
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFacts, SensorStatistics

_STOP_AGAIN_S = 0.02
"""Time after which a stop is repeated while records still arrive, s. Chosen."""
_STOPS = 4
_BEHIND_LIMIT = 10
"""Number of consecutive records older than the newest record that mean that the sensor was restarted. Chosen: fewer
are stragglers.
"""
_ALL_AXES = 0b111111
_unpack = RECORD.struct.unpack


class HexClient(Outbox[bytes]):
    """`SensorClient` over datagrams."""

    stop_patience = _STOPS * _STOP_AGAIN_S

    def __init__(self, settings: HexClientSettings, now: float) -> None:
        super().__init__()
        self.statistics = SensorStatistics()
        self._settings = settings
        self._sensor_events = events = SensorEventQueue(
            zero_samples=max(1, round(settings.zero_s / settings.period))
        )
        self.next_event, self.zero = events.next_event, events.zero
        self._silence = max(settings.silence_s, 2.5 * settings.period)
        """Time without a record after which the stream is requested again, s."""
        self._requests: deque[bytes] = deque()
        """Requests of the present start that have not been sent yet."""
        self._starts = 0
        """Number of starts since the last record."""
        self._give_up_at = now + settings.ready_s
        """Time until which the sensor may report an error before the first record is used, s."""
        self._stream = self._sample = self._sequence = 0
        """Sequence number of the newest record in its stream, number of its sample, and unwrapped sequence number."""
        self._behind = 0
        """Number of consecutive records older than the newest record."""
        self._clock = ArrivalClock()
        self._stops = 0
        """Number of stops sent."""
        self._has_received = False
        """Whether a record has arrived since the last stop."""
        self._start(now)

    # --- Endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        """Process records."""
        for datagram in data:
            if len(datagram) != RECORD.size:
                self.statistics.malformed += 1
            elif self._stops:
                self._has_received = True
            elif not self._sensor_events.ended:
                self._process_record(datagram, now)

    def handle_deadline(self, now: float) -> None:
        """Send the next request of a start, start again, or report a failure."""
        if self._due is None or now < self._due:
            return
        if self._stops:
            self._stop_again(now)
        elif self._requests:
            self._send_next(now)
        elif self._starts >= self._settings.starts:
            self._fail(
                f"no record received after {self._starts} requests",
                "check its supply, its cable and its address, and whether another program reads it",
            )
        else:
            if self._sensor_events.ready and not self._starts:
                self._sensor_events.notice(f"no record for {self._silence * 1e3:g} ms; requested again")
            self._start(now)

    def stop(self) -> None:
        """Stop the stream. The stop is repeated while records still arrive."""
        if not (self._sensor_events.ended or self._stops):
            self._stops, self._has_received, self._due = 1, False, 0.0
            self._out.append(encode_request(Command.STOP))

    # --- stream

    def _start(self, now: float) -> None:
        self._requests.extend(_start_up(self._settings))
        self._starts += 1
        self._send_next(now)

    def _send_next(self, now: float) -> None:
        self._out.append(self._requests.popleft())
        self._due = now + (PAUSE_S if self._requests else self._silence)

    def _process_record(self, datagram: bytes, now: float) -> None:
        stream, sample, status, *counts = _unpack(datagram)
        arrived, events = arrived_at(datagram, now), self._sensor_events
        if not self._requests:
            self._due = max(self._due or 0.0, arrived + self._silence)  # a straggler has an earlier arrival
        if not events.ready:
            if self._requests or not self._is_usable(status, arrived):
                return  # of an earlier stream, with another rate or a bias; or with an error
            self._stream, self._sample, self._sequence = stream, sample, stream
            events.begin(self._facts())
        elif not self._is_next(stream, sample):
            return
        if self._starts and not self._requests:
            self._clock, self._starts = ArrivalClock(), 0
        saturated = 0
        if status:
            saturated = _ALL_AXES  # unknown which; the values are invalid, so a run retracts
            if not events.knows_status(status):
                events.notice_status(status, f"status {status:08X}: an error of the sensor")
        self._behind = self.statistics.standing = 0
        at = self._clock.sent_at(self._sequence * self._settings.period, arrived)
        events.numbered_sample(counts, stream, self._sequence, at, saturated)

    def _is_usable(self, status: int, now: float) -> bool:
        """Return whether the stream can begin with this status. Fail if the sensor reports an error for too long."""
        if status and now >= self._give_up_at:
            self._fail(f"it reports the status {status:08X}", "check the sensor, and its load")
        return not status

    def _is_next(self, stream: int, sample: int) -> bool:
        """Return whether a record is newer than the newest one so far. Count missing and outdated records.

        The numbers of a stream begin again with each start, the numbers of the samples do not (assumed). A sensor
        whose stream advances while its sample does not hangs.
        """
        step = (stream - self._stream) % WRAP
        if not 0 < step < WRAP // 2:
            if not step or not 0 < (sample - self._sample) % WRAP < WRAP // 2:
                self.statistics.repeated += 1
                self._behind += bool(step)
                if not step or self._behind < _BEHIND_LIMIT:
                    return False
                self._sensor_events.restart()
            step = 1
        elif sample == self._sample:
            self.statistics.repeated += 1
            self.statistics.standing += 1
            self._stream = stream
            return False
        else:
            self.statistics.lost += step - 1
        self._stream, self._sample = stream, sample
        self._sequence += step
        return True

    def _facts(self) -> SensorFacts:
        settings = self._settings
        return SensorFacts(
            "OnRobot HEX", settings.scales, None, None, settings.period, settings.delay, "host"
        )

    # --- end

    def _stop_again(self, now: float) -> None:
        if (self._stops > 1 and not self._has_received) or self._stops >= _STOPS:
            self._due = None
            self._sensor_events.stop()
            return
        if self._has_received:
            self._out.append(encode_request(Command.STOP))
        self._stops, self._has_received = self._stops + 1, False
        self._due = now + _STOP_AGAIN_S

    def _fail(self, text: str, remedy: str) -> None:
        self._due = None
        self._out.append(encode_request(Command.STOP))
        self._sensor_events.fail(text, remedy)


def _start_up(settings: HexClientSettings) -> Iterator[bytes]:
    """Generate the requests of a start, in the order of the public driver."""
    yield encode_request(Command.SET_RATE, settings.every)
    yield encode_request(Command.SET_FILTER, settings.filter)
    if settings.clear_bias:
        yield encode_request(Command.BIAS, BIAS_OFF)
    yield encode_request(Command.START)
