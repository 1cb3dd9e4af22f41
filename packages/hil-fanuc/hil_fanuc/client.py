"""Client of Stream Motion: it begins the stream, and answers each report once with the next set point in joints.

Set points are poses of the tool centre point. The client converts them to joints with the kinematics of the model, and
moves the joints within the controller's limits of speed, acceleration and jerk (`path_limiter`): a controller
before V9.40P/77 stops at any other set point. A command carries the number of the report that it answers. If several
reports arrive together, only the newest is answered, because a surplus command would delay all later ones.

The tool is learnt from the first report: it contains the joints and the pose of the point that a run guides. Each
further report must fit this tool and the model.

While the controller is not ready, commands repeat the reported joints and do not move, as those of the maker's client.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from emulators.arm.chain import straight_tool, tool_on
from hil_fanuc import rmi
from hil_fanuc.arms import MODELS, FanucArm, Joints, from_pendant, to_pendant
from hil_fanuc.channels import Channel, Ended, OpenSession, Piece, Pieces
from hil_fanuc.limits import AxisLimits, LimitTable
from hil_fanuc.model_check import FIT_M, FIT_RAD
from hil_fanuc.numbering import Numbering
from hil_fanuc.packets import (
    JOINTS,
    Command,
    Kind,
    Nine,
    Report,
    Signal,
    Status,
    decode_to_client,
    encode_to_robot,
    is_finite,
)
from hil_fanuc.path_limiter import PathLimiter
from hil_fanuc.requests import Answer, Failed, Request, Script
from hil_fanuc.rmi import LineReader
from hil_fanuc.settings import FanucSettings
from hil_fanuc.startup import Startup
from hil_fanuc.trouble import find_trouble
from protocol.arrival_clock import ArrivalClock
from protocol.datagram import arrived_at
from protocol.endpoint import NO_TROUBLE, RemoteProtocolError, Trouble
from protocol.geometry import Pose, Vector, angle_between, from_angles, rotate
from protocol.outbox import Mailbox
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice

REPEAT_S = 0.25
"""Time after which a request over datagrams is sent again, s. Chosen."""
AGAIN_S = 0.4
"""Time between two reports of a failed start, for a caller that begins to wait later, s. Chosen."""
NOTICES_MAX = 64
"""Largest number of different notices. Chosen."""
TOOL_MAX_M = 1.0
"""Longest tool, m. Chosen."""


@dataclass(slots=True)
class _Stream:
    """Running stream."""

    limits: LimitTable
    limiter: PathLimiter | None
    """Set points; None until the tool is known."""
    external: Nine
    ready: bool = True
    stopped: bool = False
    """Whether the controller was not ready at some time in this movement. It then does not move until the next one."""


class FanucClient(Mailbox[Piece | OpenSession, StreamEvent]):
    """`protocol.robot.StreamClient` over the channels of a controller."""

    def __init__(self, settings: FanucSettings, now: float) -> None:
        super().__init__()
        self._settings = settings
        self._startup = Startup(settings)
        self._script: Script | None = self._startup.run()
        self._request: Request | None = None
        self._late_at = self._repeat_at = math.inf
        self._lost = NO_TROUBLE
        self._lines = {Channel.DOOR: LineReader(), Channel.SESSION: LineReader()}
        self._numbers, self._clock = Numbering(settings.cycle_s), ArrivalClock()
        self._stream: _Stream | None = None
        self._arm: FanucArm | None = None
        """Arm with the tool of the reports, once it is known."""
        self._newest: Report | None = None
        self._unanswered = self._due = False
        """Whether the newest report has no answer yet, and whether an answer is to be sent."""
        self._moving = self._is_leaving = self._has_left = False
        """Whether a movement is under way, the client leaves, and its last command was sent."""
        self._is_at_rest = True
        self._alarm = ""
        self._noticed: set[str] = set()
        self._advance(None, now)

    # --- Endpoint

    def receive(self, data: Pieces, now: float) -> None:
        for piece in data:
            if isinstance(piece, Ended):
                self._handle_end(piece, now)
            elif isinstance(piece, Piece):
                try:
                    self._process(piece, now)
                except RemoteProtocolError as error:
                    self._notice("data", f"data are ignored: {error}")

    def data_to_send(self, now: float) -> Sequence[Piece | OpenSession]:
        if self._due:
            self._due = False
            self._out.append(Piece(Channel.STREAM, encode_to_robot(self._command())))
        return super().data_to_send(now)

    def next_deadline(self) -> float | None:
        at = min(self._late_at, self._repeat_at)
        return None if at == math.inf else at

    def handle_deadline(self, now: float) -> None:
        if self._lost:
            if now >= self._late_at:
                self._fail(self._lost, now)
            return
        request = self._request
        if request is None:
            return
        if now >= self._late_at:
            if request.accepts is None:
                self._advance(None, now)
            else:
                self._fail(self._with_alarm(request.late), now)
        elif now >= self._repeat_at:
            self._out += request.pieces
            self._repeat_at = now + REPEAT_S

    # --- StreamClient

    def begin(self, pose: Pose) -> None:
        self._moving = True
        if (stream := self._stream) is not None:
            stream.stopped = not stream.ready

    def target(self, pose: Pose, now: float) -> None:
        stream = self._stream
        if stream is not None and stream.limiter is not None and stream.ready and not stream.stopped:
            stream.limiter.aim(pose)
        self._answer()

    def hold(self, now: float) -> None:
        self._answer()

    def end(self) -> None:
        self._moving = False

    # --- farewell

    def leave(self) -> Pieces:
        """End the movement: the next command is the last one. `farewell` follows once the arm is at rest."""
        self._is_leaving = True
        self._is_at_rest = bool(self._lost) or self._newest is None or not self._startup.controller.streams
        self._answer()
        return self.data_to_send(0.0)

    @property
    def is_at_rest(self) -> bool:
        """Whether a report after the last command says that the arm does not move."""
        return self._is_at_rest

    def farewell(self) -> Pieces:
        """Return the data that end the session."""
        if self._startup.controller.streams:
            stop = Signal(Kind.STOP, self._startup.controller.version)
            self._out += [
                Piece(Channel.SESSION, rmi.encode({"Command": "FRC_Abort"})),
                Piece(Channel.STREAM, encode_to_robot(stop)),
            ]
        self._out.append(Piece(Channel.SESSION, rmi.encode({"Communication": "FRC_Disconnect"})))
        return super().data_to_send(0.0)

    # --- start

    def _advance(self, answer: Answer, now: float) -> None:
        """Continue the script of the start with an answer."""
        assert self._script is not None
        try:
            request = self._script.send(answer)
        except StopIteration:
            self._script = self._request = None
            self._late_at = self._repeat_at = math.inf
            return
        except Failed as failed:
            self._fail(self._with_alarm(failed.trouble), now)
            return
        self._request = request
        self._out += request.pieces
        self._late_at = now + request.patience_s
        self._repeat_at = now + REPEAT_S if request.repeats else math.inf

    def _take(self, answer: Answer, now: float) -> None:
        request = self._request
        if request is not None and request.accepts is not None and request.accepts(answer):
            self._advance(answer, now)

    def _fail(self, trouble: Trouble, now: float) -> None:
        """End the session. The reason is reported repeatedly."""
        self._lost, self._request, self._stream = trouble, None, None
        self._late_at, self._repeat_at = now + AGAIN_S, math.inf
        self._events.append(StreamLost(*trouble))

    def _with_alarm(self, trouble: Trouble) -> Trouble:
        return trouble._replace(fact=f"{trouble.fact}; alarm {self._alarm}") if self._alarm else trouble

    # --- data of the controller

    def _process(self, piece: Piece, now: float) -> None:
        if piece.channel is Channel.STREAM:
            packet = decode_to_client(piece.data)
            if isinstance(packet, Report):
                self._process_report(packet, arrived_at(piece.data, now), now)
            else:
                self._take(packet, now)
            return
        for message in self._lines[piece.channel].feed(piece.data):
            self._process_line(message, now)

    def _process_line(self, message: rmi.Message, now: float) -> None:
        name = rmi.name_of(message).name
        if name == "FRC_ReadError":
            text = message.get("ErrorData")
            if isinstance(text, str) and text and text != "No Error":
                self._alarm = text
                self._notice("alarm", text)
        elif name in ("FRC_SystemFault", "FRC_Terminate"):
            self._notice("controller", f"it sends {name}")
            self._ask_alarm()
        self._take(message, now)

    def _ask_alarm(self) -> None:
        self._out.append(Piece(Channel.SESSION, rmi.encode({"Command": "FRC_ReadError", "Count": 1})))

    def _handle_end(self, ended: Ended, now: float) -> None:
        if self._lost or (ended.channel is Channel.DOOR and self._startup.controller.has_port):
            return
        self._fail(
            Trouble(
                f"the connection to its Remote Motion Interface has ended: {ended.text}",
                "check its cable and whether another client is connected, then start again",
            ),
            now,
        )

    def _process_report(self, report: Report, at: float, now: float) -> None:
        if self._lost or not self._startup.controller.streams:
            return
        placed = self._numbers.place(report.sequence, at)
        if placed is None:
            self._notice("numbers", f"a report with the number {report.sequence} is ignored")
            return
        if placed.is_newest:
            self._newest, self._unanswered = report, True
            self._is_at_rest |= self._has_left and not report.status & Status.MOVING
            self._follow(report)
        self._take(report, now)
        if self._request is not None or self._is_leaving:
            self._answer()
        elif not self._lost:
            self._report(report, placed.number, placed.restarted, at)

    def _follow(self, report: Report) -> None:
        """Take over the joints of a controller that is not ready, and note the change of its state."""
        joints, stream = self._joints_of(report), self._stream
        if stream is None:
            self._begin_stream(report)
            return
        was_ready, stream.ready = stream.ready, bool(report.status & Status.READY)
        stream.external = report.joints[6:]
        if not stream.ready and is_finite(joints):
            if stream.limiter is not None:
                stream.limiter.rest(joints)
            stream.stopped |= self._moving
        if was_ready and (not stream.ready or report.robot_status):
            self._ask_alarm()

    def _begin_stream(self, report: Report) -> None:
        self._stream = _Stream(
            self._startup.controller.limits, None, report.joints[6:], bool(report.status & Status.READY)
        )
        own, speeds = MODELS[self._settings.model].speeds_deg_s, self._startup.controller.speeds_deg_s
        if speeds != own:
            self._notice(
                "model",
                f"its joints are limited to {_listed(speeds)} °/s, those of a {self._settings.model} to"
                f" {_listed(own)}: check robot.fanuc.model",
            )

    # --- reports

    def _report(self, report: Report, number: int, restarted: bool, at: float) -> None:
        pose = self._pose_of(report)
        trouble = find_trouble(report, self._alarm) or self._misfit(report, pose)
        if restarted and not trouble:
            trouble = Trouble("its numbers restarted", "check whether another client started a stream")
        base = Pose((math.nan,) * 3, (1.0, 0.0, 0.0, 0.0)) if pose is None else self._in_base(pose)
        if pose is None:
            trouble = trouble or Trouble("it reports a position that is not a number", "check its alarms")
        sent_at = self._clock.sent_at(report.time_s, at)
        force = self._force_of(report, base)
        self._events.append(
            ReportReceived(RobotReport(number, base, sent_at, at, trouble.fact, (), force, trouble.remedy))
        )

    def _joints_of(self, report: Report) -> Joints:
        """Return the reported joints, with J3 against the upper arm."""
        a, b, c, d, e, f = report.joints[:6]
        joints = a, b, c, d, e, f
        return from_pendant(joints) if self._settings.stream_j3 == "horizon" else joints

    def _pose_of(self, report: Report) -> Pose | None:
        """Return the reported pose in the world frame; None if it is not a number."""
        x, y, z, w, p, r = report.pose[:6]
        if not is_finite(report.pose[:6]):
            return None
        return Pose((x / 1e3, y / 1e3, z / 1e3), from_angles(r, p, w))

    def _in_base(self, pose: Pose) -> Pose:
        x, y, z = pose.position
        return Pose((x, y, z + self._settings.world_height_mm / 1e3), pose.quaternion)

    def _misfit(self, report: Report, pose: Pose | None) -> Trouble:
        """Learn the tool from the first report, and compare joints and pose of each further one."""
        joints = self._joints_of(report)
        if pose is None or not is_finite(joints):
            return NO_TROUBLE
        settings = self._settings
        if self._arm is None:
            plain = FanucArm(settings.model, straight_tool(0.0), settings.world_height_mm)
            tool = tool_on(plain.face_plate(joints), pose)
            if math.hypot(*tool.position) > TOOL_MAX_M:
                return self._wrong_arm()
            self._arm = FanucArm(settings.model, tool, settings.world_height_mm)
            if self._stream is not None:
                self._stream.limiter = PathLimiter(self._arm, joints, settings.cycle_s)
        expected, base = self._arm.pose(joints), self._in_base(pose)
        apart = math.dist(expected.position, base.position)
        if apart > FIT_M or angle_between(expected.quaternion, base.quaternion) > FIT_RAD:
            return self._wrong_arm()
        return NO_TROUBLE

    def _wrong_arm(self) -> Trouble:
        return Trouble(
            f"its joints do not fit its reported position with the dimensions of a {self._settings.model}",
            "set robot.fanuc.model; if it is right, check whether its tool frame was changed",
        )

    def _force_of(self, report: Report, pose: Pose) -> Vector | None:
        if report.wrench is None or report.sensor not in (1, 2) or self._settings.sensor == "none":
            return None
        force = report.wrench[:3]
        return rotate(pose.quaternion, force) if self._settings.force_axes == "tool" else force

    # --- answers

    def _answer(self) -> None:
        """Answer the newest report, unless it has been answered."""
        if self._unanswered and not self._has_left:
            self._unanswered, self._due, self._has_left = False, True, self._is_leaving

    def _command(self) -> Command:
        """Return the command for the newest report."""
        report, stream = self._newest, self._stream
        assert report is not None, "there is a report to answer"
        version = self._startup.controller.version
        if stream is None or stream.limiter is None or not stream.ready:
            return Command(version, report.sequence, report.joints, JOINTS, self._is_leaving, moves=False)
        if not stream.limiter.step(self._limits(stream, stream.limiter.speed)):
            self._notice("joints", "the arm cannot reach a set point: it stays at the last one")
        joints = stream.limiter.joints
        if self._settings.stream_j3 == "horizon":
            joints = to_pendant(joints)
        return Command(version, report.sequence, (*joints, *stream.external), JOINTS, self._is_leaving)

    def _limits(self, stream: _Stream, speed: float) -> tuple[AxisLimits, ...]:
        """Return the limits of the joints at a speed of the tool, m/s."""
        settings = self._settings
        limits = stream.limits.at(speed, settings.load_percent / 100.0)
        return tuple(axis.scaled(settings.limits_percent / 100.0) for axis in limits)

    def _notice(self, kind: str, text: str) -> None:
        """Report each text once."""
        if text not in self._noticed and len(self._noticed) < NOTICES_MAX:
            self._noticed.add(text)
            self._events.append(StreamNotice(kind, text))


def _listed(values: Sequence[float]) -> str:
    return " ".join(f"{value:g}" for value in values)
