"""The client of a robot that is guided by poses: each datagram of the robot is answered once, with an absolute pose.

The controller moves its set point with `speed = k * (reference - set point) + speed reference` [M], and k is 5 1/s by
default: alone, a reference that goes 20 mm/s is followed 4 mm behind. So the answer carries the reference's own speed
too, from one answer to the next. What is left is the delay of the controller, some 20 ms. When this side falls silent
on its way, the robot continues with the last speed until the controller's time-out, but never farther than speed / k
beyond the last reference, for the position term holds it there: 4 mm at 20 mm/s.

The robot takes one message a cycle, in the order in which they came, right behind the datagram that it sends [M]. An
answer too many would stay in its queue for good, and delay all later ones. So of datagrams that came together only the
newest is answered, and one that comes again is not. An answer that left when the next datagram was on its way has come
too late to be taken with it, and waits for the one behind: then the next answer is left out. A movement that ends on
its way has its speed taken back at once, by an answer ahead of the next datagram.

The robot is not guided while its motors are off, its program stands or its guidance has not begun. Then each datagram
is answered with the set point that it tells, without speed: it stands still, also when guidance begins or continues.
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
"""Chosen: how long a session may continue before its guidance begins until that is told as a fault. Such datagrams are
answered, but not reported."""
_EVENTS_MAX = 1024
"""Chosen: events that are kept until they are taken."""
_NOWHERE = Pose((math.nan, math.nan, math.nan), (1.0, 0.0, 0.0, 0.0))
_STILL = (0.0,) * 6


class EgmClient:
    """A `protocol.robot.StreamClient` over datagrams; the robot speaks first."""

    def __init__(
        self,
        cycle: float,
        feed_forward: bool = True,
        force_axes: str = "tool",
        joints: JointCheck | None = None,
    ) -> None:
        """`cycle` is the time between two datagrams of the robot, s. With `feed_forward` answers carry a speed. The
        measured force lies along the axes of the tool or of the base, or is not to be heeded (none). Joints are
        compared with the pose by `joints`.
        """
        self._cycle, self._feed_forward, self._force_axes = cycle, feed_forward, force_axes
        self._joint_check = joints
        self._checked: tuple[Place | None, Trouble] = None, NO_TROUBLE
        """The newest place whose joints were compared with its pose, and what was found."""
        self._events: deque[StreamEvent] = deque(maxlen=_EVENTS_MAX)
        self._numbers, self._cycle_check, self._answers = Numbering(cycle), CycleCheck(cycle), Answers(cycle)
        self._reference: PoseMm | None = None
        """Pose for the next answer; None before there is one."""
        self._session_at: float | None = None
        """When a session came whose guidance has not begun, s; None once it has."""
        self._guided = False
        """The newest datagram told no fault."""
        self._moving = False
        self._stopped = False
        """The robot could not move in this movement; it stays where it is until the next one."""
        self._frames = Frames()
        self._told_at: dict[str, float] = {}

    # --- as an endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            at = arrived_at(datagram, now)
            try:
                message = decode_robot(datagram)
            except RemoteProtocolError as error:
                self._notice("datagram", f"a datagram is not heeded: {error}", now)
                continue
            self._take(message, at)

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
        """Do nothing: this client has no deadline."""

    # --- as a stream's client

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

    def _take(self, message: RobotMessage, at: float) -> None:
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
            misplaced = self._misplaced(message.feedback, planned, at)
            trouble = self._frames.refused or trouble or misplaced
        self._answers.pass_time(at)
        begins = self._begins(message, at)
        if distance > 0:
            numbers.follow(message, distance, at)
            self._guided = not trouble
            self._stopped |= self._moving and bool(trouble)
            if trouble or self._reference is None:
                self._stay_at(planned or measured)
        if begins and not self._frames.refused:
            self._answers.due |= distance != 0
            return
        self._answers.expect(distance == 0)
        pose = _NOWHERE if measured is None else from_wire(measured)
        force = self._measured_force(message.force, pose) if message.force else None
        self._events.append(
            ReportReceived(RobotReport(number, pose, at, at, trouble.fact, (), force, trouble.remedy))
        )

    def _measured_force(self, told: tuple[float, ...], pose: Pose) -> Vector | None:
        """Return the robot's own force in the base frame, N, or None if it reports none.

        Six zeros mean none: no sensor is so quiet.
        """
        if self._force_axes == "none" or len(told) < 3 or not any(told):
            return None
        a, b, c = told[:3]
        force = (a, b, c) if self._force_axes == "base" else rotate(pose.quaternion, (a, b, c))
        return force if all(map(math.isfinite, force)) else None

    def _misplaced(self, place: Place | None, planned: PoseMm | None, at: float) -> Trouble:
        """Reason for which the pose that is told outside of a movement is none to begin one at."""
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
        """Reason for which the joints that are told contradict the pose beside them."""
        if self._joint_check is None or place is None:
            return NO_TROUBLE
        place = place._replace(time_us=None)
        if place != self._checked[0]:
            self._checked = place, self._joint_check.find_trouble(place)
        return self._checked[1]

    def _begins(self, message: RobotMessage, at: float) -> bool:
        """Whether the guidance of a new session is still to begin, and may take so long. A session that has just ended
        with a time-out is followed by another one while the program runs.
        """
        if self._session_at is not None and (
            message.guidance == Guidance.RUNNING or at - self._session_at > _BEGIN_S
        ):
            self._session_at = None
        ready = message.motors == Motors.ON and message.rapid in (Rapid.RUNNING, Rapid.UNDEFINED)
        return self._session_at is not None and ready

    def _is_stray(self, message: RobotMessage, at: float) -> bool:
        """Whether a datagram that does not follow is not to be heeded."""
        planned, reference = message.planned, self._reference
        near = (
            planned is not None
            and planned.pose is not None
            and reference is not None
            and math.dist(planned.pose.position_mm, reference.position_mm) <= APART_MM
        )
        stray = self._numbers.is_stray(message, near and not find_trouble(message), at)
        if stray:
            self._notice(
                "numbers", f"datagram {message.seqno} behind {self._numbers.seqno} is not heeded", at
            )
        return stray

    def _begin_session(self, message: RobotMessage, at: float) -> Trouble:
        """Count again from this datagram. A robot that is guided meanwhile has a fault, and its movement continues."""
        goes_on = self._numbers.guided_on and self._moving
        if self._numbers.seqno is not None and not goes_on:
            self._lose("the controller began another EGM session", "the tool stands where it was stopped")
        self._session_at = None if goes_on else at
        self._cycle_check.begin(message)
        self._frames = Frames()
        return RENUMBERED if goes_on else NO_TROUBLE

    def _stay_at(self, pose: PoseMm | None) -> None:
        """Let the robot stand at its own set point. One that is none must not be sent back."""
        if pose is not None and all(map(math.isfinite, (*pose.position_mm, *pose.quaternion))):
            self._reference = pose

    def _lose(self, fact: str, remedy: str) -> None:
        self._reference = self._answers.reference = None
        self._stopped = self._moving
        notice = StreamNotice("link", str(Trouble(fact, remedy)))
        self._events.append(StreamLost(fact, remedy) if self._moving else notice)

    def _notice(self, kind: str, text: str, now: float) -> None:
        """Tell it, once a second of a kind at most."""
        if now - self._told_at.get(kind, -math.inf) >= 1.0:
            self._told_at[kind] = now
            self._events.append(StreamNotice(kind, text))

    def _speed(self, reference: PoseMm) -> tuple[float, ...]:
        """Speed from the reference that was sent last to this one: mm/s, then degrees/s."""
        before = self._answers.reference
        if before is None or not self._moving or self._stopped:
            return _STILL
        time = max(self._numbers.number - self._answers.number, 1) * self._cycle
        (x, y, z), (a, b, c) = before.position_mm, reference.position_mm
        u, v, w = map(math.degrees, rotation_vector(turn_between(before.quaternion, reference.quaternion)))
        return (a - x) / time, (b - y) / time, (c - z) / time, u / time, v / time, w / time
