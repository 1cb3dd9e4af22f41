"""Datagrams of Externally Guided Motion as plain values: what a robot tells, and how it is answered.

One datagram is one message, without a length or a type before it [M, O:lib]. The robot sends `EgmRobot`; it is answered
with `EgmSensor`, or with `EgmSensorPathCorr` where it corrects a path. Values are as on the wire: mm, degrees, mm/s,
degrees/s, ms. Source of the marks: specification of EGM, section 2.
"""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

from google.protobuf.message import DecodeError

from protocol.devices.egm.schema import RobotWare, message_class
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.geometry import Quaternion, Vector, from_angles

LARGEST_BYTES = 1500
"""A longer datagram is refused unread. Chosen: some hundred bytes are usual [O:flo], and an Ethernet frame holds it."""
VALUES_MAX = 6
"""Most values of an array [M]."""
DNUM_MAX = 40
"""Most numbers that RAPID exchanges [M]."""
_NUMBERS = 2**32
_MICRO = 1_000_000
_ROBOT_7 = message_class("EgmRobot")
_ROBOT_6 = message_class("EgmRobot", RobotWare.RW6_10)
_SENSOR = message_class("EgmSensor")
_CORRECTION = message_class("EgmSensorPathCorr")


class MessageType(IntEnum):
    """Purpose of a message, in its header [M, O:lib]."""

    UNDEFINED = 0
    COMMAND = 1
    DATA = 2
    """From the robot."""
    CORRECTION = 3
    """A reference for the robot."""
    PATH_CORRECTION = 4
    """An offset from the robot's own path."""


class Motors(IntEnum):
    """State of the motors [O:lib]."""

    UNDEFINED = 0
    ON = 1
    OFF = 2


class Guidance(IntEnum):
    """State of the motion control interface, mciState [O:lib]."""

    UNDEFINED = 0
    ERROR = 1
    STOPPED = 2
    RUNNING = 3


class Rapid(IntEnum):
    """State of the RAPID program [O:lib]."""

    UNDEFINED = 0
    STOPPED = 1
    RUNNING = 2


_MOTORS, _GUIDANCE, _RAPID = tuple(Motors), tuple(Guidance), tuple(Rapid)
"""By their numbers, which count from 0: an enumeration on the wire has no others."""


class PoseMm(NamedTuple):
    """A pose in the correction frame."""

    position_mm: Vector
    quaternion: Quaternion
    """w x y z, called u0 … u3 on the wire."""


class Place(NamedTuple):
    """Where the robot is, or is to be."""

    joints_deg: tuple[float, ...] = ()
    """In degrees; in radians from some controllers before RobotWare 6.07.01, see `joint_unit`."""
    pose: PoseMm | None = None
    external: tuple[float, ...] = ()
    """External axes, degrees or mm; of an arm with seven axes the third one comes first [M, O:lib]."""
    time_us: int | None = None
    """Since 1970, µs; None before RobotWare 6.07 [O:lib]."""


class RobotMessage(NamedTuple):
    """A datagram from the robot."""

    seqno: int
    tm_ms: int
    """The controller's clock; its zero is not known."""
    feedback: Place | None = None
    """Measured."""
    planned: Place | None = None
    """Set point of the controller."""
    motors: Motors = Motors.UNDEFINED
    guidance: Guidance = Guidance.UNDEFINED
    rapid: Rapid = Rapid.UNDEFINED
    converged: bool | None = None
    """The window of convergence is held."""
    force: tuple[float, ...] = ()
    """Measured force, N and N·m; the order is assumed: fx fy fz mx my mz [A]."""
    force_control: bool | None = None
    """Force control is active; None before RobotWare 7."""
    utilization_percent: float | None = None
    """Above 100 the reference was reduced [M]; None before RobotWare 6.10."""
    move_index: int | None = None
    collision: bool | None = None
    digital: bool | None = None
    """RAPIDfromRobot, with `dnum`; None before RobotWare 7.7."""
    dnum: tuple[float, ...] = ()


class SensorMessage(NamedTuple):
    """A reference for the robot."""

    seqno: int
    tm_ms: int | None = None
    """None: not sent, as by ABBRobotEGM [D]."""
    pose: PoseMm | None = None
    joints_deg: tuple[float, ...] = ()
    speed: tuple[float, ...] = ()
    """Feed-forward vx vy vz in mm/s, wx wy wz in degrees/s; three or six numbers, or none."""
    joint_speed_deg_s: tuple[float, ...] = ()
    digital: bool | None = None
    """RAPIDtoRobot, with `dnum`."""
    dnum: tuple[float, ...] = ()

    @property
    def says_something(self) -> bool:
        """Whether it holds a reference, a speed or a digital value."""
        has_reference = self.pose or self.joints_deg or self.speed or self.joint_speed_deg_s
        return bool(has_reference) or self.digital is not None


class PathCorrection(NamedTuple):
    """An offset from the path that the robot goes by itself."""

    seqno: int
    tm_ms: int | None
    offset_mm: Vector
    """In the path frame: x along the path is not heeded [M]."""
    age_ms: int
    """Age of the measurement."""


