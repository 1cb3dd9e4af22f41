"""Client of the robot: it makes the box ready for servo mode, and answers each real report once with a servo pose.

It sends poses, not joints: the box itself converts them, with the dimensions of this very arm, calibrated, and for each
arm of the family; and the reported pose is in the same frame, with the same tool centre point. The motions of a run are
small, so that the joints stay far from a singularity; the box stops with an error otherwise.

The box runs to each pose at full speed, without a buffer. The client therefore limits the way between two poses itself,
also after a pause: after a command that took long, it goes on from the last pose that it has sent, never in one leap.
It never sends faster than the box takes commands, and nothing while a reply is missing.
"""

import math
from collections.abc import Sequence
from typing import Any

from hil_bridge.devices.robots.ramp import Pace, Ramp
from hil_xarm.arms import from_box, to_box
from hil_xarm.dialogue import Ask, Dialogue, Failed, Piece, Script, Wait, ask_version, error_trouble, prepare
from hil_xarm.frames import Bit, FrameReader, Function, Mode, Reply, State, pack_floats
from hil_xarm.reports import LAYOUTS, Port, ReportReader
from hil_xarm.settings import XarmSettings
from protocol.arrival_clock import ArrivalClock
from protocol.endpoint import NO_TROUBLE, RemoteProtocolError, Trouble
from protocol.geometry import Pose
from protocol.outbox import Mailbox
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice

AGAIN_S = 0.4
"""Time between two reports of a failed start, for a caller that begins to wait later, s. Chosen."""
NOTICES_MAX = 32
"""Largest number of different notices. Chosen."""
_AGAIN = "then start the run again"
_STATES = {
    State.PAUSED: Trouble("it is paused", f"let it move again, {_AGAIN}"),
    State.STOPPED: Trouble("it is stopped", f"correct the cause, {_AGAIN}"),
    State.MODE_CHANGED: Trouble("its mode was changed", f"end the other program, {_AGAIN}"),
    State.SLOW_STOP: Trouble("it is stopped", f"correct the cause, {_AGAIN}"),
}
_STOPPED = (State.STOPPED, State.MODE_CHANGED, State.SLOW_STOP)


