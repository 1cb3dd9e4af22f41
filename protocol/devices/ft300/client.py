"""Client of an FT 300: stops a running stream, identifies the sensor, then streams or polls.

The sensor has no sample counter and no zero. The client therefore counts the messages, and the host subtracts the
zero.
"""

from collections.abc import Sequence

from protocol.devices.ft300.messages import (
    COUNT_END,
    EXCEPTIONS,
    MODE_REGISTER,
    PERIOD_S,
    READ,
    SCALES,
    SERIAL_REGISTER,
    STOP,
    STREAM_MODE,
    VERSION_REGISTER,
    WRENCH_REGISTER,
    WRITE,
    StreamReader,
    encode_read,
    encode_write,
    find_answer,
    signed,
    words_of,
)
from protocol.devices.ft300.profile import Ft300ClientProfile
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Wrench
from protocol.outbox import Due
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFacts, SensorStatistics

_POLL_PERIOD_S = 0.017
"""Time between two polled samples, s, for the number of samples in a zero. Derived: transmission times of a request
and its response, and the turnaround.
"""
_BUFFER_LIMIT = 512
"""Maximum number of bytes buffered while a response is awaited. Chosen. A stream that does not stop fills the
buffer.
"""
_COPY_PERIODS = 0.5
"""Time within which a message equal to the previous one is a copy, as a fraction of the period. Chosen: six noisy
values do not repeat.
"""
_STOPS = 3
"""Maximum number of stop commands sent while messages still arrive. Chosen."""
_READS = ((VERSION_REGISTER, 3), (SERIAL_REGISTER, 4))
_VERSION, _SERIAL, _START, _WRENCH = range(4)


class _Request:
    """State of the outstanding request."""

    def __init__(self) -> None:
        self.step: int | None = None
        """Step that is requested; None before the first request and while streaming."""
        self.next = _VERSION
        self.tries = 0
        self.answer = b""
        """Bytes received since the request."""

    def begin(self, step: int) -> bytes:
        """Begin or repeat the request of a step and return the bytes to send."""
        self.tries = self.tries + 1 if step == self.next else 1
        self.step = self.next = step
        self.answer = b""
        if step == _START:
            return encode_write(MODE_REGISTER, STREAM_MODE)
        return encode_read(WRENCH_REGISTER, 6) if step == _WRENCH else encode_read(*_READS[step])

    def find_answer(self) -> tuple[bytes | int, bytes] | None:
        """Return the payload of the response, or its exception code, and the bytes after the response; None if the
        response is incomplete.
        """
        if self.step == _START:
            response = find_answer(self.answer, WRITE, 8)
        else:
            assert self.step is not None
            registers = 6 if self.step == _WRENCH else _READS[self.step][1]
            response = find_answer(self.answer, READ, 5 + 2 * registers)
        if response is None:
            return None
        payload, end = response
        rest, self.answer = self.answer[end:], b""
        return payload, rest