Answer: TypeAlias = SensorMessage | PathCorrection


# --- from the robot


def encode_robot(message: RobotMessage, version: RobotWare) -> bytes:
    """Encode a datagram as a robot of this version sends it. Raises LocalProtocolError for a value without a field."""
    out = message_class("EgmRobot", version)()
    try:
        _head(out, message.seqno, message.tm_ms, MessageType.DATA)
        for place, field in ((message.feedback, out.feedBack), (message.planned, out.planned)):
            if place is not None:
                _put_place(field, place, version)
        out.motorState.state = message.motors
        out.mciState.state = message.guidance
        if message.converged is not None:
            out.mciConvergenceMet = message.converged
        out.rapidExecState.state = message.rapid
        if version is RobotWare.RW7 and message.force_control is not None:
            out.measuredForce.fcActive = message.force_control
        out.measuredForce.force.extend(message.force)
        if message.utilization_percent is not None and version is not RobotWare.RW6_06:
            out.utilizationRate = message.utilization_percent
        if version is RobotWare.RW7:
            if message.move_index is not None:
                out.moveIndex = message.move_index
            if message.collision is not None:
                out.CollisionInfo.collsionTriggered = message.collision
            if message.digital is not None:
                out.RAPIDfromRobot.digVal = message.digital
            out.RAPIDfromRobot.dnum.extend(message.dnum)
        return bytes(out.SerializeToString())
    except (TypeError, ValueError) as error:
        raise LocalProtocolError(f"EgmRobot: {error}") from error


def decode_robot(data: bytes) -> RobotMessage:
    """Message of a robot of any version. Raises RemoteProtocolError for a datagram that is none of a robot.

    Numbers are as sent, also NaN: whose pose it is, its user looks at.
    """
    parsed = _parsed(_ROBOT_7, data)
    header = parsed.header
    kind = header.mtype
    if kind != MessageType.DATA:
        raise RemoteProtocolError(
            f"EgmRobot: message type {kind} in the header, {MessageType.DATA} is a robot's"
        )
    force, active = parsed.measuredForce.force, None
    if parsed.measuredForce.HasField("fcActive"):
        active = parsed.measuredForce.fcActive
    elif parsed.HasField("measuredForce") and not force:
        # RobotWare 6 has the numbers where 7 has a flag; neither shape takes the other for an error [D]
        force = _parsed(_ROBOT_6, data).measuredForce.force
    return RobotMessage(
        header.seqno,
        header.tm,
        _place(parsed.feedBack) if parsed.HasField("feedBack") else None,
        _place(parsed.planned) if parsed.HasField("planned") else None,
        _MOTORS[parsed.motorState.state],
        _GUIDANCE[parsed.mciState.state],
        _RAPID[parsed.rapidExecState.state],
        _optional(parsed, "mciConvergenceMet"),
        tuple(force[:]),  # a slice at once is twice as quick as number by number
        active,
        _optional(parsed, "utilizationRate"),
        _optional(parsed, "moveIndex"),
        _optional(parsed.CollisionInfo, "collsionTriggered"),
        _optional(parsed.RAPIDfromRobot, "digVal"),
        tuple(parsed.RAPIDfromRobot.dnum[:]),
    )


# --- to the robot


def encode_answer(message: Answer) -> bytes:
    """Encode a datagram for the robot. Raises LocalProtocolError for a number that no robot may be sent."""
    try:
        if isinstance(message, PathCorrection):
            _only_finite(message.offset_mm)
            out = _CORRECTION()
            _head(out, message.seqno, message.tm_ms, MessageType.PATH_CORRECTION)
            position = out.pathCorr.pos
            position.x, position.y, position.z = message.offset_mm
            out.pathCorr.age = message.age_ms
            return bytes(out.SerializeToString())
        out = _SENSOR()
        _head(out, message.seqno, message.tm_ms, MessageType.CORRECTION)
        numbers = (*message.joints_deg, *message.speed, *message.joint_speed_deg_s, *message.dnum)
        _only_finite(numbers)
        if message.joints_deg or message.pose is not None:
            if message.pose is not None:
                _only_finite((*message.pose.position_mm, *message.pose.quaternion))
            _put_place(out.planned, Place(message.joints_deg, message.pose), RobotWare.RW7)
        if message.joint_speed_deg_s:
            out.speedRef.joints.joints.extend(message.joint_speed_deg_s)
        if message.speed:
            out.speedRef.cartesians.value.extend(message.speed)
        if message.digital is not None:
            out.RAPIDtoRobot.digVal = message.digital
        if message.dnum:
            out.RAPIDtoRobot.dnum.extend(message.dnum)
        return bytes(out.SerializeToString())
    except (TypeError, ValueError) as error:
        raise LocalProtocolError(f"EgmSensor: {error}") from error


