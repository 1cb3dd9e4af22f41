"""Commands that the emulated control box carries out, by function number."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeAlias

from emulators.arm.joint_loops import six
from emulators.orders import Act, Reach, ReceivedOrder
from hil_xarm.arms import from_box, to_box
from hil_xarm.box import Box
from hil_xarm.codes import Error, Warning
from hil_xarm.frames import ALL_JOINTS, Bit, Function, Mode, Request, State, pack_floats, unpack_floats
from hil_xarm.motion import Pace
from hil_xarm.reporting import seven, version_text
from protocol.arm_size import PerAxis
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose, rotation_vector

_SERVO_S = 0.01
"""Time between two servo commands that is expected when a client is judged, s. Chosen: that of the maker's examples."""
_TURN_RAD_S = math.pi
"""Largest rotational speed of a tool, rad/s: the speed of a joint."""
_TEXT_BYTES = 40
"""Smallest length of a text in a reply."""
_HOME_PACE = Pace(20.0, 500.0)
"""Speed and acceleration of a motion without its own, degrees. Source: defaults of the maker's client."""
_IGNORED = (Function.SAVE, Function.SET_FEEDBACK, Function.SYSTEM, Function.BRAKE)
"""Functions that are answered as done."""

Answer: TypeAlias = bytes
Handler: TypeAlias = Callable[[bytes, float], Answer]


