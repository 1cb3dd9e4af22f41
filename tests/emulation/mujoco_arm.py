"""Arm in MuJoCo, an independent model of the compliant arm: hinges in series, with a spring and damper at each joint.

Shared with `emulators.arm` are the forward kinematics, off which the hinges are read, the stiffness of the joints, and
frequency and damping of the mode. The position that the encoders measure is the zero of a spring, so the links follow
the encoders' path through the springs. Gravity acts on the tool only: a controller compensates for the weight of its
links. The sensor is rigid.

The inertia is either at the joints or in links:

- Each inertia at a joint is its stiffness divided by the square of the mode's angular frequency. Every mode then has
  this frequency, and the effective mass at the tip is (ω² C)⁻¹ with the compliance C, as in `emulators.arm`.
- The links are rods of published mass, and the tool has its mass. Frequencies and effective mass follow from them. The
  damping of a mode is proportional to its frequency.

The contact force is computed here and applied to the tip, because only then it is the emulated surface's law: MuJoCo
divides a contact's stiffness by an estimate of the inertia, and its friction grows linearly up to the cone.
"""

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import pytest
from scipy.linalg import eigvalsh

from emulators.arm.compliance import Load
from emulators.arm.compliant_path import Mode
from emulators.seams import ArticulatedRobot, Floats
from emulators.surface.contact import SurfaceProfile
from protocol.arm_size import PerAxis
from protocol.geometry import inverse, product, rotation_rows, rotation_vector

mujoco: Any = pytest.importorskip("mujoco")

PointForce: TypeAlias = Callable[[Floats, Floats], Floats]
"""Function that returns the force on the tip, N, for its position, m, and its velocity, m/s; base frame."""