class XarmClient(Mailbox[Piece, StreamEvent]):
    """`protocol.robot.StreamClient` over the command channel and the real reports."""

    def __init__(self, settings: XarmSettings, now: float, read_only: bool = False) -> None:
        """Begin the session. With `read_only`, only the version and the error are asked for."""
        super().__init__()
        self._settings, self._read_only = settings, read_only
        self._dialogue = Dialogue(settings.answer_s, settings.keep_alive_s)
        self._frames, self._reports = FrameReader(), ReportReader()
        self.facts: dict[str, Any] = {}
        """What the box has reported about itself."""
        self._script: Script | None = self._run()
        self._resume_at = self._ready_by = math.inf
        self._lost = NO_TROUBLE
        self._error = 0
        """Newest error that the box has reported."""
        self._asks_error = self._was_stopped = False
        """Whether the error is to be asked for, and whether the newest report shows a stop."""
        self._is_ready = False
        """Whether reports are passed on."""
        self._clock, self._count = ArrivalClock(), 0
        self._ramp = Ramp(settings.cycle_s)
        self._pace = Pace(
            settings.speed_mm_s / 1e3,
            math.radians(settings.turn_deg_s),
            settings.acceleration_mm_s2 / 1e3,
            math.radians(settings.turn_acceleration_deg_s2),
        )
        self._sent: Pose | None = None
        """Pose that was sent last in this movement, or at which it began."""
        self._target: Pose | None = None
        """Target that is to be answered with; None if nothing is due."""
        self._sent_at = -math.inf
        self._noticed: set[str] = set()
        self._advance(None, now)

    # --- Endpoint

    def receive(self, data: Sequence[Piece], now: float) -> None:
        for port, contents in data:
            try:
                if port is Port.COMMAND:
                    for frame in self._frames.feed(contents):
                        self._process_reply(frame.as_reply(), now)
                elif port is Port.REAL:
                    for report in self._reports.feed(contents):
                        self._process_report(report, now)
            except RemoteProtocolError as error:
                self._notice("data", f"data are ignored: {error}")

    def data_to_send(self, now: float) -> Sequence[Piece]:
        if self._dialogue.is_free and not self._lost:
            self._send_next(now)
        return super().data_to_send(now)

    def next_deadline(self) -> float | None:
        at = min(self._resume_at, self._ready_by, self._dialogue.due)
        return None if at == math.inf else at

    def handle_deadline(self, now: float) -> None:
        if self._lost:
            if now >= self._resume_at:
                self._fail(self._lost, now)
        elif (late := self._dialogue.late(now)) is not None:
            self._fail(late, now)
        elif now >= self._resume_at:
            self._resume_at = math.inf
            self._advance(None, now)
        elif now >= self._ready_by:
            self._fail(Trouble("it does not report servo mode", "check its mode and its state"), now)
        elif self._dialogue.is_free and now >= self._dialogue.due:
            self._out.append(self._dialogue.ask(Function.STATE, b"", now))

    # --- StreamClient

    def begin(self, pose: Pose) -> None:
        self._sent, self._target = pose, None
        self._ramp.rest()

    def target(self, pose: Pose, now: float) -> None:
        self._target = pose

    def hold(self, now: float) -> None:
        """Send nothing: the arm stands at the last pose."""

    def end(self) -> None:
        self._sent = self._target = None

    def farewell(self) -> Sequence[Piece]:
        """Return the command that stops the arm at the end of the session, so that nothing moves it until an operator
        or a program sets its state.
        """
        if self._read_only or not self._is_ready or self._lost:
            return ()
        return (self._dialogue.ask(Function.SET_STATE, bytes((State.STOPPED,)), 0.0),)

    # --- session

    def _run(self) -> Script:
        yield from ask_version(self.facts)
        if not self._read_only:
            yield from prepare(self._settings.clears_error)
        else:
            yield Ask(Function.ERROR)

    def _advance(self, reply: Reply | None, now: float) -> None:
        """Continue the script of the start with a reply."""
        assert self._script is not None, "the session is being prepared"
        try:
            step = self._script.send(reply)
        except StopIteration:
            self._script = None
            self._is_ready = self._read_only
            self._ready_by = math.inf if self._read_only else now + self._settings.ready_s
        except Failed as failed:
            self._fail(failed.trouble, now)
        else:
            if isinstance(step, Wait):
                self._resume_at = now + step.seconds
            else:
                self._out.append(self._dialogue.ask(step.function, step.data, now))

    def _process_reply(self, reply: Reply, now: float) -> None:
        if self._lost or not self._dialogue.is_reply(reply, now):
            return
        if reply.function == Function.ERROR and reply.data:
            self._error = reply.data[0]
        if self._script is not None:
            self._advance(reply, now)
        elif reply.state & Bit.ERROR and not self._error:
            self._asks_error = True
        if reply.state & Bit.INVALID:
            self._notice("command", f"it does not know the command {reply.function}")

    def _send_next(self, now: float) -> None:
        """Send a question about the error, or the servo pose that is due."""
        if self._asks_error:
            self._asks_error = False
            self._out.append(self._dialogue.ask(Function.ERROR, b"", now))
            return
        target, sent = self._target, self._sent
        too_early = now - self._sent_at < self._settings.shortest_ms / 1e3 - 1e-9
        if target is None or sent is None or self._script is not None or too_early:
            return
        cycle = self._settings.cycle_s
        self._sent = self._ramp.step(sent, target, self._pace, min(now - self._sent_at, cycle))
        self._sent_at, self._target = now, None
        data = pack_floats(*to_box(self._sent), 0.0, 0.0, 0.0)
        self._out.append(self._dialogue.ask(Function.SERVO_POSE, data, now))

    def _fail(self, trouble: Trouble, now: float) -> None:
        """End the session. The reason is reported repeatedly."""
        self._lost, self._script, self._sent = trouble, None, None
        self._dialogue.end()
        self._resume_at, self._ready_by = now + AGAIN_S, math.inf
        self._events.append(StreamLost(*trouble))

    # --- reports

    def _process_report(self, data: bytes, now: float) -> None:
        layout = LAYOUTS.get(len(data))
        if layout is None:
            raise RemoteProtocolError(f"a real report of {len(data)} bytes")
        values = layout.decode(data)
        self._count += 1
        state_mode = int(values["state_mode"][0])
        state, mode = state_mode & 0x0F, state_mode >> 4
        is_stopped = state in _STOPPED
        if not is_stopped:
            self._error = 0
        elif self._is_ready and not self._was_stopped:
            self._asks_error = True
        self._was_stopped = is_stopped
        if not self._is_ready and self._script is None and mode == Mode.SERVO and not is_stopped:
            self._is_ready, self._ready_by = True, math.inf
        if not self._is_ready or self._lost:
            return
        trouble = self._trouble(state, mode)
        x, y, z, *angles = values["pose"]
        pose = from_box((x, y, z, *angles))
        if not all(map(math.isfinite, (*pose.position, *pose.quaternion))):
            pose = Pose((math.nan,) * 3, (1.0, 0.0, 0.0, 0.0))
        sent_at = self._clock.sent_at(self._count * self._settings.cycle_s, now)
        report = RobotReport(self._count, pose, sent_at, now, trouble.fact, remedy=trouble.remedy)
        self._events.append(ReportReceived(report))

    def _trouble(self, state: int, mode: int) -> Trouble:
        """Return why the arm does not follow; empty if it does. An error takes one more reply to be known."""
        if self._error or self._read_only:
            return error_trouble(self._error) if self._error else NO_TROUBLE
        if trouble := _STATES.get(State(state) if state in tuple(State) else State.MOVE):
            return trouble
        if mode != Mode.SERVO:
            return _STATES[State.MODE_CHANGED]
        return NO_TROUBLE

    def _notice(self, kind: str, text: str) -> None:
        """Report each text once."""
        if text not in self._noticed and len(self._noticed) < NOTICES_MAX:
            self._noticed.add(text)
            self._events.append(StreamNotice(kind, text))
