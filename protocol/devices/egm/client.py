"""Client of a robot that is guided by poses: each datagram of the robot is answered once, with an absolute pose.

The controller moves its set point with `speed = k * (reference - set point) + speed reference` [M], where k is 5
1/s by default. Without a speed reference, the set point follows a reference that moves at 20 mm/s with a lag of 4
mm. The answer therefore also carries the speed of the reference, computed from one answer to the next. The
remaining lag is the controller's delay of some 20 ms. If this client stops sending during a movement, the robot
continues with the last speed until the controller's time-out. It never goes farther than speed / k beyond the last
reference, because the position term limits it: 4 mm at 20 mm/s.

The robot reads one message per cycle, in order of arrival, right after it sends its datagram [M]. A surplus answer
would remain in its queue and delay all later answers. Therefore, if several datagrams arrive together, only the
newest is answered, and a repeated datagram is not answered. An answer that was sent when the next datagram was
already in transit arrives too late for that cycle and waits for the following one; the next answer is then skipped.
If a movement ends while the tool is moving, its speed is withdrawn at once, by an answer ahead of the next
datagram.

The robot is not guided while its motors are off, its program is stopped or its guidance has not begun. Each
datagram is then answered with the set point that it reports, without speed. The robot therefore does not move, not
even when guidance begins or continues.
"""

import math
from collections import deque
from collections.abc import Sequence

from protocol.datagram import arrived_at
from protocol.devices.egm.answers import Answers
from protocol.devices.egm.frames import APART_MM, Frames
from protocol.devices.egm.joint_unit import JointCheck
from protocol.devices.egm.messages import (
    Guidance,
    Motors,
    Place,
    PoseMm,
    Rapid,
    RobotMessage,
    SensorMessage,
    decode_robot,
    encode_answer,
)
from protocol.devices.egm.numbering import CycleCheck, Numbering
from protocol.devices.egm.trouble import NO_POSE, RENUMBERED, find_trouble
from protocol.devices.egm.units import from_wire, to_wire
from protocol.endpoint import NO_TROUBLE, RemoteProtocolError, Trouble
from protocol.geometry import Pose, Vector, rotate, rotation_vector, turn_between
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice

_BEGIN_S = 5.0
"""Time limit from the start of a session to the start of its guidance, s. Chosen. Until then, datagrams are
answered but not reported; afterwards, a fault is reported.
"""
_EVENTS_MAX = 1024
"""Maximum number of queued events. Chosen."""
_NOWHERE = Pose((math.nan, math.nan, math.nan), (1.0, 0.0, 0.0, 0.0))
_STILL = (0.0,) * 6


