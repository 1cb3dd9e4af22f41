"""Client of the force sensor: it switches the sensor on, and reads its values from the real reports.

It asks regularly for the error of the box. It sets neither the zero nor the load of the box; the host subtracts the
zero. It does not switch the sensor off, because other programs may use it.
"""

import math
from collections.abc import Sequence
from typing import Any

from hil_xarm.codes import Error, error_text
from hil_xarm.dialogue import Ask, Dialogue, Failed, Piece, Script, Wait, ask_error, ask_version
from hil_xarm.frames import Bit, FrameReader, Function, Reply
from hil_xarm.reports import PLAIN, REAL, Port, ReportReader
from hil_xarm.settings import ForceSettings
from protocol.arrival_clock import ArrivalClock
from protocol.endpoint import RemoteProtocolError
from protocol.outbox import Outbox
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFacts, SensorStatistics

_FAILURES = (Error.SENSOR_LOST, Error.SENSOR_READ, Error.SENSOR_MODE, Error.SENSOR_ZERO)
"""Errors after which the values do not count. After an overload, they do: the run retracts."""
_OFF_AFTER = 3
"""Number of consecutive reports with only zeros after which the sensor counts as off. Chosen: noise is never zero on
all axes for so long.
"""
_CHECK = "check its cable and its type in UFACTORY Studio"


class ForceClient(Outbox[Piece]):
    """`SensorClient` over the command channel and the real reports."""

    def __init__(self, settings: ForceSettings, now: float) -> None:
        super().__init__()
        self.statistics = SensorStatistics()
        self.stop_patience = 0.1
        self._settings = settings
        self._sensor_events = events = SensorEventQueue(
            zero_samples=max(1, round(settings.zero_s / settings.cycle_s))
        )
        self.next_event, self.zero = events.next_event, events.zero
        self._dialogue = Dialogue(settings.answer_s, math.inf)
        self._frames, self._reports = FrameReader(), ReportReader()
        self.facts: dict[str, Any] = {}
        self._script: Script | None = self._run()
        self._resume_at = math.inf
        self._streams = False
        """Whether the sensor is on and its values have settled."""
        self._clock = ArrivalClock()
        self._count = self._zeros = 0
        """Numbers of reports, and of consecutive reports with only zeros."""
        self._advance(None, now)

    # --- Endpoint

    def receive(self, data: Sequence[Piece], now: float) -> None:
        """Process replies and reports."""
        for port, contents in data:
            try:
                if port is Port.COMMAND:
                    for frame in self._frames.feed(contents):
                        self._process_reply(frame.as_reply(), now)
                elif port is Port.REAL:
                    cut = self._reports.cut
                    for report in self._reports.feed(contents):
                        self._process_report(report, now)
                    self.statistics.malformed += self._reports.cut - cut
            except RemoteProtocolError:
                self.statistics.malformed += 1

    def next_deadline(self) -> float | None:
        """Return the time of the next step, s."""
        at = min(self._resume_at, self._dialogue.due)
        return None if at == math.inf or self._sensor_events.ended else at

    def handle_deadline(self, now: float) -> None:
        """Go on with the session, or fail."""
        if self._sensor_events.ended:
            return
        if (late := self._dialogue.late(now)) is not None:
            self._fail(late.fact, late.remedy)
        elif now >= self._resume_at:
            self._resume_at = math.inf
            self._advance(None, now)

    def stop(self) -> None:
        """End the session. The sensor stays on."""
        if not self._sensor_events.ended:
            self._dialogue.end()
            self._sensor_events.stop()

    # --- session

    def _run(self) -> Script:
        yield from ask_version(self.facts)
        yield Ask(Function.FORCE_ENABLE, b"\1")
        yield Wait(self._settings.settle_s)
        self._streams = True
        while True:
            error = yield from ask_error()
            if error in _FAILURES:
                self._fail(f"the box reports {error_text(error)}", _CHECK)
                return
            if error and not self._sensor_events.knows_status(error):
                self._sensor_events.notice_status(error, f"the box reports {error_text(error)}")
            yield Wait(self._settings.ask_s)

    def _advance(self, reply: Reply | None, now: float) -> None:
        """Continue the script with a reply."""
        assert self._script is not None, "the session runs"
        try:
            step = self._script.send(reply)
        except StopIteration:
            self._script = None
        except Failed as failed:
            self._fail(*failed.trouble)
        else:
            if isinstance(step, Wait):
                self._resume_at = now + step.seconds
            else:
                self._out.append(self._dialogue.ask(step.function, step.data, now))

    def _process_reply(self, reply: Reply, now: float) -> None:
        if self._sensor_events.ended or not self._dialogue.is_reply(reply, now):
            return
        if reply.function == Function.FORCE_ENABLE and reply.state & Bit.INVALID:
            self._fail("it has no force sensor", "a firmware from 1.8.3 on is needed")
            return
        self._advance(reply, now)

    def _fail(self, text: str, remedy: str) -> None:
        self._dialogue.end()
        self._resume_at = math.inf
        self._sensor_events.fail(text, remedy)

    # --- reports

    def _process_report(self, data: bytes, now: float) -> None:
        self._count += 1
        events = self._sensor_events
        if events.ended or not self._streams:
            return
        if len(data) == PLAIN.size:
            self._fail("its real reports contain no force", "use a firmware that reports it on port 30003")
            return
        values = REAL.decode(data)
        raw, wrench = values["raw"], values["external" if self._settings.external else "raw"]
        if not all(map(math.isfinite, (*raw, *wrench))):
            self.statistics.malformed += 1
            return
        self._zeros = 0 if any(raw) else self._zeros + 1
        if self._zeros >= _OFF_AFTER:
            self._fail("the force sensor is off, or its box does not reach it", _CHECK)
        elif not self._zeros:
            if not events.ready:
                events.begin(self._facts())
            ranges = self._settings.ranges
            limits = zip(raw, ranges, strict=True)
            saturated = sum(1 << axis for axis, (value, most) in enumerate(limits) if abs(value) >= most)
            at = self._clock.sent_at(self._count * self._settings.cycle_s, now)
            events.numbered_sample(wrench, self._count, self._count, at, saturated)

    def _facts(self) -> SensorFacts:
        settings = self._settings
        return SensorFacts(
            model=f"force sensor of an xArm, firmware {self.facts['firmware']}",
            scales=(1.0,) * 6,
            full_scales=settings.ranges,
            range=settings.ranges,
            period=settings.cycle_s,
            delay=0.0,
            tares="host",
        )
