"""Client of a receiver board behind a register server.

The client first runs the kernel driver's start-up, then requests samples. Each sample is one burst from the
filter's first word up to the word `errors`, so that data, counter and errors form one snapshot.
"""

from collections.abc import Sequence
from enum import Enum

from protocol.devices.jr3.board import pack_words
from protocol.devices.jr3.counts import facts_of
from protocol.devices.jr3.registers.procedure import Procedure, RequestWriter
from protocol.devices.jr3.registers.profile import BoardClientProfile
from protocol.devices.jr3.registers.samples import SampleLayout, SampleReader
from protocol.devices.jr3.registers.sampling import Sampling
from protocol.devices.jr3.registers.startup import (
    DEAF,
    BoardIdentity,
    ProgramWord,
    Read,
    Reset,
    Steps,
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
    Response,
    Status,
    response_reader,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFacts, SensorReady, SensorStatistics, Zeroed


class BoardPhase(Enum):
    """Phase of the session."""

    STARTING = "starting"
    SETTLING = "settling"
    READY = "ready"
    STOPPING = "stopping"
    STOPPED = "stopped"
    FAILED = "failed"


_RUNNING = frozenset({BoardPhase.STARTING, BoardPhase.SETTLING, BoardPhase.READY})


class BoardClient:
    """Endpoint of the client over a byte stream. It reports sensor events."""

    def __init__(self, profile: BoardClientProfile, now: float, program: Sequence[ProgramWord] = ()) -> None:
        """Create a client that loads `program` at start-up. If it is empty, the board or its server must already
        have a program.
        """
        self._profile = profile
        self._layout = SampleLayout(profile.filter)
        self.statistics = SensorStatistics()
        self._reader = response_reader()
        self._sensor_events = events = SensorEventQueue("board: ")
        self.next_event = events.next_event
        self._writer = RequestWriter(profile.bursts)
        self._procedure = Procedure(self._writer, profile.answer_timeout_s)
        self._sampling = Sampling(profile, self._layout, self._writer, now)
        self._samples = SampleReader(profile, self._layout.burst, events, self.statistics, now)
        self._phase = BoardPhase.STARTING
        self._zero_wanted = False
        self._settled_at: float | None = None
        self._facts: SensorFacts
        self._zero_from: Sequence[int] | None = None
        """Newest counts at the time when the pending zero was requested."""
        self._begin(start_up(profile, program) if profile.start_up == "driver" else attach(profile), now)

    @property
    def phase(self) -> BoardPhase:
        """Phase of the session."""
        return self._phase

    @property
    def stop_patience(self) -> float:
        """Longest time until SensorStopped, s. TCP retransmits lost data, so only the server's response time counts."""
        return self._profile.answer_timeout_s

    # --- owner's requests

    def zero(self) -> None:
        """Use the present wrench as zero once the session is ready. Raises LocalProtocolError after the end of the
        session.
        """
        if self._phase not in _RUNNING:
            raise LocalProtocolError(f"cannot zero: the session is {self._phase.value}")
        self._zero_wanted = True

    def stop(self) -> None:
        """End the session. SensorStopped confirms that no more data is in transit. Idempotent."""
        if self._phase in (BoardPhase.STOPPING, BoardPhase.STOPPED):
            return
        streaming = self._phase is BoardPhase.READY and not self._sampling.by_poll
        self._end_work()
        self._zero_wanted = False
        if streaming:
            self._phase = BoardPhase.STOPPING
            self._procedure.tag = self._writer.write(Op.STREAM)
        else:
            self._phase = BoardPhase.STOPPED
            self._sensor_events.stop()

    # --- Endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        if self._sampling.head is not None and self._reader.between:
            data = self._take_deliveries(data, self._sampling.head, now)
            if not data:
                return
        for item in self._reader.feed(data):
            if self._phase in (BoardPhase.STOPPED, BoardPhase.FAILED):
                return
            if isinstance(item, Garbage):
                self.statistics.malformed += 1
                self._fail(f"the peer is not a register server: {item.text}")
            elif item.op == Op.CONNECTION:
                self._fail(f"the server closes the connection: {item.status.meaning}")
            elif item.tag == self._procedure.tag:
                self._on_answer(item, now)
            elif item.tag == self._sampling.tag:
                self._on_data(item, now)
            # else: a response that was in transit before a restart or a stop

    def data_to_send(self, now: float) -> bytes:
        """Return the requests to send."""
        procedure = self._procedure
        if self._zero_wanted and self._phase is BoardPhase.READY and not procedure.runs:
            self._zero_wanted = False
            # frames are already relative to the new zero before the board confirms it
            self._zero_from = self._samples.range.newest
            self._run(zero(self._profile), now)
        elif self._phase is BoardPhase.STOPPING and procedure.answer_by is None:
            procedure.wait_for_answer(now)
        return self._writer.take()

    def next_deadline(self) -> float | None:
        """Return the time of the next step, sample or time-out."""
        procedure, sampling = self._procedure, self._sampling
        steps, answer, settled_at = procedure.wake_at, procedure.answer_by, self._settled_at
        poll = sampling.poll_due if sampling.by_poll and self._is_polling else None
        if steps is answer is settled_at is poll is None:
            return sampling.check_at  # the common case for a sample of a stream
        moments = (sampling.check_at, steps, answer, settled_at, poll)
        return min([moment for moment in moments if moment is not None])

    def handle_deadline(self, now: float) -> None:
        """Continue the current steps, request a sample, become ready, or give up."""
        procedure, sampling = self._procedure, self._sampling
        if procedure.answer_by is not None and now >= procedure.answer_by:
            self._fail(f"the server has not answered for {self._profile.answer_timeout_s:g} s")
        if procedure.wake_at is not None and now >= procedure.wake_at:
            self._run(None, now)
        if self._settled_at is not None and now >= self._settled_at:
            self._settled_at = None
            self._on_settled(now)
        if self._is_polling and now >= sampling.poll_due:
            sampling.poll(now)
        if sampling.check_at is not None and now >= sampling.check_at:
            text, remedy = sampling.check(self._samples.sampled_at, self._samples.counter, now)
            if text:
                self._fail(text, remedy)

    # --- sequences of steps

    def _begin(self, steps: Steps[BoardIdentity], now: float) -> None:
        self._phase = BoardPhase.STARTING
        self._end_work()
        self._samples.range.restart()
        self._run(steps, now)

    def _end_work(self) -> None:
        """Cancel the current steps and the sample requests."""
        self._procedure.drop()
        self._sampling.end()
        self._settled_at = None

    def _run(
        self, steps: Steps[BoardIdentity | None] | None, now: float, words: tuple[int, ...] = ()
    ) -> None:
        """Begin `steps`; if None, continue the current steps with `words`, the response to their pending step."""
        try:
            if steps is None:
                self._procedure.advance(words, now)
            else:
                self._procedure.begin(steps, now)
        except StopIteration as end:
            self._procedure.drop()
            self._on_done(end.value, now)
        except RemoteProtocolError as error:
            self._fail(str(error), error.remedy)

    def _on_answer(self, response: Response, now: float) -> None:
        self._procedure.tag = self._procedure.answer_by = None
        if self._phase is BoardPhase.STOPPING:
            self._phase = BoardPhase.STOPPED
            self._sensor_events.stop()
            return
        step = self._procedure.step
        if response.status is Status.REFUSED and isinstance(step, Reset):
            self._sensor_events.notice("board: its server does not reset it; started up without a reset")
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
        self._run(None, now, words)

    def _on_done(self, result: BoardIdentity | None, now: float) -> None:
        if result is not None:
            self._phase = BoardPhase.SETTLING
            model = f"sensor model {result.model_no}, serial number {result.serial_no}"
            self._facts = facts_of(result.full_scales, self._profile.period, self._profile.delay, model)
            self._sensor_events.notice(f"board: {model}")
        self._settled_at = now + self._profile.settling

    def _on_settled(self, now: float) -> None:
        if self._phase is BoardPhase.READY:
            self._samples.range.zeroed(self._zero_from)
            self._sensor_events.tell(Zeroed())
            return
        self._phase = BoardPhase.READY
        self._samples.begin(now)
        self._sensor_events.tell(SensorReady(self._facts))
        self._sampling.begin(now)

    def _fail(self, text: str, remedy: str = "") -> None:
        self._phase = BoardPhase.FAILED
        self._end_work()
        self._writer.take()
        self._sensor_events.fail(text, remedy)

    # --- samples

    @property
    def _is_polling(self) -> bool:
        """Whether the next poll may be sent when it is due."""
        sampling = self._sampling
        return sampling.by_poll and self._phase is BoardPhase.READY and not sampling.waits

    def _on_data(self, response: Response, now: float) -> None:
        """Process a delivery that arrived in several parts, or a response without samples."""
        self._sampling.waits = False
        if response.status is not Status.OK:
            self._fail(f"the server sends no data: {response.status.meaning}")
            return
        if not response.bursts:
            return  # the stream has begun
        if response.count != self._layout.words:
            self.statistics.malformed += 1
            return
        bursts = [BURST.pack_row(burst.time_ns) + pack_words(burst.words) for burst in response.bursts]
        data = b"".join(bursts)
        self._on_bursts(data, 0, len(data), now)

    def _take_deliveries(self, data: bytes, head: bytes, now: float) -> bytes:
        """Process the complete deliveries at the start of the data and return the remaining data.

        Nearly all data consists of complete deliveries, which differ only in their bursts.
        """
        begin, sampling = 0, self._sampling
        while (
            (end := begin + sampling.delivery_size) <= len(data)
            and data.startswith(head, begin)
            and sampling.tag is not None
        ):
            sampling.waits = False
            self._on_bursts(data, begin + RESPONSE.size, end, now)
            begin = end
        return data[begin:]

    def _on_bursts(self, data: bytes, begin: int, end: int, now: float) -> None:
        """Process the bursts from index `begin` to index `end` of the data."""
        self._sampling.received_at = now
        errors = self._samples.read(data, begin, end, now)
        if errors & DEAF:
            self._fail(
                f"it receives no sensor data ({errors_text(errors)})", "check the sensor's plug and cable"
            )
        elif errors:
            self._sensor_events.restart()
            self._begin(configure(self._profile), now)