class Commands:
    """Commands of the clients of one box."""

    def __init__(self, box: Box) -> None:
        self._box = box
        self._reach = Reach(_SERVO_S, box.profile.tool_speed_mm_s / 1e3, _TURN_RAD_S)
        self._end = box.motion.set_point
        """Joints at the end of the newest planned motion."""
        self._handlers: Mapping[int, Handler] = {
            Function.VERSION: lambda data, now: _text(version_text(box)),
            Function.SERIALS: self._serials,
            Function.ENABLE: self._enable,
            Function.SET_STATE: self._set_state,
            Function.STATE: lambda data, now: bytes((box.state,)),
            Function.QUEUE: lambda data, now: box.queued.to_bytes(2, "big"),
            Function.ERROR: lambda data, now: bytes((box.error, box.warning)),
            Function.CLEAR_ERROR: self._clear_error,
            Function.CLEAR_WARNING: self._clear_warning,
            Function.SET_MODE: self._set_mode,
            Function.MOVE_LINE: self._move_line,
            Function.MOVE_JOINTS: self._move_joints,
            Function.MOVE_HOME: self._move_home,
            Function.MOVE_RELATIVE: self._move_relative,
            Function.SERVO_JOINTS: self._servo_joints,
            Function.SERVO_POSE: self._servo_pose,
            Function.TCP_OFFSET: self._set_tcp,
            Function.LOAD: self._set_load,
            Function.COLLISION: partial(self._set_sensitivity, "collision_sensitivity"),
            Function.TEACH: partial(self._set_sensitivity, "teach_sensitivity"),
            Function.POSE: lambda data, now: pack_floats(*to_box(box.reported_pose(now)[0])),
            Function.JOINTS: self._joints,
            Function.INVERSE: self._inverse,
            Function.FORWARD: self._forward,
            Function.TORQUES: self._torques,
            Function.POSE_AXIS_ANGLE: self._axis_angle,
            Function.FORCE: self._force,
            Function.FORCE_OLD: self._force,
            Function.FORCE_ENABLE: self._enable_force,
            Function.FORCE_MODE: lambda data, now: bytes(1),
            Function.FORCE_ZERO: self._zero_force,
            Function.FORCE_CONFIG: self._force_config,
        }

    def carry_out(self, request: Request, now: float) -> tuple[int, bytes]:
        """Carry out a command, and return the state and the data of its reply."""
        box = self._box
        box.advance(now)
        box.watch_sensor(now)
        bits, data = Bit(0), b""
        handler = self._handlers.get(request.function)
        try:
            if handler is not None:
                data = handler(request.data, now)
            elif request.function not in _IGNORED:
                box.unmodelled.touch(f"function {request.function}", "answered as unknown")
                box.warning, bits = Warning.UNKNOWN_COMMAND, Bit.INVALID
        except RemoteProtocolError as error:
            box.warning = Warning.PARAMETER
            box.report_order(ReceivedOrder(now, Act.UNREADABLE, str(error), False))
        bits |= Bit(0) if box.is_ready else Bit.NOT_READY
        bits |= Bit.WARNING if box.warning else Bit(0)
        bits |= Bit.ERROR if box.error else Bit(0)
        return int(bits), data

    # --- state

    def _serials(self, data: bytes, now: float) -> Answer:
        profile = self._box.profile
        return _text(f"{profile.arm_serial}\0{profile.box_serial}")

    def _enable(self, data: bytes, now: float) -> Answer:
        joint, is_on = _bytes(data, 2)
        if joint == ALL_JOINTS:
            self._box.enable(bool(is_on))
        else:
            self._box.unmodelled.touch("motor of one joint", "answered as done, without effect")
        return b""

    def _set_state(self, data: bytes, now: float) -> Answer:
        (state,) = _bytes(data, 1)
        if not self._box.set_state(state):
            raise RemoteProtocolError(f"the state {state}")
        return b""

    def _clear_error(self, data: bytes, now: float) -> Answer:
        if self._box.error:
            self._box.report_order(ReceivedOrder(now, Act.RELEASE, "clear error", True))
        self._box.clear_error()
        return b""

    def _clear_warning(self, data: bytes, now: float) -> Answer:
        self._box.warning = Warning.NONE
        return b""

    def _set_mode(self, data: bytes, now: float) -> Answer:
        mode = _bytes(data, 1)[0]
        if mode not in tuple(Mode):
            self._box.unmodelled.touch(f"mode {mode}", "the arm does not move in it")
        self._box.set_mode(mode)
        return b""

    # --- motions

    def _report_motion(self, now: float, pose: Pose | None, text: str, acts: bool) -> None:
        box = self._box
        if box.orders.listener is not None:
            chain = box.motion.chain
            at = None if pose is None else chain.tip_of(self._flange_of(pose))
            box.report_order(ReceivedOrder(now, Act.MOTION, text, acts, at, reach=self._reach))

    def _flange_of(self, pose: Pose) -> Pose:
        joints = self._box.joints_of(pose)
        return pose if joints is None else self._box.motion.chain.flange(joints)

    def _servo_joints(self, data: bytes, now: float) -> Answer:
        values = unpack_floats(data, 7)
        if not all(map(math.isfinite, values)):
            raise RemoteProtocolError("joints that are not numbers")
        joints = _degrees(values)
        self._servo(joints, self._box.pose_of(joints), now)
        return b""

    def _servo_pose(self, data: bytes, now: float) -> Answer:
        pose = _pose(data)
        self._servo(self._box.joints_of(pose), pose, now)
        return b""

    def _servo(self, joints: PerAxis | None, pose: Pose, now: float) -> None:
        box = self._box
        acts = box.is_ready and box.mode == Mode.SERVO and box.state != State.PAUSED
        self._report_motion(now, pose, "servo target", acts and not box.faults.holds("stands", now))
        box.servo(joints, now)

    def _move_line(self, data: bytes, now: float) -> Answer:
        return self._plan_line(now, _pose(data), *unpack_floats(data[24:], 2))

    def _move_relative(self, data: bytes, now: float) -> Answer:
        """Move from the end of the newest planned motion. Assumed: roll, pitch and yaw are added one by one."""
        numbers, start = unpack_floats(data, 9), self._end if self._box.queued else self._box.motion.set_point
        by_joints, by_axis_angle = _bytes(data[44:], 2)
        if by_joints:
            joints = six([q + change for q, change in zip(start, _degrees(numbers), strict=True)])
            self._plan_joints(now, joints, *numbers[7:])
            return bytes((0, 0, 0))
        if by_axis_angle:
            self._box.unmodelled.touch("relative motion by axis and angle", "answered as a wrong parameter")
            raise RemoteProtocolError("a relative motion by axis and angle")
        pose = to_box(self._box.pose_of(start))
        goal = [at + change for at, change in zip(pose, numbers[:6], strict=True)]
        return self._plan_line(now, _pose(pack_floats(*goal)), *numbers[7:])

    def _plan_line(self, now: float, pose: Pose, speed: float, acceleration: float) -> Answer:
        box, pace = self._box, Pace(max(speed, 0.1) / 1e3, max(acceleration, 1.0) / 1e3)
        tip = box.motion.chain.tip_of(self._flange_of(pose))
        joints = box.joints_of(pose) or box.motion.chain.nearest(tip, box.motion.set_point)
        if joints is None:
            box.warning = Warning.NO_SOLUTION
            return bytes((0, 0, Warning.NO_SOLUTION))
        self._plan(now, pose, joints, lambda: box.motion.move_line(tip, pace))
        return bytes((0, 0, 0))

    def _move_joints(self, data: bytes, now: float) -> Answer:
        joints, (speed, acceleration) = _degrees(unpack_floats(data, 7)), unpack_floats(data[28:], 2)
        self._plan_joints(now, joints, speed, acceleration)
        return bytes((0, 0, 0))

    def _move_home(self, data: bytes, now: float) -> Answer:
        speed, acceleration = unpack_floats(data, 2)
        self._plan_joints(now, (0.0,) * 6, speed, acceleration)
        return bytes((0, 0, 0))

    def _plan_joints(self, now: float, joints: PerAxis, speed: float, acceleration: float) -> None:
        box = self._box
        if not box.motion.chain.allows(joints):
            box.fail(Error.JOINT_LIMIT)
            return
        pace = Pace(math.degrees(speed), math.degrees(acceleration)) if speed > 0.0 else _HOME_PACE
        self._plan(now, box.pose_of(joints), joints, lambda: box.motion.move_joints(joints, pace))

    def _plan(self, now: float, pose: Pose, joints: PerAxis, motion: Callable[[], object]) -> None:
        if accepted := self._box.plan(motion):
            self._end = joints
        chain = self._box.motion.chain
        reach = self._reach._replace(plans_own_path=True)
        at = chain.tip_of(self._flange_of(pose))
        self._box.report_order(ReceivedOrder(now, Act.MOTION, "planned motion", accepted, at, reach=reach))

    # --- settings of the tool

    def _set_tcp(self, data: bytes, now: float) -> Answer:
        self._box.tcp_offset = _pose(data)
        return b""

    def _set_load(self, data: bytes, now: float) -> Answer:
        mass, x, y, z = unpack_floats(data, 4)
        self._box.load = mass, x, y, z
        return b""

    def _set_sensitivity(self, name: str, data: bytes, now: float) -> Answer:
        setattr(self._box, name, _bytes(data, 1)[0])
        return b""

    # --- joints and poses

    def _joints(self, data: bytes, now: float) -> Answer:
        box = self._box
        count = (data[0] & 0x0F) if data else 1
        rows = (box.reported_pose(now)[1], box.motion.loops.rates, (0.0,) * 6)
        parts = [seven(map(math.radians, row)) for row in rows[: max(1, count)]]
        return b"".join(pack_floats(*part) for part in parts)

    def _inverse(self, data: bytes, now: float) -> Answer:
        joints = self._box.joints_of(_pose(data))
        if joints is None:
            self._box.warning = Warning.NO_SOLUTION
            return pack_floats(*(0.0,) * 7)
        return pack_floats(*seven(map(math.radians, joints)))

    def _forward(self, data: bytes, now: float) -> Answer:
        return pack_floats(*to_box(self._box.pose_of(_degrees(unpack_floats(data, 7)))))

    def _torques(self, data: bytes, now: float) -> Answer:
        box = self._box
        return pack_floats(*seven(box.motion.chain.torques(box.motion.joints, box.contact(now))))

    def _axis_angle(self, data: bytes, now: float) -> Answer:
        pose, _ = self._box.reported_pose(now)
        return pack_floats(*to_box(pose)[:3], *rotation_vector(pose.quaternion))

    # --- force sensor

    def _force(self, data: bytes, now: float) -> Answer:
        box = self._box
        if box.sensor is None:
            return pack_floats(*(0.0,) * 6)
        raw, external = box.sensor.read(now, box.motion.chain.flange(box.motion.joints).quaternion)
        return pack_floats(*(raw if data[:1] == b"\1" else external))

    def _enable_force(self, data: bytes, now: float) -> Answer:
        (is_on,) = _bytes(data, 1)
        if self._box.sensor is not None:
            self._box.sensor.enable(bool(is_on))
        elif is_on:
            self._box.fail(Error.SENSOR_LOST)
        return b""

    def _zero_force(self, data: bytes, now: float) -> Answer:
        if self._box.sensor is None or not self._box.sensor.is_on:
            self._box.fail(Error.SENSOR_ZERO)
        else:
            self._box.sensor.set_zero(now)
        return b""

    def _force_config(self, data: bytes, now: float) -> Answer:
        """Return application, whether it is on, type, number and rate; then mass, bias, centre and zero. The rest,
        which belongs to the force modes of the box, is zero.
        """
        sensor = self._box.sensor
        if sensor is None:
            return bytes(280)
        head = bytes((0, int(sensor.is_on), 0, 0)) + round(sensor.profile.rate_hz).to_bytes(2, "big")
        return (head + pack_floats(*(0.0,) * 5, *sensor.zero)).ljust(280, b"\0")


def _text(text: str) -> Answer:
    """Return a text that ends with a zero, as it is in a reply."""
    return f"{text}\0".encode().ljust(_TEXT_BYTES, b"\0")


def _bytes(data: bytes, count: int) -> bytes:
    """Return the first bytes of the data. Raises RemoteProtocolError if there are fewer."""
    if len(data) < count:
        raise RemoteProtocolError(f"a command with {len(data)} bytes of data in place of {count}")
    return data[:count]


def _degrees(values: tuple[float, ...]) -> PerAxis:
    a, b, c, d, e, f = map(math.degrees, values[:6])
    return a, b, c, d, e, f


def _pose(data: bytes) -> Pose:
    pose = from_box(unpack_floats(data, 6))
    if not all(map(math.isfinite, (*pose.position, *pose.quaternion))):
        raise RemoteProtocolError("a pose that is not a number")
    return pose