class Ft300Client(Due):
    """`SensorClient` over a byte stream."""

    def __init__(self, profile: Ft300ClientProfile, now: float) -> None:
        self.statistics = SensorStatistics()
        self.stop_patience = _STOPS * profile.rest_s + 0.2
        self._profile = profile
        self._rated = (*(profile.rated_n,) * 3, *(profile.rated_nm,) * 3)
        self._is_stopping = [
            min(rated / scale, COUNT_END) for rated, scale in zip(self._rated, SCALES, strict=True)
        ]
        streams = profile.mode == "stream"
        self._period = PERIOD_S if streams else None
        period = PERIOD_S if streams else _POLL_PERIOD_S
        self._sensor_events = events = SensorEventQueue(zero_samples=max(1, round(profile.zero_s / period)))
        self.next_event, self.zero = events.next_event, events.zero
        self._out = bytearray(STOP)
        self._due: float | None = now + profile.rest_s
        self._pending = _Request()
        self._reader = StreamReader()
        self._streaming = self._has_received = False
        self._newest: Sequence[int] = ()
        """Newest message of the stream; `_newest_at` is its arrival time, s."""
        self._newest_at = 0.0
        self._model = ""
        self._stops = 0

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        if self._sensor_events.ended:
            return
        if self._stops:
            self._has_received = True
        elif self._streaming:
            self._process_stream(data, now)
        elif (question := self._pending).step is not None:
            question.answer = (question.answer + data)[-_BUFFER_LIMIT:]
            self._process_response(question.step, now)
            if question.step == _START and (messages := StreamReader().feed(question.answer)):
                self._begin_stream(now)  # the response was lost, but the stream is running
                self._report_all(messages, now)

    def data_to_send(self, now: float) -> bytes:
        """Return the bytes to send."""
        out = bytes(self._out)
        self._out.clear()
        return out

    def handle_deadline(self, now: float) -> None:
        """Send the request, repeat it, or report a failure."""
        if self._due is None or now < self._due:
            return
        profile, question = self._profile, self._pending
        if self._stops:
            self._stop_again(now)
        elif self._streaming:
            self._fail(f"no message received for {profile.silence_s:g} s", "check its supply and its cable")
        elif question.step is None:
            self._request(question.next, now)
        elif question.tries >= profile.tries:
            self._fail(
                f"no response after {question.tries} requests",
                "check its supply, its cable and the line: 19200 baud, 8 data bits, no parity",
            )
        else:
            if question.step != _WRENCH:
                self._out += STOP  # the sensor may be streaming
                question.step, self._due = None, now + profile.rest_s
            else:
                self._request(_WRENCH, now)

    def stop(self) -> None:
        """End the stream. The stop command is repeated while messages still arrive."""
        if self._sensor_events.ended or self._stops:
            return
        if not self._streaming:
            self._finish()
            return
        self._stops, self._has_received, self._due = 1, False, 0.0
        self._out += STOP

    # --- requests

    def _request(self, step: int, now: float) -> None:
        self._out += self._pending.begin(step)
        self._due = now + self._profile.answer_timeout_s

    def _process_response(self, step: int, now: float) -> None:
        response = self._pending.find_answer()
        if response is None:
            return
        payload, rest = response
        if isinstance(payload, int):
            self._fail(f"it refuses a request: {EXCEPTIONS.get(payload, 'exception')} ({payload})")
        elif step == _START:
            self._begin_stream(now)
            self._process_stream(rest, now)
        else:
            try:
                self._process_registers(step, words_of(payload), now)
            except RemoteProtocolError:
                self.statistics.malformed += 1

    def _process_registers(self, step: int, registers: Sequence[int], now: float) -> None:
        self._pending.tries = 0
        if step == _WRENCH:
            self._report_sample([signed(word) for word in registers], now)
            self._request(_WRENCH, now)
            return
        raw = b"".join(word.to_bytes(2, "big") for word in registers)
        if step == _VERSION:
            if not raw.startswith(b"F"):
                self._fail("the device is not an FT 300: its version does not start with F")
                return
            letters, numbers = raw[:3].decode("ascii", "replace"), raw[3:6]
            self._model = f"FT 300, firmware {letters}-{'.'.join(map(str, numbers))}"
            self._request(_SERIAL, now)
            return
        number = registers[3] << 16 | registers[2]
        self._model += f", number {raw[:3].decode('ascii', 'replace')}-{number}"
        self._request(_START if self._profile.mode == "stream" else _WRENCH, now)

    # --- samples

    def _begin_stream(self, now: float) -> None:
        self._streaming, self._pending.step = True, None
        self._due = now + self._profile.silence_s

    def _process_stream(self, data: bytes, now: float) -> None:
        reader, statistics = self._reader, self.statistics
        noises, missed = reader.noises, reader.missed
        messages = reader.feed(data)
        statistics.malformed += reader.noises - noises
        if self._newest:  # a stream that is already running is joined at an arbitrary byte
            statistics.lost += reader.missed - missed
        self._report_all(messages, now)

    def _report_all(self, messages: Sequence[Sequence[int]], now: float) -> None:
        for counts in messages:
            self._due = now + self._profile.silence_s
            if counts == self._newest and now - self._newest_at < _COPY_PERIODS * PERIOD_S:
                self.statistics.repeated += 1
                continue
            self._newest, self._newest_at = counts, now
            self._report_sample(counts, now)

    def _report_sample(self, counts: Sequence[int], now: float) -> None:
        if not self._sensor_events.ready:
            self._sensor_events.begin(self._facts())
        saturated = 0
        for axis, (count, end) in enumerate(zip(counts, self._is_stopping, strict=True)):
            if not -end < count < end:
                saturated |= 1 << axis
        self._sensor_events.sample(counts, now, saturated)

    def _facts(self) -> SensorFacts:
        a, b, c, d, e, f = self._rated
        ends: Wrench = (*(COUNT_END * SCALES[0],) * 3, *(COUNT_END * SCALES[3],) * 3)
        return SensorFacts(self._model, SCALES, (a, b, c, d, e, f), ends, self._period, 0.0, "host")

    # --- end

    def _stop_again(self, now: float) -> None:
        if (self._stops > 1 and not self._has_received) or self._stops > _STOPS:
            self._finish()
            return
        if self._has_received:
            self._out += STOP
        self._stops, self._has_received = self._stops + 1, False
        self._due = now + self._profile.rest_s

    def _finish(self) -> None:
        self._due = None
        self._sensor_events.stop()

    def _fail(self, text: str, remedy: str = "") -> None:
        self._due = None
        self._sensor_events.fail(text, remedy)