class EgmClient:
    """`protocol.robot.StreamClient` over datagrams. The robot sends first."""

    def __init__(
        self,
        cycle: float,
        feed_forward: bool = True,
        force_axes: str = "tool",
        joints: JointCheck | None = None,
    ) -> None:
        """Create a client. `cycle` is the time between two datagrams of the robot, s. With `feed_forward`, answers
        carry a speed.

        `force_axes` says whether the measured force is along the axes of the tool ("tool") or of the base ("base"),
        or is ignored ("none"). `joints` compares the reported joints with the reported pose; None disables this
        check.
        """
        self._cycle, self._feed_forward, self._force_axes = cycle, feed_forward, force_axes
        self._joint_check = joints
        self._joint_result: tuple[Place | None, Trouble] = None, NO_TROUBLE
        """Position whose joints were last compared with its pose, and the result."""
        self._events: deque[StreamEvent] = deque(maxlen=_EVENTS_MAX)
        self._numbers, self._cycle_check, self._answers = Numbering(cycle), CycleCheck(cycle), Answers(cycle)
        self._reference: PoseMm | None = None
        """Pose for the next answer; None until there is one."""
        self._session_at: float | None = None
        """Start time of a session whose guidance has not begun, s; None once it has begun."""
        self._guided = False
        """Whether the newest datagram reported no fault."""
        self._moving = False
        self._stopped = False
        """Whether the robot could not move at some time in this movement. It then does not move until the next
        movement.
        """
        self._frames = Frames()
        self._noticed_at: dict[str, float] = {}

    # --- Endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            at = arrived_at(datagram, now)
            try:
                message = decode_robot(datagram)
            except RemoteProtocolError as error:
                self._notice("datagram", f"a datagram is ignored: {error}", now)
                continue
            self._process_message(message, at)

    def next_event(self) -> StreamEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        reference, answers = self._reference, self._answers
        if reference is None or not answers.begin_answer(now):
            return []
        speed = self._speed(reference) if self._feed_forward else ()
        message = SensorMessage(answers.count, self._numbers.tm, reference, speed=speed)
        answers.note(reference, self._numbers.number, any(speed))
        return [encode_answer(message)]

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing, because this client has no deadline."""

    # --- StreamClient

    def begin(self, pose: Pose) -> None:
        self._moving, self._stopped = True, not self._guided
        if self._guided:
            self._reference = self._answers.reference = to_wire(pose)

    def target(self, pose: Pose, now: float) -> None:
        if not self._stopped:
            self._reference = to_wire(pose)
        self.hold(now)

    def hold(self, now: float) -> None:
        self._answers.allow(not self._frames.refused)

    def end(self) -> None:
        self._answers.end_movement(self._moving)
        self._moving = False

    # --- datagrams of the robot

    def _process_message(self, message: RobotMessage, at: float) -> None:
        renumbered, numbers = NO_TROUBLE, self._numbers
        distance = numbers.distance(message, at)
        if distance is None:
            if self._is_stray(message, at):
                return
            ahead = numbers.ahead(message)
            if ahead <= 0 or numbers.is_silent(at):
                renumbered = self._begin_session(message, at)
            distance = max(ahead, 1)
        number = numbers.number + distance
        measured = message.feedback.pose if message.feedback is not None else None
        self._cycle_check.take(message)
        planned = message.planned.pose if message.planned is not None else None
        trouble = (
            find_trouble(message)
            or (NO_TROUBLE if measured is not None else NO_POSE)
            or self._cycle_check.trouble
            or renumbered
        )
        if distance > 0:
            misplaced = self._pose_trouble(message.feedback, planned, at)
            trouble = self._frames.refused or trouble or misplaced
        self._answers.pass_time(at)
        begins = self._is_beginning(message, at)
        if distance > 0:
            numbers.follow(message, distance, at)
            self._guided = not trouble
            self._stopped |= self._moving and bool(trouble)
            if trouble or self._reference is None:
                self._hold_position(planned or measured)
        if begins and not self._frames.refused:
            self._answers.due |= distance != 0
            return
        self._answers.expect(distance == 0)
        pose = _NOWHERE if measured is None else from_wire(measured)
        force = self._measured_force(message.force, pose) if message.force else None
        self._events.append(
            ReportReceived(RobotReport(number, pose, at, at, trouble.fact, (), force, trouble.remedy))
        )

    def _measured_force(self, values: tuple[float, ...], pose: Pose) -> Vector | None:
        """Return the force estimated by the robot, in the base frame, N; None if the robot reports none.

        Six zeros mean that there is no sensor, because no sensor is free of noise.
        """
        if self._force_axes == "none" or len(values) < 3 or not any(values):
            return None
        a, b, c = values[:3]
        force = (a, b, c) if self._force_axes == "base" else rotate(pose.quaternion, (a, b, c))
        return force if all(map(math.isfinite, force)) else None

    def _pose_trouble(self, place: Place | None, planned: PoseMm | None, at: float) -> Trouble:
        """Return the reason why no movement may begin at the reported pose. During a movement, there is none."""
        measured = None if place is None else place.pose
        if self._moving:
            return NO_TROUBLE
        frames = self._frames
        return (
            self._joint_trouble(place)
            or frames.fault(measured, planned, at)
            or frames.leaves(self._reference, planned, at)
        )

    def _joint_trouble(self, place: Place | None) -> Trouble:
        """Return the reason to reject the reported joints: they contradict the pose in the same report."""
        if self._joint_check is None or place is None:
            return NO_TROUBLE
        place = place._replace(time_us=None)
        if place != self._joint_result[0]:
            self._joint_result = place, self._joint_check.find_trouble(place)
        return self._joint_result[1]

    def _is_beginning(self, message: RobotMessage, at: float) -> bool:
        """Return whether the guidance of a new session has not begun and may still begin in time.

        A session that has just ended with a time-out is followed by another one while the program runs.
        """
        if self._session_at is not None and (
            message.guidance == Guidance.RUNNING or at - self._session_at > _BEGIN_S
        ):
            self._session_at = None
        ready = message.motors == Motors.ON and message.rapid in (Rapid.RUNNING, Rapid.UNDEFINED)
        return self._session_at is not None and ready

    def _is_stray(self, message: RobotMessage, at: float) -> bool:
        """Return whether to ignore a datagram whose number does not follow the previous one."""
        planned, reference = message.planned, self._reference
        near = (
            planned is not None
            and planned.pose is not None
            and reference is not None
            and math.dist(planned.pose.position_mm, reference.position_mm) <= APART_MM
        )
        stray = self._numbers.is_stray(message, near and not find_trouble(message), at)
        if stray:
            self._notice("numbers", f"datagram {message.seqno} after {self._numbers.seqno} is ignored", at)
        return stray

    def _begin_session(self, message: RobotMessage, at: float) -> Trouble:
        """Restart the numbering with this datagram and return the trouble to report.

        A robot that was guided throughout reports a fault, and its movement continues.
        """
        goes_on = self._numbers.guided_on and self._moving
        if self._numbers.seqno is not None and not goes_on:
            self._end_session(
                "the controller started another EGM session", "the tool is where it was stopped"
            )
        self._session_at = None if goes_on else at
        self._cycle_check.begin(message)
        self._frames = Frames()
        return RENUMBERED if goes_on else NO_TROUBLE

    def _hold_position(self, pose: PoseMm | None) -> None:
        """Set the reference to `pose`, the robot's own set point. An invalid set point is not sent back."""
        if pose is not None and all(map(math.isfinite, (*pose.position_mm, *pose.quaternion))):
            self._reference = pose

    def _end_session(self, fact: str, remedy: str) -> None:
        self._reference = self._answers.reference = None
        self._stopped = self._moving
        notice = StreamNotice("link", str(Trouble(fact, remedy)))
        self._events.append(StreamLost(fact, remedy) if self._moving else notice)

    def _notice(self, kind: str, text: str, now: float) -> None:
        """Report a notice of each kind at most once a second."""
        if now - self._noticed_at.get(kind, -math.inf) >= 1.0:
            self._noticed_at[kind] = now
            self._events.append(StreamNotice(kind, text))

    def _speed(self, reference: PoseMm) -> tuple[float, ...]:
        """Return the speed from the previous reference to `reference`: translation in mm/s, then rotation in
        degrees/s.
        """
        before = self._answers.reference
        if before is None or not self._moving or self._stopped:
            return _STILL
        time = max(self._numbers.number - self._answers.number, 1) * self._cycle
        (x, y, z), (a, b, c) = before.position_mm, reference.position_mm
        u, v, w = map(math.degrees, rotation_vector(turn_between(before.quaternion, reference.quaternion)))
        return (a - x) / time, (b - y) / time, (c - z) / time, u / time, v / time, w / time
