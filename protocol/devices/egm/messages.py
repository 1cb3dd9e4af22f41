"""Messages of Externally Guided Motion as plain values: reports of the robot, and the answers to them.

One datagram is one message, without a length or a type before it [M, O:lib]. The robot sends `EgmRobot`; the answer
is `EgmSensor`, or `EgmSensorPathCorr` for a path correction. Values have their units on the wire: mm, degrees,
mm/s, degrees/s, ms. Source of the marks: specification of EGM, section 2.
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
"""Maximum size of a datagram, in bytes; a longer one is rejected without decoding. Chosen: a datagram usually has
some hundred bytes [O:flo], and this size fits into one Ethernet frame.
"""
VALUES_MAX = 6
"""Maximum number of values in an array [M]."""
DNUM_MAX = 40
"""Maximum number of numeric values exchanged with RAPID [M]."""
_NUMBERS = 2**32
_MICRO = 1_000_000
_ROBOT_7 = message_class("EgmRobot")
_ROBOT_6 = message_class("EgmRobot", RobotWare.RW6_10)
_SENSOR = message_class("EgmSensor")
_CORRECTION = message_class("EgmSensorPathCorr")


class MessageType(IntEnum):
    """Purpose of a message, as given in its header [M, O:lib]."""

    UNDEFINED = 0
    COMMAND = 1
    DATA = 2
    """Report of the robot."""
    CORRECTION = 3
    """Position reference for the robot."""
    PATH_CORRECTION = 4
    """Offset from the robot's programmed path."""


class Motors(IntEnum):
    """State of the motors [O:lib]."""

    UNDEFINED = 0
    ON = 1
    OFF = 2


class Guidance(IntEnum):
    """State of motion control, `mciState` [O:lib]."""

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
"""Members of each state enumeration in the order of their numbers on the wire, which count from 0. The wire has no
other values.
"""


class PoseMm(NamedTuple):
    """A pose in the correction frame."""

    position_mm: Vector
    quaternion: Quaternion
    """Orientation w x y z, called u0 … u3 on the wire."""


class Place(NamedTuple):
    """Position of the robot, measured or planned."""

    joints_deg: tuple[float, ...] = ()
    """Joint angles in degrees, or in radians from some controllers before RobotWare 6.07.01; see `joint_unit`."""
    pose: PoseMm | None = None
    external: tuple[float, ...] = ()
    """Positions of the external axes, degrees or mm. For a seven-axis arm, the third axis comes first [M, O:lib]."""
    time_us: int | None = None
    """Time since 1970-01-01, µs; None before RobotWare 6.07 [O:lib]."""


class RobotMessage(NamedTuple):
    """A datagram from the robot."""

    seqno: int
    tm_ms: int
    """Time on the controller's clock, ms. The zero of the clock is unknown."""
    feedback: Place | None = None
    """Measured position."""
    planned: Place | None = None
    """Set point of the controller."""
    motors: Motors = Motors.UNDEFINED
    guidance: Guidance = Guidance.UNDEFINED
    rapid: Rapid = Rapid.UNDEFINED
    converged: bool | None = None
    """Whether the convergence criteria are met."""
    force: tuple[float, ...] = ()
    """Measured force and torque, N and N·m, in the assumed order fx fy fz mx my mz [A]."""
    force_control: bool | None = None
    """Whether force control is active; None before RobotWare 7."""
    utilization_percent: float | None = None
    """Utilisation rate, %; above 100, the reference was reduced [M]. None before RobotWare 6.10."""
    move_index: int | None = None
    collision: bool | None = None
    digital: bool | None = None
    """Values of RAPIDfromRobot, from `dnum`; None before RobotWare 7.7."""
    dnum: tuple[float, ...] = ()


class SensorMessage(NamedTuple):
    """A position reference for the robot."""

    seqno: int
    tm_ms: int | None = None
    """Time stamp, ms; None if it is not sent, as by ABBRobotEGM [D]."""
    pose: PoseMm | None = None
    joints_deg: tuple[float, ...] = ()
    speed: tuple[float, ...] = ()
    """Feed-forward speed: vx vy vz in mm/s, then wx wy wz in degrees/s. It has three or six numbers, or is empty."""
    joint_speed_deg_s: tuple[float, ...] = ()
    digital: bool | None = None
    """Values of RAPIDtoRobot, sent in `dnum`."""
    dnum: tuple[float, ...] = ()

    @property
    def has_content(self) -> bool:
        """Whether the message holds a reference, a speed or a digital value."""
        has_reference = self.pose or self.joints_deg or self.speed or self.joint_speed_deg_s
        return bool(has_reference) or self.digital is not None


class PathCorrection(NamedTuple):
    """Offset from the robot's programmed path."""

    seqno: int
    tm_ms: int | None
    offset_mm: Vector
    """Offset in the path frame, mm. The robot ignores its component along the path, x [M]."""
    age_ms: int
    """Age of the measurement, ms."""


Answer: TypeAlias = SensorMessage | PathCorrection


# --- messages from the robot


