"""Arm of an emulated controller with its tool: kinematics, drives and encoders, simulated in cycles."""

import math

from emulators.devices.rtde.arm import ZERO, Hold, JointArm, Order, Place, Servo
from emulators.devices.rtde.compliance import TOO_FAST
from emulators.devices.rtde.drives import ArmSensors, Drives
from emulators.devices.rtde.kinematics import (
    ARMS,
    RANGE,
    USUAL,
    Joints,
    ToolPoses,
    compose,
    flange,
    invert,
    nearest,
)
from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.targets import problem_of_start, problem_of_target
from emulators.seams import StartPose
from protocol.geometry import Pose, Quaternion, normalise


class Manipulator:
    """Commanded, actual and measured joints of an arm."""

    def __init__(self, profile: RtdeProfile, start: StartPose, seed: int) -> None:
        """Create the arm. Raises ValueError for a start that the arm cannot hold."""
        self._profile = profile
        self.lengths = ARMS[profile.model]
        self.tool = Pose((0.0, 0.0, start.tool_length), (1.0, 0.0, 0.0, 0.0))
        """Actual tool in the flange frame."""
        self.tcp = self.tool
        """Tool as configured in the controller, in the flange frame."""
        pose = Pose(start.position, normalise(start.quaternion))
        joints = nearest(self.lengths, compose(pose, invert(self.tool)), USUAL)
        if joints is None:
            raise ValueError(problem_of_start(profile.model, pose, self.tool))
        self.period = profile.cycle_ms / 1000.0
        self.arm = JointArm(joints, self.period, profile.servo_gain_scale, profile.stop_deceleration_rad_s2)
        self._drives, self.sensors = Drives(profile, joints, seed), ArmSensors(profile, seed)
        self.joints, self.speeds = self.sensors.read(joints, 0), ZERO
        """Measured joint angles and speeds at the start of this cycle, rad and rad/s."""
        self.speeds_before = ZERO
        """Joint speeds commanded in the previous cycle, rad/s."""
        self._servo_target = joints
        self._flange = self._old_flange = self._next_flange = flange(self.lengths, joints)
        self._at = ToolPoses().at

    # --- one cycle

    def begin_cycle(self, number: int) -> None:
        """Read the encoders."""
        self._old_flange, self._flange = self._flange, self._next_flange
        self.joints = self.sensors.read(self._drives.joints, number)
        self.speeds = self.sensors.read_speeds(self._drives.speeds, number)
        self.speeds_before = self.arm.motion

    def end_cycle(self) -> Pose:
        """Let the drives follow the arm's target. Return the true pose of the tool at the end of the cycle."""
        joints = self._drives.step(self.arm.joints, isinstance(self.arm.order, Hold))
        self._next_flange = flange(self.lengths, joints)
        return self._at(self._next_flange, self.tool)

    def take(self, order: Order) -> str:
        """Accept an order for this cycle.

        Return an empty string, or the reason of a protective stop that occurs instead of the order.
        """
        if isinstance(order, Servo) and order.target != self._servo_target:
            old = self._servo_target if isinstance(self.arm.order, Servo) else self.arm.joints
            if problem := problem_of_target(self._profile, self.lengths, old, order.target):
                return problem
            self._servo_target = order.target
        if isinstance(order, Place) and not max(map(abs, order.target)) <= RANGE:
            return "a move beyond the end of a joint's range"
        self.arm.take(order)
        return ""

    def problem_of_speed(self) -> str:
        """Return the reason of a protective stop because of the arm's speed, or an empty string."""
        distance = math.dist(self._flange.position, self._old_flange.position)
        if max(map(abs, self.arm.motion)) > self._profile.max_joint_speed_rad_s:
            return TOO_FAST
        return (
            "the tool is too fast" if distance > self._profile.max_tcp_speed_mm_s * 1e-3 * self.period else ""
        )

    def problem_of_range(self) -> str:
        """Return the reason of a protective stop because of the joint range, or an empty string."""
        return "a joint is at the end of its range" if max(map(abs, self.arm.joints)) > RANGE else ""

    @property
    def still(self) -> bool:
        """Whether the arm is stationary."""
        return self.arm.still or self.arm.speeds == ZERO

    # --- kinematics

    @property
    def turn(self) -> Quaternion:
        """True orientation of the flange."""
        return self._flange.quaternion

    @property
    def tool_pose(self) -> Pose:
        """True pose of the tool."""
        return self._at(self._flange, self.tool)

    @property
    def tcp_pose(self) -> Pose:
        """True pose of the controller's tool."""
        return self._at(self._flange, self.tcp)

    def solve(self, pose: Pose, near: Joints | None = None) -> Joints | None:
        """Return joint angles that hold the controller's tool in a pose; None if there is no solution."""
        return nearest(self.lengths, compose(pose, invert(self.tcp)), near or self.arm.target)

    def joints_holding(self, pose: Pose) -> Joints | None:
        """Return joint angles that hold the true tool in a pose; None if there is no solution."""
        return nearest(self.lengths, compose(pose, invert(self.tool)), self.arm.joints)

    def forward(self, joints: Joints, tcp: Pose | None = None) -> Pose:
        """Return the pose of the controller's tool at these joint angles."""
        return compose(flange(self.lengths, joints), tcp or self.tcp)