def decode_answer(data: bytes) -> Answer:
    """Answer to a robot, by the type in the header: an `EgmSensorPathCorr` would be read as an `EgmSensor` with
    a joint [D]. Raises RemoteProtocolError for a datagram that no robot may use: damaged, incomplete, of another type,
    with a number that is none, or with more numbers than there are places.
    """
    parsed = _parsed(_SENSOR, data)
    kind, header = parsed.header.mtype, parsed.header
    tm = header.tm if header.HasField("tm") else None
    if kind == MessageType.PATH_CORRECTION:
        corrected = _parsed(_CORRECTION, data)
        if not corrected.HasField("pathCorr"):
            raise RemoteProtocolError("EgmSensorPathCorr: without a correction")
        position = corrected.pathCorr.pos
        offset = position.x, position.y, position.z
        _trusted("EgmSensorPathCorr", offset, VALUES_MAX)
        return PathCorrection(header.seqno, tm, offset, corrected.pathCorr.age)
    if kind != MessageType.CORRECTION:
        raise RemoteProtocolError(f"EgmSensor: message type {kind} in the header, 3 or 4 is expected")
    place, speed, rapid = parsed.planned, parsed.speedRef, parsed.RAPIDtoRobot
    pose = _pose(place.cartesian) if place.HasField("cartesian") else None
    joints, cartesian = tuple(place.joints.joints[:]), tuple(speed.cartesians.value[:])
    joint_speed, dnum = tuple(speed.joints.joints[:]), tuple(rapid.dnum[:])
    external = place.externalJoints.joints[:], speed.externalJoints.joints[:]
    for array in (joints, cartesian, joint_speed, *external):
        if array:
            _trusted("EgmSensor", array, VALUES_MAX)
    _trusted("EgmSensor", dnum, DNUM_MAX)
    if pose is not None:
        _trusted("EgmSensor", (*pose.position_mm, *pose.quaternion), 7)
    digital = _optional(rapid, "digVal")
    return SensorMessage(header.seqno, tm, pose, joints, cartesian, joint_speed, digital, dnum)


def names_external_axes(data: bytes) -> bool:
    """Whether an answer that can be read has places or speeds of external axes."""
    parsed = _parsed(_SENSOR, data)
    return bool(parsed.planned.externalJoints.joints or parsed.speedRef.externalJoints.joints)


# --- parts


def _parsed(kind: Any, data: bytes) -> Any:
    name = kind.DESCRIPTOR.name
    if len(data) > LARGEST_BYTES:
        raise RemoteProtocolError(f"{name}: {len(data)} bytes, more than {LARGEST_BYTES}")
    message = kind()
    try:
        message.ParseFromString(bytes(data))
    except DecodeError as error:
        raise RemoteProtocolError(f"{name}: damaged or cut off") from error
    if not message.IsInitialized():  # parsing does not look for what is required [D]
        raise RemoteProtocolError(f"{name}: {message.FindInitializationErrors()[0]} is missing")
    return message


def _head(out: Any, seqno: int, tm_ms: int | None, kind: MessageType) -> None:
    out.header.seqno = seqno % _NUMBERS
    if tm_ms is not None:
        out.header.tm = tm_ms % _NUMBERS
    out.header.mtype = kind


def _put_place(field: Any, place: Place, version: RobotWare) -> None:
    if place.joints_deg:
        field.joints.joints.extend(place.joints_deg)
    if place.pose is not None:
        position, orient = field.cartesian.pos, field.cartesian.orient
        position.x, position.y, position.z = place.pose.position_mm
        orient.u0, orient.u1, orient.u2, orient.u3 = place.pose.quaternion
    if place.external:
        field.externalJoints.joints.extend(place.external)
    if place.time_us is not None and version is not RobotWare.RW6_06:
        field.time.sec, field.time.usec = divmod(place.time_us, _MICRO)


def _place(field: Any) -> Place:
    time_us = None
    if field.HasField("time"):
        time = field.time
        time_us = time.sec * _MICRO + time.usec
    return Place(
        tuple(field.joints.joints[:]),
        _pose(field.cartesian) if field.HasField("cartesian") else None,
        tuple(field.externalJoints.joints[:]),
        time_us,
    )


def _pose(field: Any) -> PoseMm | None:
    """Return the pose; None without a position or without an orientation."""
    if not field.HasField("pos"):
        return None
    at = field.pos
    position = at.x, at.y, at.z
    if field.HasField("euler"):  # it wins [M]; about x, then y, then z of the fixed frame [O:lib]
        return PoseMm(position, from_angles(field.euler.z, field.euler.y, field.euler.x))
    if not field.HasField("orient"):
        return None
    orient = field.orient
    return PoseMm(position, (orient.u0, orient.u1, orient.u2, orient.u3))


def _optional(message: Any, name: str) -> Any:
    return getattr(message, name) if message.HasField(name) else None


def _trusted(name: str, values: Sequence[float], most: int) -> None:
    if len(values) > most:
        raise RemoteProtocolError(f"{name}: {len(values)} numbers where {most} are the most")
    # a sum is quicker, and may be infinite for numbers that are not
    if not math.isfinite(sum(values)) and not all(map(math.isfinite, values)):
        raise RemoteProtocolError(f"{name}: a number is invalid")


def _only_finite(numbers: Sequence[float]) -> None:
    if not math.isfinite(sum(numbers)) and not all(map(math.isfinite, numbers)):
        raise LocalProtocolError("EgmSensor: a robot is sent finite numbers alone")