_STEP_S = 1e-4
"""Time step, s. Chosen: a quarter of it changes no force by more than 0.5 % of the held force."""
_SETTLING_S = 0.5
_RADIUS_M = 0.05
"""Radius of the links, m. Chosen: half of it or twice it changes the first mode by less than 2 %."""
_ABB_MASSES: PerAxis = (192.0, 26.5, 25.7, 29.7, 2.8, 0.8)
LINK_MASSES: Mapping[str, PerAxis] = {
    "s3": _ABB_MASSES,
    "egm": _ABB_MASSES,
    "rsi": _ABB_MASSES,
    "rtde": (7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
}
"""Mass of the links by robot, kg. Of an IRB 2400 (Obal and Gierlak, Acta Mechanica et Automatica 2025, doi
10.2478/ama-2025-0064), assumed for the other arms of its class, and of a UR10e (Universal Robots, Parameters for
calculations of kinematics and dynamics).
"""
_NO_MASS = 'mass="1e-9" diaginertia="1e-12 1e-12 1e-12"'
"""Inertia of a body whose inertia is elsewhere. MuJoCo accepts no body without mass."""


def six(values: Floats) -> PerAxis:
    """Return an array of six numbers as a tuple."""
    a, b, c, d, e, f = values.tolist()
    return a, b, c, d, e, f


def spring_and_friction(surface: SurfaceProfile) -> PointForce:
    """Return the force of a level, linear surface: spring and damper that never pull, and smoothed Coulomb friction."""
    height, smoothing = surface.height_mm * 1e-3, surface.friction_smoothing_mm_s * 1e-3

    def force(position: Floats, velocity: Floats) -> Floats:
        (x, y, z), depth = velocity.tolist(), height - float(position[2])
        if depth <= 0.0:
            return np.zeros(3)
        normal = max(surface.stiffness_n_m * depth - surface.damping_ns_m * z, 0.0)
        friction = -surface.friction * normal / math.sqrt(x * x + y * y + smoothing * smoothing)
        return np.array([friction * x, friction * y, normal])

    return force


class MujocoArm:
    """Arm of a robot in MuJoCo, with the tool as a load. Arrays are in the base frame."""

    def __init__(
        self, robot: ArticulatedRobot, mode: Mode, load: Load, masses: PerAxis | None = None
    ) -> None:
        """Create the arm. The inertia is at the joints, or in links of these masses, kg."""
        self._stiffness, self._coupling = np.array(robot.joint_stiffness), coupling(robot)
        self._hinge_angles = np.linalg.inv(self._coupling)
        self._mode, self._load, self._masses = mode, load, masses
        self._model = mujoco.MjModel.from_xml_string(self._description(robot))
        self._data = mujoco.MjData(self._model)
        self._tip, weighed = (self._model.body(name).id for name in ("tip", "load"))
        self._data.xfrc_applied[weighed, 2] = -9.80665 * load.mass

    def _description(self, robot: ArticulatedRobot) -> str:
        """Return the model as MJCF. With all hinges at zero, the frame of each link is the base frame."""
        start, mode = robot.tool_pose_at(six(np.zeros(6))), self._mode
        point, bodies = np.zeros(3), ""
        omega, ends = 2.0 * math.pi * mode.frequency_hz, [*hinges(robot), (np.array(start.position), None)]
        for number, ((on_axis, axis), (on_next, next_axis)) in enumerate(pairwise(ends)):
            point = _nearest_point(point, on_axis, axis)
            end = _nearest_point(point, on_next, next_axis)
            bodies += f'<body><joint name="{number}" pos="{_text(on_axis)}" axis="{_text(axis)}"/>'
            bodies += _link(point, end, None if self._masses is None else self._masses[number])
        inertia = f'mass="{self._load.mass}" diaginertia="1e-4 1e-4 1e-4"' if self._masses else _NO_MASS
        bodies += f'<body name="tip" pos="{_text(start.position)}" quat="{_text(start.quaternion)}">'
        bodies += f'<inertial pos="0 0 0" {_NO_MASS}/><body name="load" pos="{_text(self._load.centre)}">'
        bodies += f'<inertial pos="0 0 0" {inertia}/></body></body>' + "</body>" * 6
        joints = springs = dampers = ""
        for number, (stiffness, row) in enumerate(zip(self._stiffness, self._coupling, strict=True)):
            armature = 0.0 if self._masses else stiffness / omega**2
            parts = "".join(f'<joint joint="{k}" coef="{share}"/>' for k, share in enumerate(row) if share)
            joints += f'<fixed name="{number}" armature="{armature}">{parts}</fixed>'
            springs += f'<position tendon="{number}" kp="{stiffness}"/>'
            dampers += f'<velocity tendon="{number}" kv="{2.0 * mode.damping_ratio * stiffness / omega}"/>'
        return (
            f'<mujoco><option timestep="{_STEP_S}" integrator="implicitfast" gravity="0 0 0"/>'
            f"<worldbody>{bodies}</worldbody><tendon>{joints}</tendon><actuator>{springs}{dampers}</actuator></mujoco>"
        )

    def place(self, joints: Floats) -> tuple[Floats, Floats]:
        """Put the links and the encoders at joint angles (6,), rad. Return position and rotation matrix of the tip."""
        self._data.qpos[:], self._data.qvel[:] = self._hinge_angles @ joints, 0.0
        self._data.ctrl[:] = [*joints, *np.zeros(6)]
        mujoco.mj_forward(self._model, self._data)
        return self.tip

    @property
    def tip(self) -> tuple[Floats, Floats]:
        """Position (3,), m, and rotation matrix (3, 3) of the tip."""
        return self._data.xpos[self._tip].copy(), self._data.xmat[self._tip].reshape(3, 3).copy()

    def frequencies(self, joints: Floats) -> Floats:
        """Return the natural frequencies (6,) without contact at joint angles (6,), rad, in ascending order, Hz."""
        self.place(joints)
        inertia = np.zeros((6, 6))
        for row, unit in zip(inertia, np.eye(6), strict=True):
            mujoco.mj_mulM(self._model, self._data, row, unit)
        stiffness = self._coupling.T * self._stiffness @ self._coupling
        frequencies: Floats = np.sqrt(eigvalsh(stiffness, inertia)) / (2.0 * math.pi)
        return frequencies

    def settle(self, joints: Floats, wrench: Floats) -> tuple[Floats, Floats]:
        """Return position and rotation matrix of the tip in equilibrium, under a wrench (6,) about the tip."""
        self.place(joints)
        self._data.xfrc_applied[self._tip] = wrench
        keeps = 1.0 - 4.0 * math.pi * self._mode.frequency_hz * _STEP_S  # nearly critical damping
        for _ in range(round(_SETTLING_S / _STEP_S)):
            mujoco.mj_step(self._model, self._data)
            self._data.qvel[:] *= keeps
        return self.tip

    def follow(self, joints: Floats, period: float, force: PointForce) -> tuple[Floats, Floats]:
        """Let the encoders follow joint angles (n, 6), rad, one per period, s, from the equilibrium without contact.

        Return positions of the tip, m, and forces on it, N, both (n, 3).
        """
        model, data, tip, speed = self._model, self._data, self._tip, np.zeros(6)
        self.settle(joints[0], np.zeros(6))
        data.qvel[:] = 0.0
        rates = np.diff(joints, axis=0, append=joints[-1:]) / period
        positions, forces = np.empty((len(joints), 3)), np.empty((len(joints), 3))
        for row, (angles, rate) in enumerate(zip(joints, rates, strict=True)):
            data.ctrl[6:] = rate
            for step in range(round(period / _STEP_S)):
                data.ctrl[:6] = angles + rate * (step * _STEP_S)
                mujoco.mj_step1(model, data)
                mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, tip, speed, 0)
                data.xfrc_applied[tip, :3] = force(data.xpos[tip], speed[3:])
                if not step:
                    positions[row], forces[row] = data.xpos[tip], data.xfrc_applied[tip, :3]
                mujoco.mj_step2(model, data)
        return positions, forces


