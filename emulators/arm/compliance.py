"""Compliance of an arm: deflection of its tool under a force, from the stiffness of its joints. Sensor and tool add
theirs.

The links are rigid, and each joint is a torsional spring. With the Jacobian J of the tool and the joint stiffness
K, the deflection is J K⁻¹ Jᵀ times the wrench on the tool (Dumas et al., Robotics and Computer-Integrated
Manufacturing 27, 2011). The Jacobian is a difference quotient of the robot's own forward kinematics.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from emulators.arm.compliant_path import Bearing
from emulators.arm.end_compliance import RIGID_END, EndCompliance
from emulators.arm.mode import Mode
from emulators.seams import ArticulatedRobot, EmulatedRobot, Floats, Joints
from emulators.tool import rotation_matrix
from protocol.arm_size import PerAxis
from protocol.geometry import Pose, Vector, inverse, product, rotate
from protocol.marks import Mark, SettingError, above, between, check_settings, setting

_STEP_RAD = 1e-5
"""Step of the difference quotients, rad. Chosen: their error is below a millionth of the arm's length."""
_UNKNOWN_MODE = Mode(15.0, 0.03)
"""Mode of a robot without a model of its joints. Assumed: as of the robots of this package."""


@dataclass(frozen=True, slots=True)
class ArmProfile:
    """Compliance of the arm, and the mode in which its tool oscillates."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    compliance: Literal["rigid", "joints", "cartesian"] | None = setting(
        None,
        Mark.CHOSEN,
        "rigid, or compliant by its joints' stiffness, or by a measured Cartesian stiffness; by default joints, or "
        "rigid for a robot without a model of its joints",
    )
    joint_stiffness_nm_rad: PerAxis | None = setting(
        None,
        Mark.DERIVED,
        "stiffness of the joints, axis 1 first; by default that of the robot's model",
        unit="N·m/rad",
    )
    stiffness_n_m: tuple[float, float, float, float, float, float] = setting(
        (30e3, 30e3, 30e3, 0.0, 0.0, 0.0),
        Mark.ASSUMED,
        "measured Cartesian stiffness at the tool in the base frame: xx, yy, zz, xy, xz, yz",
        unit="N/m",
    )
    frequency_hz: float | None = setting(
        None,
        Mark.DERIVED,
        "natural frequency of the tool on the arm, without contact; by default that of the robot's model",
        between(1.0, 200.0),
        unit="Hz",
    )
    damping_ratio: float | None = setting(
        None, Mark.DERIVED, "damping of that mode; by default that of the robot's model", above(0.0, 0.9)
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if not all(value > 0.0 for value in self.joint_stiffness_nm_rad or ()):
            raise SettingError("joint_stiffness_nm_rad", "must be more than 0 for each joint")
        if np.linalg.eigvalsh(symmetric(self.stiffness_n_m))[0] <= 0.0:
            raise SettingError("stiffness_n_m", "must be a positive definite matrix")


def is_rigid(arm: ArmProfile, robot: object) -> bool:
    """Return whether the arm of this robot is rigid."""
    if arm.compliance is None:
        return not isinstance(robot, ArticulatedRobot)
    return arm.compliance == "rigid"


def symmetric(parts: tuple[float, ...]) -> Floats:
    """Return the symmetric matrix (3, 3) with the elements xx, yy, zz, xy, xz, yz."""
    a, b, c, d, e, f = parts
    return np.array([[a, d, e], [d, b, f], [e, f, c]])


def jacobian(robot: ArticulatedRobot, joints: Joints) -> Floats:
    """Return the Jacobian (6, 6) of the tool in the base frame, m/rad and rad/rad, at joint angles (6,), rad."""
    columns = []
    for axis in range(len(joints)):
        before, after = (robot.tool_pose_at(_turned(joints, axis, step)) for step in (-_STEP_RAD, _STEP_RAD))
        columns.append(_difference(before, after) / (2.0 * _STEP_RAD))
    return np.array(columns).T


def _turned(joints: Joints, axis: int, angle: float) -> PerAxis:
    """Return the joint angles with one of them changed by an angle, rad."""
    a, b, c, d, e, f = (q + (angle if k == axis else 0.0) for k, q in enumerate(joints))
    return a, b, c, d, e, f


def _difference(before: Pose, after: Pose) -> Floats:
    """Return the small displacement (6,) from one pose to another, base frame: translation, m, and rotation vector,
    rad.
    """
    w, x, y, z = product(after.quaternion, inverse(before.quaternion))
    sign = 2.0 if w >= 0.0 else -2.0
    moved = np.subtract(after.position, before.position)
    return np.array([*moved, sign * x, sign * y, sign * z])


def joint_compliance(robot: ArticulatedRobot, joints: Joints, stiffness: Joints) -> Floats:
    """Return the compliance (6, 6) of the tool in the base frame.

    It maps the wrench on the tool about its tip, N and N·m, to translation, m, and rotation, rad. `stiffness` is
    the stiffness of the joints, N·m/rad.
    """
    columns = jacobian(robot, joints)
    compliance: Floats = (columns / np.array(stiffness)) @ columns.T
    return compliance


class Load(NamedTuple):
    """Load that the arm carries."""

    mass: float
    """Mass, kg."""
    centre: Vector
    """Position of the centre of gravity relative to the tool centre point, tool frame, m."""


def bearing_of(
    arm: ArmProfile, robot: EmulatedRobot, load: Load, end: EndCompliance = RIGID_END
) -> Callable[[float], Bearing]:
    """Return a function that maps the time, s, to the bearing of the tool of a compliant arm.

    Raises ValueError if the joints' compliance is configured and the robot has no model of its joints.
    """
    if arm.compliance == "cartesian":
        cartesian = np.zeros((6, 6))
        cartesian[:3, :3] = np.linalg.inv(symmetric(arm.stiffness_n_m))
        return lambda time: _bearing(cartesian, _rigid_pose(robot, time), load, end)
    articulated: object = robot
    if not isinstance(articulated, ArticulatedRobot):
        raise ValueError(
            'cell.arm.compliance is "joints", but this robot has no model of its joints; set it to "cartesian"'
        )
    stiffness = arm.joint_stiffness_nm_rad or articulated.joint_stiffness
    return _bearing_by_joints(robot, articulated, stiffness, load, end)


def _bearing_by_joints(
    robot: EmulatedRobot, articulated: ArticulatedRobot, stiffness: Joints, load: Load, end: EndCompliance
) -> Callable[[float], Bearing]:
    """Return a function that maps the time, s, to the bearing by the stiffness of the joints, N·m/rad.

    `robot` and `articulated` are the same robot. Where no joints hold its pose, beyond the edge of its work area, the
    last joints remain.
    """
    arm = np.zeros((6, 6))

    def bearing(time: float) -> Bearing:
        nonlocal arm
        pose = _rigid_pose(robot, time)
        joints = robot.joints_holding(pose, time)
        if joints is not None:
            arm = joint_compliance(articulated, joints, stiffness)
        return _bearing(arm, pose, load, end)

    return bearing


def mode_of(arm: ArmProfile, robot: object) -> Mode:
    """Return the mode of a robot's tool; the settings take precedence over the robot's model."""
    frequency, damping = robot.mode if isinstance(robot, ArticulatedRobot) else _UNKNOWN_MODE
    return Mode(arm.frequency_hz or frequency, arm.damping_ratio or damping)


def _rigid_pose(robot: EmulatedRobot, time: float) -> Pose:
    """Return the pose that the tool of a rigid arm would have."""
    at = np.array([time])
    x, y, z = robot.path.trajectory(at)[0][0].tolist()
    return Pose((x, y, z), robot.path.orientations(at)[0][1])


def _bearing(arm: Floats, pose: Pose, load: Load, end: EndCompliance) -> Bearing:
    """Return the bearing: the total compliance, and the deflection of arm and sensor under the weight.

    `arm` is the compliance of the arm (6, 6) in the base frame.
    """
    weight = np.array([0.0, 0.0, -9.80665 * load.mass])
    lever = rotate(pose.quaternion, load.centre)
    turn = np.kron(np.eye(2), rotation_matrix(pose.quaternion))
    carrying = arm + turn @ end.sensor @ turn.T
    return Bearing(
        carrying + turn @ end.tool @ turn.T, carrying @ np.concatenate((weight, np.cross(lever, weight)))
    )
