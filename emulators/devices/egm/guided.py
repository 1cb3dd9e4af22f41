"""Set point of a guided controller: guided by poses or joints, or moved along a programmed path with corrections."""

import math
from collections.abc import Callable

from emulators.arm.followed import FollowedProfile
from emulators.devices.egm.law import STILL, Axes, MotionLaw, joint_load, pose_load
from emulators.devices.egm.profile import EgmProfile
from emulators.devices.egm.state import OUT_OF_BOUNDS
from protocol.devices.egm import Answer, PathCorrection, SensorMessage, from_wire
from protocol.geometry import (
    Pose,
    Quaternion,
    Vector,
    normalise,
    product,
    rotation_vector,
    slerp,
    tool_axis,
    turn_between,
    turn_by,
)
from protocol.kinematics import Arm, Joints

_HALF_TURN: Quaternion = (0.0, 0.0, 0.0, 1.0)
"""Rotation by half a turn about the tool's z axis. With all joints at zero, the tool's x axis points down, opposite
to the x axis of the kinematics. Derived: tool0 of ABB's arms has the orientation 0.707 0 0.707 0 at these joints.
"""
_AT_HAND: Joints = (0.0,) * 6
_QUICK = 1e9
"""Speed limits of the arm's own interpolation, mm/s and degrees/s, so high that it takes each set point unchanged."""


class ArmJoints:
    """Kinematics of the emulated arm."""

    def __init__(self, profile: EgmProfile, tool_length: float) -> None:
        self._arm = Arm(profile.arm, tool_length)
        arm = profile.arm
        lengths = arm.upper_arm_mm, arm.elbow_offset_mm, arm.forearm_mm, arm.wrist_to_flange_mm
        self.reach = sum(lengths) * 1e-3 + tool_length
        """Largest distance of the tool from axis 2, m."""

    def holding(self, pose: Pose, near: Joints = _AT_HAND) -> Joints | None:
        """Return the joints that hold a pose and are nearest to the given ones, rad; None if there is no solution."""
        return self._arm.nearest(pose.position, product(pose.quaternion, _HALF_TURN), near)

    def pose(self, joints: Joints) -> Pose:
        """Return the pose of the tool at these joints."""
        position, quaternion = self._arm.pose(joints)
        return Pose(position, product(quaternion, _HALF_TURN))


