"""Client of an FT 300: stops a stream that may run, asks which sensor it is, then streams or asks on and on.

The sensor numbers nothing and has no zero: the client counts the messages, and the zero is the host's.
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

_ASKED_PERIOD_S = 0.017
"""Derived: a question and its answer on the line, and the turnaround, for the length of a zero."""
_BUFFER_LIMIT = 512
"""Chosen: most bytes kept while an answer is awaited; a stream that does not stop fills it."""
_COPY_PERIODS = 0.5
"""Chosen: part of a period within which a message equal to the one before is a copy, for six values that are noisy do
not stay the same.
"""
_STOPS = 3
"""Chosen: stops that are sent at the end while messages still come."""
_READS = ((VERSION_REGISTER, 3), (SERIAL_REGISTER, 4))
_VERSION, _SERIAL, _START, _WRENCH = range(4)


class _Question:
    """The question under way."""

    def __init__(self) -> None:
        self.step: int | None = None
        """None before the first question and in the stream."""
        self.next = _VERSION
        self.tries = 0
        self.answer = b""
        """What came behind it."""

    def begin(self, step: int) -> bytes:
        """Ask this, or ask it again; the bytes to send."""
        self.tries = self.tries + 1 if step == self.next else 1
        self.step = self.next = step
        self.answer = b""
        if step == _START:
            return encode_write(MODE_REGISTER, STREAM_MODE)
        return encode_read(WRENCH_REGISTER, 6) if step == _WRENCH else encode_read(*_READS[step])

    def find_answer(self) -> tuple[bytes | int, bytes] | None:
        """Payload of the answer, or number of its exception, and the bytes behind it; None while it is not there."""
        if self.step == _START:
            found = find_answer(self.answer, WRITE, 8)
        else:
            assert self.step is not None
            words = 6 if self.step == _WRENCH else _READS[self.step][1]
            found = find_answer(self.answer, READ, 5 + 2 * words)
        if found is None:
            return None
        payload, end = found
        rest, self.answer = self.answer[end:], b""
        return payload, rest


class Ft300Client(Due):
    """Endpoint of bytes: a `SensorClient`."""

    def __init__(self, profile: Ft300ClientProfile, now: float) -> None:
        self.statistics = SensorStatistics()
        self.stop_patience = _STOPS * profile.rest_s + 0.2
        self._profile = profile
        self._rated = (*(profile.rated_n,) * 3, *(profile.rated_nm,) * 3)
        self._ends = [min(rated / scale, COUNT_END) for rated, scale in zip(self._rated, SCALES, strict=True)]
        streams = profile.mode == "stream"
        self._period = PERIOD_S if streams else None
        period = PERIOD_S if streams else _ASKED_PERIOD_S
        self._sensor_events = telling = SensorEventQueue(zero_samples=max(1, round(profile.zero_s / period)))
        self.next_event, self.zero = telling.next_event, telling.zero
        self._out = bytearray(STOP)
        self._due: float | None = now + profile.rest_s
        self._question = _Question()
        self._reader = StreamReader()
        self._streaming = self._heard = False
        self._newest: Sequence[int] = ()
        """Message of the stream that came last, and when it did, s."""
        self._newest_at = 0.0
        self._model = ""
        self._stops = 0

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes."""
        if self._sensor_events.ended:
            return
        if self._stops:
            self._heard = True
        elif self._streaming:
            self._take_stream(data, now)
        elif (question := self._question).step is not None:
            question.answer = (question.answer + data)[-_BUFFER_LIMIT:]
            self._take_answer(question.step, now)
            if question.step == _START and (messages := StreamReader().feed(question.answer)):
                self._begin_stream(now)  # its answer was lost, the stream runs
                self._report_all(messages, now)

    def data_to_send(self, now: float) -> bytes:
        """Bytes that are due."""
        out = bytes(self._out)
        self._out.clear()
        return out

    def handle_deadline(self, now: float) -> None:
        """Ask, ask again, or give up."""
        if self._due is None or now < self._due:
            return
        profile, question = self._profile, self._question
        if self._stops:
            self._stop_again(now)
        elif self._streaming:
            self._fail(f"no message came for {profile.silence_s:g} s", "look at its supply and its cable")
        elif question.step is None:
            self._ask(question.next, now)
        elif question.tries >= profile.tries:
            self._fail(
                f"it does not answer; asked {question.tries} times",
                "look at its supply, its cable and the line: 19200 baud, 8 data bits, no parity",
            )
        else:
            if question.step != _WRENCH:
                self._out += STOP  # it may stream
                question.step, self._due = None, now + profile.rest_s
            else:
                self._ask(_WRENCH, now)

    def stop(self) -> None:
        """End the stream; repeated while messages still come."""
        if self._sensor_events.ended or self._stops:
            return
        if not self._streaming:
            self._finish()
            return
        self._stops, self._heard, self._due = 1, False, 0.0
        self._out += STOP

    # --- questions

    def _ask(self, step: int, now: float) -> None:
        self._out += self._question.begin(step)
        self._due = now + self._profile.answer_timeout_s

    def _take_answer(self, step: int, now: float) -> None:
        found = self._question.find_answer()
        if found is None:
            return
        payload, rest = found
        if isinstance(payload, int):
            self._fail(f"it refuses a question: {EXCEPTIONS.get(payload, 'exception')} ({payload})")
        elif step == _START:
            self._begin_stream(now)
            self._take_stream(rest, now)
        else:
            try:
                self._take_words(step, words_of(payload), now)
            except RemoteProtocolError:
                self.statistics.malformed += 1

    def _take_words(self, step: int, words: Sequence[int], now: float) -> None:
        self._question.tries = 0
        if step == _WRENCH:
            self._tell([signed(word) for word in words], now)
            self._ask(_WRENCH, now)
            return
        raw = b"".join(word.to_bytes(2, "big") for word in words)
        if step == _VERSION:
            if not raw.startswith(b"F"):
                self._fail("what answers is no FT 300: its version does not begin with F")
                return
            letters, numbers = raw[:3].decode("ascii", "replace"), raw[3:6]
            self._model = f"FT 300, firmware {letters}-{'.'.join(map(str, numbers))}"
            self._ask(_SERIAL, now)
            return
        number = words[3] << 16 | words[2]
        self._model += f", number {raw[:3].decode('ascii', 'replace')}-{number}"
        self._ask(_START if self._profile.mode == "stream" else _WRENCH, now)

    # --- samples

    def _begin_stream(self, now: float) -> None:
        self._streaming, self._question.step = True, None
        self._due = now + self._profile.silence_s

    def _take_stream(self, data: bytes, now: float) -> None:
        reader, statistics = self._reader, self.statistics
        noises, missed = reader.noises, reader.missed
        messages = reader.feed(data)
        statistics.malformed += reader.noises - noises
        if self._newest:  # a stream that is joined begins anywhere
            statistics.lost += reader.missed - missed
        self._report_all(messages, now)

    def _report_all(self, messages: Sequence[Sequence[int]], now: float) -> None:
        for counts in messages:
            self._due = now + self._profile.silence_s
            if counts == self._newest and now - self._newest_at < _COPY_PERIODS * PERIOD_S:
                self.statistics.repeated += 1
                continue
            self._newest, self._newest_at = counts, now
            self._tell(counts, now)

    def _tell(self, counts: Sequence[int], now: float) -> None:
        if not self._sensor_events.ready:
            self._sensor_events.begin(self._facts())
        saturated = 0
        for axis, (count, end) in enumerate(zip(counts, self._ends, strict=True)):
            if not -end < count < end:
                saturated |= 1 << axis
        self._sensor_events.sample(counts, now, saturated)

    def _facts(self) -> SensorFacts:
        a, b, c, d, e, f = self._rated
        ends: Wrench = (*(COUNT_END * SCALES[0],) * 3, *(COUNT_END * SCALES[3],) * 3)
        return SensorFacts(self._model, SCALES, (a, b, c, d, e, f), ends, self._period, 0.0, "host")

    # --- end

    def _stop_again(self, now: float) -> None:
        if (self._stops > 1 and not self._heard) or self._stops > _STOPS:
            self._finish()
            return
        if self._heard:
            self._out += STOP
        self._stops, self._heard = self._stops + 1, False
        self._due = now + self._profile.rest_s

    def _finish(self) -> None:
        self._due = None
        self._sensor_events.stop()

    def _fail(self, text: str, remedy: str = "") -> None:
        self._due = None
        self._sensor_events.fail(text, remedy)
