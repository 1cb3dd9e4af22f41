"""The client's side of a session with a receiver board behind a register server.

First the kernel driver's start-up, then samples. Each is one burst from the filter's first word up to the word
`errors`, so that data, counter and errors are of one moment.
"""

import struct
from collections.abc import Sequence
from enum import Enum

from protocol.devices.jr3.board import REGISTERS, SATURATIONS, Errors, pack_words
from protocol.devices.jr3.counts import facts_of
from protocol.devices.jr3.range import Range
from protocol.devices.jr3.registers.profile import BoardClientProfile, filter_tick
from protocol.devices.jr3.registers.startup import (
    DEAF,
    NEW,
    BoardIdentity,
    Load,
    ProgramWord,
    Read,
    Reset,
    Step,
    Steps,
    Wait,
    Write,
    attach,
    configure,
    errors_text,
    start_up,
    step_name,
    zero,
)
from protocol.devices.jr3.registers.telegrams import (
    BURST,
    RESPONSE,
    Garbage,
    Op,
    Request,
    Response,
    Status,
    encode_head,
    encode_request,
    response_reader,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.sensor_telling import SensorTelling
from protocol.wrench import (
    AXES,
    SensorFacts,
    SensorReady,
    SensorRestarted,
    SensorStatistics,
    WrenchFrame,
    Zeroed,
)

_COUNTER_MODULUS = 65536
_TAG_MODULUS = 65536
_SEEN_S = 0.03
"""Derived: a board reads a calibration for 33 ms, which samples not farther apart than this see."""
_STOOD_S = 0.02
"""Chosen: longer than a command of another client keeps the board busy, shorter than it reads a calibration."""
_QUIET_S = 1.0
"""Chosen: saturation is told again once it has been away for so long."""


class BoardPhase(Enum):
    """Where the session is."""

    STARTING = "starting"
    SETTLING = "settling"
    READY = "ready"
    STOPPING = "stopping"
    STOPPED = "stopped"
    FAILED = "failed"


# plain numbers: an operation on flags costs as much as the rest of a sample
_TROUBLE = int(DEAF | NEW)
_BUSY = int(Errors.SYSTEM_BUSY)
_RUNNING = frozenset({BoardPhase.STARTING, BoardPhase.SETTLING, BoardPhase.READY})


class BoardClient:
    """Endpoint of the client: bytes in, bytes out, tells SensorEvents."""

    def __init__(self, profile: BoardClientProfile, now: float, program: Sequence[ProgramWord] = ()) -> None:
        """`program` is loaded at the start-up; without it the board or its server has one."""
        self._profile = profile
        self._first = REGISTERS[f"filter{profile.filter}"].address
        # filter0 has no counter of its own and the rate of filter1
        counter_at = REGISTERS[f"count{max(profile.filter, 1)}"].address - self._first
        warnings_at = REGISTERS["warnings"].address - self._first
        self._words = REGISTERS["errors"].address - self._first + 1
        # time stamp, axes, counter, warnings and errors of a burst; the words between them are not looked at
        self._sample = struct.Struct(
            f">Q6h{2 * (counter_at - len(AXES))}xH{2 * (warnings_at - counter_at - 1)}x2H"
        )
        self._longest_ns = 1.25e9 * profile.period
        """Between two time stamps when none is missing, with room for a late one, ns."""
        self._tick = filter_tick(profile.filter)
        self._may_miss = profile.period > _SEEN_S
        """Samples are so far apart that the sensor may be exchanged between two."""
        self._counted_ns = 0
        self._by_poll = profile.mode == "poll"
        self._data_timeout = max(profile.data_timeout_s, 5 * profile.period * profile.bursts)
        self.statistics = SensorStatistics()
        self._reader = response_reader()
        self._telling = telling = SensorTelling("board: ")
        self.next_event = telling.next_event
        self._out = b""
        self._tag = 0

        self._phase = BoardPhase.STARTING
        self._steps: Steps[BoardIdentity] | Steps[None] | None = None
        self._step_tag: int | None = None
        self._step: Step | None = None
        self._wake_at: float | None = None
        self._answer_by: float | None = None
        self._zero_wanted = False
        self._settled_at: float | None = None
        self._facts: SensorFacts
        self._range = Range()
        self._zero_from: Sequence[int] | None = None
        """The newest counts when the zero under way was ordered."""

        self._data_tag: int | None = None
        self._delivery_head: bytes | None = None
        """Begin of each delivery of the stream, or of the answer to a poll."""
        at_once = 1 if self._by_poll else profile.bursts
        self._delivery_size = RESPONSE.size + at_once * self._sample.size
        self._asked_at = now
        self._polls = 0
        self._poll_under_way = False
        self._data_by: float | None = None
        self._sampled_at = now
        self._heard_at = now

        self._counter: int | None = None
        self._sequence: int | None = None
        self._stamp_ns: int | None = None
        self._dated = now
        self._saturated = 0
        self._saturated_until = now
        self._begin(start_up(profile, program) if profile.start_up == "driver" else attach(profile), now)

    @property
    def phase(self) -> BoardPhase:
        """Where the session is."""
        return self._phase

    @property
    def stop_patience(self) -> float:
        """How long SensorStopped may take, s: TCP repeats what is lost, so that it is the server's time alone."""
        return self._profile.answer_timeout_s

    # --- requests of the owner

    def zero(self) -> None:
        """Make the present wrench the origin, once settled. Raises LocalProtocolError after the end."""
        if self._phase not in _RUNNING:
            raise LocalProtocolError(f"cannot zero: the session is {self._phase.value}")
        self._zero_wanted = True

    def stop(self) -> None:
        """End the session; SensorStopped tells that no more data are under way. Harmless when called again."""
        if self._phase in (BoardPhase.STOPPING, BoardPhase.STOPPED):
            return
        streaming = self._phase is BoardPhase.READY and not self._by_poll
        self._drop_steps()
        self._settled_at = self._data_by = self._data_tag = self._delivery_head = None
        self._zero_wanted = self._poll_under_way = False
        if streaming:
            self._phase = BoardPhase.STOPPING
            self._step_tag = self._request(Op.STREAM)
        else:
            self._phase = BoardPhase.STOPPED
            self._telling.stop()

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes of responses."""
        if self._delivery_head is not None and self._reader.between:
            data = self._take_deliveries(data, self._delivery_head, now)
            if not data:
                return
        for item in self._reader.feed(data):
            if self._phase in (BoardPhase.STOPPED, BoardPhase.FAILED):
                return
            if isinstance(item, Garbage):
                self.statistics.malformed += 1
                self._fail(f"what answers is no register server: {item.text}")
            elif item.op == Op.CONNECTION:
                self._fail(f"the server closes the connection: {item.status.meaning}")
            elif item.tag == self._step_tag:
                self._on_answer(item, now)
            elif item.tag == self._data_tag:
                self._on_data(item, now)
            # else: an answer that was under way before a restart or a stop

    def data_to_send(self, now: float) -> bytes:
        """The request whose turn it is."""
        if self._zero_wanted and self._phase is BoardPhase.READY and self._steps is None:
            self._zero_wanted = False
            self._zero_from = (
                self._range.newest
            )  # frames count from the zero before the board says that it holds
            self._steps = zero(self._profile)
            self._advance((), now)
        elif self._phase is BoardPhase.STOPPING and self._answer_by is None:
            self._answer_by = now + self._profile.answer_timeout_s
        data, self._out = self._out, b""
        return data

    def next_deadline(self) -> float | None:
        """The next step, sample or end of patience."""
        steps, answer, settled = self._wake_at, self._answer_by, self._settled_at
        poll = self._poll_due() if self._by_poll and self._polling else None
        if steps is answer is settled is poll is None:
            return self._data_by  # as for nearly every sample of a stream
        moments = (self._data_by, steps, answer, settled, poll)
        return min([moment for moment in moments if moment is not None])

    def handle_deadline(self, now: float) -> None:
        """Go on with the sequence, ask for a sample, become ready or give up."""
        if self._answer_by is not None and now >= self._answer_by:
            self._fail(f"the server has not answered for {self._profile.answer_timeout_s:g} s")
        if self._wake_at is not None and now >= self._wake_at:
            self._wake_at = None
            self._advance((), now)
        if self._settled_at is not None and now >= self._settled_at:
            self._settled_at = None
            self._on_settled(now)
        if self._polling and now >= self._poll_due():
            self._poll(now)
        if self._data_by is not None and now >= self._data_by:
            self._check_data(now)

    # --- sequences of steps

    def _begin(self, steps: Steps[BoardIdentity], now: float) -> None:
        self._phase = BoardPhase.STARTING
        self._drop_steps()
        self._settled_at = self._data_by = self._data_tag = self._delivery_head = None
        self._poll_under_way = False
        self._range.restart()
        self._steps = steps
        self._advance((), now)

    def _drop_steps(self) -> None:
        self._steps = self._step = self._step_tag = self._wake_at = self._answer_by = None

    def _advance(self, words: tuple[int, ...], now: float) -> None:
        """Take the sequence's next step, or what it came to."""
        steps = self._steps
        assert steps is not None
        try:
            step = next(steps) if self._step is None else steps.send(words)
        except StopIteration as end:
            self._drop_steps()
            self._on_done(end.value, now)
            return
        except RemoteProtocolError as error:
            self._fail(str(error), error.remedy)
            return
        self._step = step
        match step:
            case Wait(duration):
                self._wake_at = now + duration
                return
            case Read(address, count):
                self._step_tag = self._request(Op.READ, address, count)
            case Write(address, values):
                self._step_tag = self._request(Op.WRITE, address, len(values), words=values)
            case Load(address, words):
                self._step_tag = self._request(Op.PROGRAM, address, len(words), words=words)
            case _:
                self._step_tag = self._request(Op.RESET)
        self._answer_by = now + self._profile.answer_timeout_s

    def _request(
        self,
        op: Op,
        address: int = 0,
        count: int = 0,
        *,
        words: tuple[int, ...] = (),
        period_us: int = 0,
    ) -> int:
        self._tag = (self._tag + 1) % _TAG_MODULUS
        request = Request(op, self._tag, address, count, words, period_us, self._profile.bursts)
        self._out += encode_request(request)
        return self._tag

    def _on_answer(self, response: Response, now: float) -> None:
        self._step_tag = self._answer_by = None
        if self._phase is BoardPhase.STOPPING:
            self._phase = BoardPhase.STOPPED
            self._telling.stop()
            return
        step = self._step
        if response.status is Status.REFUSED and isinstance(step, Reset):
            self._telling.notice("board: its server does not reset it; started up without a reset")
        elif response.status is not Status.OK:
            self._fail(f"the server refuses {step_name(step)}: {response.status.meaning}")
            return
        words: tuple[int, ...] = ()
        if isinstance(step, Read):
            if not (len(response.bursts) == 1 and response.count == step.count):
                self.statistics.malformed += 1
                self._fail(
                    f"{step_name(step)} is answered with {len(response.bursts)} bursts of {response.count} words"
                )
                return
            words = response.bursts[0].words
        self._advance(words, now)

    def _on_done(self, result: BoardIdentity | None, now: float) -> None:
        if result is not None:
            self._phase = BoardPhase.SETTLING
            model = f"sensor model {result.model_no}, serial number {result.serial_no}"
            self._facts = facts_of(result.full_scales, self._profile.period, self._profile.delay, model)
            self._telling.notice(f"board: {model}")
        self._settled_at = now + self._profile.settling

    def _on_settled(self, now: float) -> None:
        if self._phase is BoardPhase.READY:
            self._range.zeroed(self._zero_from)
            self._telling.tell(Zeroed())
            return
        self._phase = BoardPhase.READY
        self._counter = self._stamp_ns = None
        self._asked_at = self._sampled_at = self._heard_at = now
        self._polls = 0
        self._data_by = now + self._data_timeout
        self._telling.tell(SensorReady(self._facts))
        if not self._by_poll:
            period_us = round(self._profile.period * 1e6)
            self._ask(Op.STREAM, period_us, self._profile.bursts)

    def _ask(self, op: Op, period_us: int, bursts: int) -> None:
        """Ask for samples, so many at once."""
        tag = self._request(op, self._first, self._words, period_us=period_us)
        self._data_tag = tag
        self._delivery_head = encode_head(Response(op, Status.OK, tag, self._first, self._words), bursts)

    def _fail(self, text: str, remedy: str = "") -> None:
        self._phase = BoardPhase.FAILED
        self._drop_steps()
        self._settled_at = self._data_by = self._data_tag = self._delivery_head = None
        self._out = b""
        self._telling.fail(text, remedy)

    # --- samples

    @property
    def _polling(self) -> bool:
        return self._by_poll and self._phase is BoardPhase.READY and not self._poll_under_way

    def _poll_due(self) -> float:
        return self._asked_at + self._polls * self._profile.period

    def _poll(self, now: float) -> None:
        self._poll_under_way = True
        self._polls = max(self._polls, int((now - self._asked_at) / self._profile.period)) + 1
        self._ask(Op.READ, 0, 1)

    def _check_data(self, now: float) -> None:
        """Looked at seldom, so that a sample costs no timer."""
        if now < self._sampled_at + self._data_timeout:
            self._data_by = self._sampled_at + self._data_timeout
        elif now < self._heard_at + self._data_timeout:
            self._fail(
                f"its counter has stood at {self._counter} for {self._data_timeout:g} s",
                "does its program run?",
            )
        else:
            self._fail(f"no data for {self._data_timeout:g} s", "server or network stuck?")

    def _on_data(self, response: Response, now: float) -> None:
        """Take a delivery that came in parts, or a response without samples."""
        self._poll_under_way = False
        if response.status is not Status.OK:
            self._fail(f"the server gives no data: {response.status.meaning}")
            return
        if not response.bursts:
            return  # the stream has begun
        if response.count != self._words:
            self.statistics.malformed += 1
            return
        bursts = [BURST.pack_row(burst.time_ns) + pack_words(burst.words) for burst in response.bursts]
        data = b"".join(bursts)
        self._on_bursts(data, 0, len(data), now)

    def _take_deliveries(self, data: bytes, head: bytes, now: float) -> bytes:
        """Take the samples at the beginning of the data; what is left of it.

        Nearly all that ever comes are whole deliveries, which differ in their bursts alone.
        """
        begin = 0
        while (
            (end := begin + self._delivery_size) <= len(data)
            and data.startswith(head, begin)
            and self._data_tag is not None
        ):
            self._poll_under_way = False
            self._on_bursts(data, begin + RESPONSE.size, end, now)
            begin = end
        return data[begin:]

    def _on_bursts(self, data: bytes, begin: int, end: int, now: float) -> None:
        """The bursts between these places of the data."""
        self._heard_at = now
        unpack, size = self._sample.unpack_from, self._sample.size
        # one alone is the newest, whatever its time
        newest = int.from_bytes(data[end - size : end - size + BURST.size]) if end - begin > size else 0
        for place in range(begin, end, size):
            time_ns, fx, fy, fz, mx, my, mz, counter, warnings, errors = unpack(data, place)
            # Clocks of two machines cannot be compared: the newest burst is taken to be of the moment of its arrival.
            at = now if time_ns >= newest else now - (newest - time_ns) * 1e-9
            if at > self._dated:
                self._dated = at
            if self._stamp_ns is not None and time_ns - self._stamp_ns > self._longest_ns:
                periods = (time_ns - self._stamp_ns) * 1e-9 / self._profile.period
                self.statistics.lost += max(0, round(periods) - 1)
            self._stamp_ns = time_ns
            if (errors or warnings or self._saturated) and not self._usable(errors, warnings, now):
                if self._phase is not BoardPhase.READY:
                    return
                continue
            sequence = self._sequence
            if sequence is None:
                sequence = counter
            elif self._counter is None:
                sequence += 1
            elif counter == self._counter:
                self.statistics.repeated += 1
                continue
            else:
                step = (counter - self._counter) % _COUNTER_MODULUS
                if self._may_miss and self._stood((time_ns - self._counted_ns) * 1e-9, step):
                    self._begin_again(now)
                    return
                sequence += step
            self._sequence, self._counter, self._sampled_at = sequence, counter, now
            self._counted_ns = time_ns
            counts = fx, fy, fz, mx, my, mz
            saturated = self._range.saturated(counts)
            for warning in self._range.warnings:
                self._telling.notice(warning)
            self._telling.tell(WrenchFrame(counts, counter, sequence, self._dated, saturated))

    def _usable(self, errors: int, warnings: int, now: float) -> bool:
        """Whether the data of a burst with these bits are of its moment; tell what is to be told of the bits."""
        if errors & _TROUBLE:
            self._on_sensor_trouble(errors, now)
            return False
        if (errors | warnings) & SATURATIONS or self._saturated:
            self._on_saturation(errors & SATURATIONS, warnings & SATURATIONS, now)
        return not errors & _BUSY

    def _on_sensor_trouble(self, errors: int, now: float) -> None:
        if errors & DEAF:
            self._fail(f"it hears no sensor ({errors_text(errors)})", "check the sensor's plug and cable")
            return
        self._begin_again(now)

    def _begin_again(self, now: float) -> None:
        self._telling.tell(SensorRestarted())
        self._begin(configure(self._profile), now)

    def _stood(self, elapsed: float, step: int) -> bool:
        """Whether the counter, which went on by `step` in this time, s, stood still in between."""
        wrap = _COUNTER_MODULUS * self._tick
        missing = (elapsed - step * self._tick) % wrap
        return _STOOD_S + self._tick < missing < wrap / 2

    def _on_saturation(self, errors: int, warnings: int, now: float) -> None:
        """Tell each axis once, and again only after a quiet time: a contact at the limit rattles."""
        present = errors << len(AXES) | warnings
        if present:
            self._saturated_until = now + _QUIET_S
        elif now >= self._saturated_until:
            self._saturated = 0
        if new := present & ~self._saturated:
            self._saturated |= new
            texts = [f"{axis} saturated" for i, axis in enumerate(AXES) if new >> (len(AXES) + i) & 1]
            texts += [f"{axis} near saturation" for i, axis in enumerate(AXES) if new >> i & 1]
            self._telling.notice(f"board: raw {', '.join(texts)}")
