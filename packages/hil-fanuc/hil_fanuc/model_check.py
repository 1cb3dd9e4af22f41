"""Check of the configured model by what the Remote Motion Interface reports: joints, position and tool frame.

Nothing is changed for it, so that a wrong model is refused before the controller is reset and its program is called.
"""

import math
from collections.abc import Generator
from typing import Any

from emulators.arm.chain import straight_tool
from hil_fanuc import rmi
from hil_fanuc.arms import FanucArm, from_pendant
from hil_fanuc.requests import Request, Requests
from protocol.geometry import Pose, angle_between, from_angles, inverse, product, rotate

FIT_M, FIT_RAD = 1e-3, 2e-3
"""Largest difference between reported pose and reported joints, m and rad. Chosen: above the rounding of float32 and
the tolerances of a calibrated arm's model.
"""


def read_misfit(requests: Requests, model: str) -> Generator[Request, Any, float]:
    """Return the distance of the reported face plate from that of the model with the reported joints, m, if position or
    orientation do not fit; 0 if they do, or if an answer lacks a value.
    """
    joints = yield from requests.line({"Command": "FRC_ReadJointAngles"})
    position = yield from requests.line({"Command": "FRC_ReadCartesianPosition"})
    numbers = position.get("Configuration")
    if not isinstance(numbers, dict):
        return 0.0
    tool_number, frame_number = (numbers.get(key) for key in ("UToolNumber", "UFrameNumber"))
    tool = yield from requests.line({"Command": "FRC_ReadUToolData", "ToolNumber": tool_number})
    frame: rmi.Message = {"Frame": dict.fromkeys("XYZWPR", 0.0)}
    if frame_number:
        frame = yield from requests.line({"Command": "FRC_ReadUFrameData", "FrameNumber": frame_number})
    angles = _values(joints.get("JointAngle"), ("J1", "J2", "J3", "J4", "J5", "J6"))
    tip, tool_pose, frame_pose = (
        _pose(section) for section in (position.get("Position"), tool.get("Frame"), frame.get("Frame"))
    )
    if angles is None or tip is None or tool_pose is None or frame_pose is None:
        return 0.0
    a, b, c, d, e, f = angles
    expected = FanucArm(model, straight_tool(0.0)).face_plate(from_pendant((a, b, c, d, e, f)))
    plate = _placed(_placed(frame_pose, tip), _inverted(tool_pose))
    apart = math.dist(plate.position, expected.position)
    fits = apart <= FIT_M and angle_between(plate.quaternion, expected.quaternion) <= FIT_RAD
    return 0.0 if fits else apart


def _values(section: Any, keys: tuple[str, ...]) -> tuple[float, ...] | None:
    """Return numbers of a section of an answer; None if one is missing."""
    if not isinstance(section, dict):
        return None
    values = [section.get(key) for key in keys]
    numbers = tuple(float(value) for value in values if isinstance(value, int | float))
    return numbers if len(numbers) == len(keys) and all(map(math.isfinite, numbers)) else None


def _pose(section: Any) -> Pose | None:
    values = _values(section, ("X", "Y", "Z", "W", "P", "R"))
    if values is None:
        return None
    x, y, z, w, p, r = values
    return Pose((x / 1e3, y / 1e3, z / 1e3), from_angles(r, p, w))


def _placed(base: Pose, pose: Pose) -> Pose:
    """Convert a pose from the frame `base` to that of `base`."""
    x, y, z = (a + b for a, b in zip(base.position, rotate(base.quaternion, pose.position), strict=True))
    return Pose((x, y, z), product(base.quaternion, pose.quaternion))


def _inverted(pose: Pose) -> Pose:
    back = inverse(pose.quaternion)
    x, y, z = rotate(back, pose.position)
    return Pose((-x, -y, -z), back)