class GuidedMotion:
    """Set point, and its motion from cycle to cycle.

    Raises ValueError for a start that the arm cannot hold.
    """

    def __init__(self, profile: EgmProfile, start: Pose, joints: ArmJoints) -> None:
        self._profile, self._kinematics = profile, joints
        self._period = profile.cycle_ms * 1e-3
        self._by_joints = profile.mode == "joint"
        self._quickest = [math.radians(speed) * self._period for speed in profile.arm.axis_speeds_deg_s]
        self._law = MotionLaw(profile, (joint_load if self._by_joints else pose_load)(profile))
        at_start = joints.holding(start)
        if at_start is None:
            raise ValueError(
                f"no joints of the arm hold the start pose; change start_position_mm, start_quaternion or the arm of "
                f"cell.egm.arm (tool at {', '.join(f'{p * 1e3:g}' for p in start.position)} mm)"
            )
        self.pose = start
        """Set point of the controller."""
        self.joints: Joints = at_start
        """Set point of the joints, rad."""
        self.tool_limit_m_s = math.inf
        """Speed limit of the tool, m/s: reduced speed of the manual mode."""
        self.programmed_share = 1.0
        """Programmed speed of the path, as a share of the full speed, 0 … 1: the speed ratio."""
        self.begin(0.0)

    # --- the run of the guidance

    def begin(self, now: float) -> None:
        """Begin or restart the guidance at the current set point."""
        self.begun_at = now
        self.start, self._start_joints = self.pose, self.joints
        self.moves = False
        """Whether the set point moved in the last cycle."""
        self._law.rest()
        self._velocity: Axes = STILL
        self._corrected = [0.0, 0.0]
        self._path_mm = 0.0
        self.forget()

    def resume(self, now: float) -> None:
        """Continue the guidance after a stop, from standstill and with a new ramp. The reference is kept [A]."""
        self.begun_at = now
        self.halt()

    def forget(self) -> None:
        """Discard the reference."""
        self._reference: Pose | Joints | None = None
        self._ahead: Axes = STILL
        self._offset: Vector = (0.0, 0.0, 0.0)

    def holding(self, pose: Pose) -> Joints | None:
        """Return the joints that hold a pose and are nearest to the set point, rad; None if there is no solution."""
        return self._kinematics.holding(pose, self.joints)

    @property
    def utilization_percent(self) -> float:
        """Requested speed, in percent of the maximum speed."""
        return self._law.utilization_percent

    def take(self, message: Answer) -> None:
        """Set the reference. A missing position leaves the position unchanged; a missing speed is zero [A]."""
        if isinstance(message, PathCorrection):
            self._offset = message.offset_mm
            return
        assert isinstance(message, SensorMessage)
        if self._by_joints:
            if message.joints_deg:
                a, b, c, d, e, f = map(math.radians, message.joints_deg)
                self._reference = a, b, c, d, e, f
            speed = tuple(map(math.radians, message.joint_speed_deg_s))
        else:
            if message.pose is not None:
                position, quaternion = from_wire(message.pose)
                self._reference = Pose(position, normalise(quaternion))
            along = tuple([part * 1e-3 for part in message.speed[:3]])
            about = tuple(map(math.radians, message.speed[3:])) or STILL[:3]
            speed = (*along, *about) if along else ()
        if speed or not self._profile.speed_ref_sticky:
            self._ahead = speed or STILL

    # --- one cycle

    def guide(self, now: float) -> str:
        """Move the set point for one cycle. Return the text of an error that ends the guidance, or an empty string
        if there is none.
        """
        step: Callable[[float], tuple[Pose, Joints | None]] = {
            "pose": self._by_pose,
            "joint": self._by_joint,
            "path": self._by_path,
        }[self._profile.mode]
        pose, joints = step(now - self.begun_at)
        return self._go(pose, joints)

    def brake(self, share: float) -> str:
        """Move for one cycle at this share of the last guided speed."""
        if share <= 0.0:
            self.halt()
            return ""
        pose, joints = self._moved(tuple(share * part for part in self._velocity))
        return self._go(pose, joints)

    def halt(self) -> None:
        """Stop moving."""
        self.moves = False
        self._law.rest()
        self._velocity = STILL

    def return_to_start(self, origin: Pose, share: float) -> None:
        """Move the set point to this fraction of the straight line from a pose to the start of the guidance."""
        share = min(share, 1.0)
        x, y, z = (p + (q - p) * share for p, q in zip(origin.position, self.start.position, strict=True))
        pose = Pose((x, y, z), slerp(origin.quaternion, self.start.quaternion, share))
        self._go(pose, self.holding(pose))

    def converged(self) -> bool:
        """Return whether there is a reference and the set point is within the convergence limits around it."""
        if self._reference is None:
            return False
        degrees, error = math.radians(self._profile.conv_deg), self._error()
        if self._by_joints:
            return all(abs(part) <= degrees for part in error)
        metres, (x, y, z, u, v, w) = self._profile.conv_mm * 1e-3, error
        near = abs(x) <= metres and abs(y) <= metres and abs(z) <= metres
        return near and abs(u) <= degrees and abs(v) <= degrees and abs(w) <= degrees

    def _error(self) -> Axes:
        """Return the difference from the set point to the reference."""
        reference = self._reference
        if reference is None:
            return STILL
        if isinstance(reference, Pose):
            (x, y, z), (a, b, c) = self.pose.position, reference.position
            return (
                a - x,
                b - y,
                c - z,
                *rotation_vector(turn_between(self.pose.quaternion, reference.quaternion)),
            )
        return tuple([q - p for p, q in zip(self.joints, reference, strict=True)])

    def _by_pose(self, since: float) -> tuple[Pose, Joints | None]:
        self._velocity = self._law.speed(self._error(), self._ahead, since)
        pose, joints = self._moved(self._velocity)
        distance, most = math.dist(pose.position, self.pose.position), self.tool_limit_m_s * self._period
        if distance <= most:
            return pose, joints
        self._velocity = tuple([part * most / distance for part in self._velocity])
        return self._moved(self._velocity)

    _by_joint = _by_pose

    def _by_path(self, since: float) -> tuple[Pose, Joints | None]:
        """Move along the programmed path, with the correction in the path frame: y = x cross tool z, z = x cross y
        [M].
        """
        profile, (dx, dy, dz) = self._profile, self._profile.path_mm
        length = math.hypot(dx, dy, dz)
        tangent = (dx / length, dy / length, dz / length) if length else (1.0, 0.0, 0.0)
        speed = min(profile.path_speed_mm_s * self.programmed_share, self.tool_limit_m_s * 1e3)
        self._path_mm = min(self._path_mm + speed * self._period, length)
        y = _unit(_cross(tangent, tool_axis(self.start.quaternion)))
        z = _cross(tangent, y)
        most = profile.path_corr_mm_s * self._period
        for axis, target in enumerate(self._offset[1:]):
            self._corrected[axis] += max(-most, min(most, target - self._corrected[axis]))
        a, b, c = (
            p + (self._path_mm * t + self._corrected[0] * j + self._corrected[1] * k) * 1e-3
            for p, t, j, k in zip(self.start.position, tangent, y, z, strict=True)
        )
        pose = Pose((a, b, c), self.start.quaternion)
        return pose, self.holding(pose)

    def _moved(self, velocity: Axes) -> tuple[Pose, Joints | None]:
        """Return the set point after one cycle at this speed."""
        if velocity == STILL:
            return self.pose, self.joints
        by = tuple([part * self._period for part in velocity])
        if self._by_joints:
            a, b, c, d, e, f = (joint + part for joint, part in zip(self.joints, by, strict=True))
            joints = a, b, c, d, e, f
            return self._kinematics.pose(joints), joints
        (x, y, z), (dx, dy, dz, *turn) = self.pose.position, by
        x, y, z = x + dx, y + dy, z + dz
        if self._profile.minmax_clamps:
            window = self._profile.conv_mm * 1e-3
            x, y, z = (
                max(s - window, min(s + window, p))
                for p, s in zip((x, y, z), self.start.position, strict=True)
            )
        pose = Pose((x, y, z), normalise(product(turn_by(turn), self.pose.quaternion)))
        return pose, self.holding(pose)

    def _go(self, pose: Pose, joints: Joints | None) -> str:
        """Change the set point, unless the new one is out of bounds."""
        profile = self._profile
        for low, place, high in zip(
            profile.workspace_min_mm, pose.position, profile.workspace_max_mm, strict=True
        ):
            if not low <= place * 1e3 <= high:
                return OUT_OF_BOUNDS
        if joints is None:
            return OUT_OF_BOUNDS
        if joints is not self.joints:
            most = math.radians(profile.max_pos_dev_deg)
            for start, before, after, quickest in zip(
                self._start_joints, self.joints, joints, self._quickest, strict=True
            ):
                # faster than the joint can move, for example near a singularity
                if abs(after - start) > most or abs(after - before) > quickest:
                    return OUT_OF_BOUNDS
        self.moves = pose != self.pose
        self.pose, self.joints = pose, joints
        return ""


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(v: Vector) -> Vector:
    length = math.hypot(*v) or 1.0
    return v[0] / length, v[1] / length, v[2] / length


def mechanics(profile: EgmProfile) -> FollowedProfile:
    """Return the settings of the arm that follows the set point. The set point itself is delayed by one cycle."""
    arm = profile.arm
    return FollowedProfile(
        cycle_ms=profile.cycle_ms,
        transport_delay_ms=(arm.servo_delay_cycles - 1) * profile.cycle_ms,
        natural_frequency_rad_s=arm.natural_frequency_rad_s,
        damping_ratio=arm.damping_ratio,
        speed_mm_s=_QUICK,
        reorientation_deg_s=_QUICK,
    )