def coupling(robot: ArticulatedRobot) -> Floats:
    """Return the matrix (6, 6) that maps the angles of the hinges to the angles of the joints.

    Both are equal, unless a linkage keeps the forearm level while axis 2 turns. The angle of axis 3 is then the sum
    of two hinges' angles.
    """
    start, turned = (robot.tool_pose_at((0.0, angle, 0.0, 0.0, 0.0, 0.0)) for angle in (0.0, 1.0))
    matrix = np.eye(6)
    if np.allclose(start.quaternion, turned.quaternion):
        matrix[2, 1] = 1.0
    return matrix


def hinges(robot: ArticulatedRobot) -> list[tuple[Floats, Floats]]:
    """Return a point on the axis of each hinge, m, and the unit vector of the axis, with all hinges at zero.

    Fails unless the tool turns about this axis by the angle of the hinge.
    """
    start, axes = robot.tool_pose_at(six(np.zeros(6))), []
    for turn in coupling(robot).T:
        pose = robot.tool_pose_at(six(turn))  # turned by 1 rad
        rotation = product(pose.quaternion, inverse(start.quaternion))
        axis, matrix = np.array(rotation_vector(rotation)), np.array(rotation_rows(rotation))
        shift = np.array(pose.position) - matrix @ start.position
        assert math.isclose(float(axis @ axis), 1.0), "the tool turns by another angle"
        assert abs(float(axis @ shift)) < 1e-9, "the tool moves along the axis"
        axes.append((np.linalg.pinv(np.eye(3) - matrix) @ shift, axis))
    return axes


def _nearest_point(point: Floats, on_axis: Floats, axis: Floats | None) -> Floats:
    """Return the point of an axis that is nearest to a point; without an axis, the point itself."""
    return on_axis if axis is None else on_axis + axis * float(axis @ (point - on_axis))


def _link(begin: Floats, end: Floats, mass: float | None) -> str:
    """Return a link between two points as MJCF: a rod with round ends, or a ball if the points coincide."""
    if mass is None:
        return f'<inertial pos="0 0 0" {_NO_MASS}/>'
    shape = f'type="capsule" fromto="{_text(begin)} {_text(end)}"'
    if np.allclose(begin, end):
        shape = f'type="sphere" pos="{_text(begin)}"'
    return f'<geom {shape} size="{_RADIUS_M}" mass="{mass}" contype="0" conaffinity="0"/>'


def _text(numbers: Any) -> str:
    return " ".join(f"{number:.15g}" for number in numbers)
