"""Contents of the reports of an emulated control box."""

import math
from collections.abc import Mapping
from typing import Any

from hil_xarm.arms import AXES, TYPE, to_box
from hil_xarm.box import Box
from hil_xarm.reports import NORMAL, PLAIN, REAL, RICH, RT, Layout, Port
from protocol.geometry import Pose, rotation_vector

_ALL_ON = 0xFF
_NO_FORCE = (0.0,) * 6


def layout_of(port: Port, box: Box) -> Layout:
    """Return the fields that a port reports. Without a force sensor, port 30003 reports no force."""
    if port is Port.REAL and box.sensor is None:
        return PLAIN
    return {Port.REAL: REAL, Port.NORMAL: NORMAL, Port.RICH: RICH, Port.RT: RT}[port]


def read_report(port: Port, box: Box, now: float) -> bytes:
    """Return the report of a port at this time."""
    box.advance(now)
    box.watch_sensor(now)
    force = box.contact(now)
    pose, joints = box.reported_pose(now)
    external, raw = _forces(box, now)
    torques = box.motion.chain.torques(box.motion.joints, force)
    values: dict[str, Any] = {
        "state_mode": (box.state & 0x0F | box.mode << 4,),
        "queue": (box.queued,),
        "joints": seven(map(math.radians, joints)),
        "pose": to_box(pose),
        "torques": seven(torques),
        "external": external,
        "raw": raw,
    }
    if port in (Port.NORMAL, Port.RICH):
        values |= _status(box)
    if port is Port.RICH:
        values |= _box_values(box, pose)
    if port is Port.RT:
        values |= _rt_values(box, now)
    return layout_of(port, box).encode(values)


def _forces(box: Box, now: float) -> tuple[Any, Any]:
    if box.sensor is None:
        return _NO_FORCE, _NO_FORCE
    raw, external = box.sensor.read(now, box.motion.chain.flange(box.motion.joints).quaternion)
    return external, raw


def _status(box: Box) -> Mapping[str, Any]:
    on = _ALL_ON if box.is_enabled else 0
    return {
        "brakes": (on,),
        "enabled": (on,),
        "error": (box.error,),
        "warning": (box.warning,),
        "tcp_offset": to_box(box.tcp_offset),
        "load": box.load,
        "collision": (box.collision_sensitivity,),
        "teach": (box.teach_sensitivity,),
        "gravity": (0.0, 0.0, -1.0),
    }


def _box_values(box: Box, pose: Pose) -> Mapping[str, Any]:
    profile = box.profile
    fastest, quickest = (
        math.radians(profile.joint_speed_deg_s),
        math.radians(profile.joint_acceleration_deg_s2),
    )
    return {
        "type": (TYPE,),
        "axes": (AXES,),
        "version": tuple(version_text(box).encode()[:29].ljust(30, b"\0")),
        "tcp_limits": (1000.0, 1.0, 50000.0, 0.1, profile.tool_speed_mm_s),
        "joint_limits": (20.0, 0.01, quickest, 0.0001, fastest),
        "turn_limits": (2.3, 2.7),
        "tcp_speed": (1e3 * box.motion.tool_speed,),
        "joint_speeds": seven(map(math.radians, box.motion.loops.rates)),
        "axis_angle": rotation_vector(pose.quaternion),
        "switches": (int(box.sensor is not None and box.sensor.is_on),),
    }


def _rt_values(box: Box, now: float) -> Mapping[str, Any]:
    motion = box.motion
    return {
        "time": (round((now - box.powered_at) * 1e6),),  # Assumed: in microseconds
        "target_joints": seven(map(math.radians, motion.set_point)),
        "target_joint_speeds": seven(map(math.radians, motion.set_speeds)),
        "joint_speeds": seven(map(math.radians, motion.loops.rates)),
        "target_pose": to_box(box.pose_of(motion.set_point)),
    }


def seven(values: Any) -> tuple[float, ...]:
    """Return the values of six joints with a zero for the seventh."""
    return (*values, 0.0)


def version_text(box: Box) -> str:
    """Return the text with which the box answers a request of its version."""
    profile = box.profile
    return f"{AXES},{TYPE},{profile.arm_serial},{profile.box_serial},v{profile.firmware}"