def encode_robot(message: RobotMessage, version: RobotWare) -> bytes:
    """Encode a datagram as sent by a robot with this RobotWare version. Raises LocalProtocolError for a value that
    the version has no field for.
    """
    out = message_class("EgmRobot", version)()
    try:
        _head(out, message.seqno, message.tm_ms, MessageType.DATA)
        for place, field in ((message.feedback, out.feedBack), (message.planned, out.planned)):
            if place is not None:
                _put_position(field, place, version)
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
    """Decode a message of a robot of any version. Raises RemoteProtocolError if the datagram is not such a message.

    Numbers are returned as sent, including NaN; the caller checks the pose.
    """
    parsed = _parse(_ROBOT_7, data)
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
        # RobotWare 6 sends the numbers in the field in which 7 sends a flag; neither schema rejects the other [D]
        force = _parse(_ROBOT_6, data).measuredForce.force
    return RobotMessage(
        header.seqno,
        header.tm,
        _position(parsed.feedBack) if parsed.HasField("feedBack") else None,
        _position(parsed.planned) if parsed.HasField("planned") else None,
        _MOTORS[parsed.motorState.state],
        _GUIDANCE[parsed.mciState.state],
        _RAPID[parsed.rapidExecState.state],
        _optional(parsed, "mciConvergenceMet"),
        tuple(force[:]),  # a slice is twice as fast as one value at a time
        active,
        _optional(parsed, "utilizationRate"),
        _optional(parsed, "moveIndex"),
        _optional(parsed.CollisionInfo, "collsionTriggered"),
        _optional(parsed.RAPIDfromRobot, "digVal"),
        tuple(parsed.RAPIDfromRobot.dnum[:]),
    )


# --- messages to the robot


def encode_answer(message: Answer) -> bytes:
    """Encode an answer as a datagram. Raises LocalProtocolError for a number that must not be sent to a robot."""
    try:
        if isinstance(message, PathCorrection):
            _require_finite(message.offset_mm)
            out = _CORRECTION()
            _head(out, message.seqno, message.tm_ms, MessageType.PATH_CORRECTION)
            position = out.pathCorr.pos
            position.x, position.y, position.z = message.offset_mm
            out.pathCorr.age = message.age_ms
            return bytes(out.SerializeToString())
        out = _SENSOR()
        _head(out, message.seqno, message.tm_ms, MessageType.CORRECTION)
        numbers = (*message.joints_deg, *message.speed, *message.joint_speed_deg_s, *message.dnum)
        _require_finite(numbers)
        if message.joints_deg or message.pose is not None:
            if message.pose is not None:
                _require_finite((*message.pose.position_mm, *message.pose.quaternion))
            _put_position(out.planned, Place(message.joints_deg, message.pose), RobotWare.RW7)
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
    """Decode the answer to a robot by the type in its header, because an `EgmSensorPathCorr` could otherwise be
    decoded as an `EgmSensor` with a joint [D].

    Raises RemoteProtocolError for a datagram that no robot may use: it is damaged, incomplete or of another type,
    has an invalid number, or has too many numbers.
    """
    parsed = _parse(_SENSOR, data)
    kind, header = parsed.header.mtype, parsed.header
    tm = header.tm if header.HasField("tm") else None
    if kind == MessageType.PATH_CORRECTION:
        corrected = _parse(_CORRECTION, data)
        if not corrected.HasField("pathCorr"):
            raise RemoteProtocolError("EgmSensorPathCorr: the correction is missing")
        position = corrected.pathCorr.pos
        offset = position.x, position.y, position.z
        _trusted("EgmSensorPathCorr", offset, VALUES_MAX)
        return PathCorrection(header.seqno, tm, offset, corrected.pathCorr.age)
    if kind != MessageType.CORRECTION:
        raise RemoteProtocolError(f"EgmSensor: message type {kind} in the header, expected 3 or 4")
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


def has_external_axes(data: bytes) -> bool:
    """Return whether a valid answer has positions or speeds of external axes."""
    parsed = _parse(_SENSOR, data)
    return bool(parsed.planned.externalJoints.joints or parsed.speedRef.externalJoints.joints)


# --- parts


def _parse(kind: Any, data: bytes) -> Any:
    name = kind.DESCRIPTOR.name
    if len(data) > LARGEST_BYTES:
        raise RemoteProtocolError(f"{name}: {len(data)} bytes, more than {LARGEST_BYTES}")
    message = kind()
    try:
        message.ParseFromString(bytes(data))
    except DecodeError as error:
        raise RemoteProtocolError(f"{name}: damaged or truncated") from error
    if not message.IsInitialized():  # parsing does not check for required fields [D]
        raise RemoteProtocolError(f"{name}: {message.FindInitializationErrors()[0]} is missing")
    return message


def _head(out: Any, seqno: int, tm_ms: int | None, kind: MessageType) -> None:
    out.header.seqno = seqno % _NUMBERS
    if tm_ms is not None:
        out.header.tm = tm_ms % _NUMBERS
    out.header.mtype = kind


def _put_position(field: Any, place: Place, version: RobotWare) -> None:
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


def _position(field: Any) -> Place:
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
    """Decode the pose; None if the position or the orientation is missing."""
    if not field.HasField("pos"):
        return None
    at = field.pos
    position = at.x, at.y, at.z
    if field.HasField("euler"):  # it takes precedence [M]; about x, then y, then z of the fixed frame [O:lib]
        return PoseMm(position, from_angles(field.euler.z, field.euler.y, field.euler.x))
    if not field.HasField("orient"):
        return None
    orient = field.orient
    return PoseMm(position, (orient.u0, orient.u1, orient.u2, orient.u3))


def _optional(message: Any, name: str) -> Any:
    return getattr(message, name) if message.HasField(name) else None


def _trusted(name: str, values: Sequence[float], most: int) -> None:
    if len(values) > most:
        raise RemoteProtocolError(f"{name}: {len(values)} numbers; allowed: at most {most}")
    # a sum is faster, but may be infinite although every number is finite
    if not math.isfinite(sum(values)) and not all(map(math.isfinite, values)):
        raise RemoteProtocolError(f"{name}: contains a number that is not finite")


def _require_finite(numbers: Sequence[float]) -> None:
    if not math.isfinite(sum(numbers)) and not all(map(math.isfinite, numbers)):
        raise LocalProtocolError("EgmSensor: only finite numbers may be sent to a robot")
