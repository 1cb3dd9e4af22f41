"""The set point of a controller that is guided: by poses, by joints, or along a path of its own with corrections."""

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
"""About the tool's z axis: with all joints at zero the tool's x axis points down, against that of the kinematics.
Derived: tool0 of ABB's arms has the orientation 0.707 0 0.707 0 there."""
_AT_HAND: Joints = (0.0,) * 6
_QUICK = 1e9
"""Speed of the arm's own interpolation, mm/s and degrees/s: it takes each set point as it is."""


class ArmJoints:
    """Joints of the emulated arm for poses of the tool, and back."""

    def __init__(self, profile: EgmProfile, tool_length: float) -> None:
        self._arm = Arm(profile.arm, tool_length)
        arm = profile.arm
        lengths = arm.upper_arm_mm, arm.elbow_offset_mm, arm.forearm_mm, arm.wrist_to_flange_mm
        self.reach = sum(lengths) * 1e-3 + tool_length
        """Farthest that the tool is from axis 2, m."""

    def holding(self, pose: Pose, near: Joints = _AT_HAND) -> Joints | None:
        """Return the joints nearest to others that hold a pose, rad; None where none do."""
        return self._arm.nearest(pose.position, product(pose.quaternion, _HALF_TURN), near)

    def pose(self, joints: Joints) -> Pose:
        """Where the tool is with these joints."""
        position, quaternion = self._arm.pose(joints)
        return Pose(position, product(quaternion, _HALF_TURN))


class GuidedMotion:
    """The set point, and how it continues from cycle to cycle.

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
        """The same of the joints, rad."""
        self.tool_limit_m_s = math.inf
        """Fastest that the tool is taken, m/s: reduced speed of the manual mode."""
        self.programmed_share = 1.0
        """The speed ratio, 0 … 1: share of the speed of the programmed path."""
        self.begin(0.0)

    # --- the run of the guidance

    def begin(self, now: float) -> None:
        """Begin the guidance, or begin it again, at the present set point."""
        self.begun_at = now
        self.start, self._start_joints = self.pose, self.joints
        self.moves = False
        """It moved in the last cycle."""
        self._law.rest()
        self._velocity: Axes = STILL
        self._corrected = [0.0, 0.0]
        self._gone = 0.0
        self.forget()

    def resume(self, now: float) -> None:
        """Continue the guidance after a stop, from standstill and with its ramp; the reference is kept [A]."""
        self.begun_at = now
        self.stand()

    def forget(self) -> None:
        """There is no reference."""
        self._reference: Pose | Joints | None = None
        self._ahead: Axes = STILL
        self._offset: Vector = (0.0, 0.0, 0.0)

    def holding(self, pose: Pose) -> Joints | None:
        """Return the joints nearest to the set point that hold a pose, rad; None where none do."""
        return self._kinematics.holding(pose, self.joints)

    @property
    def utilization_percent(self) -> float:
        """Speed that was asked for, in percent of the largest."""
        return self._law.utilization_percent

    def take(self, message: Answer) -> None:
        """Have this as the reference. A part that is missing leaves the place as it is, and the speed at zero [A]."""
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
        """Move the set point for one cycle. Words for what ends the guidance, empty for nothing."""
        step: Callable[[float], tuple[Pose, Joints | None]] = {
            "pose": self._by_pose,
            "joint": self._by_joint,
            "path": self._by_path,
        }[self._profile.mode]
        pose, joints = step(now - self.begun_at)
        return self._go(pose, joints)

    def brake(self, share: float) -> str:
        """Move on for one cycle with this share of the last speed of the guidance."""
        if share <= 0.0:
            self.stand()
            return ""
        pose, joints = self._moved(tuple(share * part for part in self._velocity))
        return self._go(pose, joints)

    def stand(self) -> None:
        """Move no more."""
        self.moves = False
        self._law.rest()
        self._velocity = STILL

    def go_back(self, origin: Pose, share: float) -> None:
        """Stand on the straight way from a pose to the start of the guidance, behind this share of it."""
        share = min(share, 1.0)
        x, y, z = (p + (q - p) * share for p, q in zip(origin.position, self.start.position, strict=True))
        pose = Pose((x, y, z), slerp(origin.quaternion, self.start.quaternion, share))
        self._go(pose, self.holding(pose))

    def converged(self) -> bool:
        """Whether the reference is there and inside the window of convergence."""
        if self._reference is None:
            return False
        degrees, error = math.radians(self._profile.conv_deg), self._error()
        if self._by_joints:
            return all(abs(part) <= degrees for part in error)
        metres, (x, y, z, u, v, w) = self._profile.conv_mm * 1e-3, error
        near = abs(x) <= metres and abs(y) <= metres and abs(z) <= metres
        return near and abs(u) <= degrees and abs(v) <= degrees and abs(w) <= degrees

    def _error(self) -> Axes:
        """From the set point to the reference."""
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
        way, most = math.dist(pose.position, self.pose.position), self.tool_limit_m_s * self._period
        if way <= most:
            return pose, joints
        self._velocity = tuple([part * most / way for part in self._velocity])
        return self._moved(self._velocity)

    _by_joint = _by_pose

    def _by_path(self, since: float) -> tuple[Pose, Joints | None]:
        """Along the programmed path, with the correction in the path frame: y = x cross tool z, z = x cross y [M]."""
        profile, (dx, dy, dz) = self._profile, self._profile.path_mm
        length = math.hypot(dx, dy, dz)
        tangent = (dx / length, dy / length, dz / length) if length else (1.0, 0.0, 0.0)
        speed = min(profile.path_speed_mm_s * self.programmed_share, self.tool_limit_m_s * 1e3)
        self._gone = min(self._gone + speed * self._period, length)
        y = _unit(_cross(tangent, tool_axis(self.start.quaternion)))
        z = _cross(tangent, y)
        most = profile.path_corr_mm_s * self._period
        for axis, wanted in enumerate(self._offset[1:]):
            self._corrected[axis] += max(-most, min(most, wanted - self._corrected[axis]))
        a, b, c = (
            p + (self._gone * t + self._corrected[0] * j + self._corrected[1] * k) * 1e-3
            for p, t, j, k in zip(self.start.position, tangent, y, z, strict=True)
        )
        pose = Pose((a, b, c), self.start.quaternion)
        return pose, self.holding(pose)

    def _moved(self, velocity: Axes) -> tuple[Pose, Joints | None]:
        """Return the set point after a cycle at this speed."""
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
        """Have this as the set point, unless it is out of bounds."""
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
                # quicker than the joint, as next to a singularity
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
    """Return the arm after the set point; the set point itself is delayed by one cycle."""
    arm = profile.arm
    return FollowedProfile(
        cycle_ms=profile.cycle_ms,
        transport_delay_ms=(arm.servo_delay_cycles - 1) * profile.cycle_ms,
        natural_frequency_rad_s=arm.natural_frequency_rad_s,
        damping_ratio=arm.damping_ratio,
        speed_mm_s=_QUICK,
        reorientation_deg_s=_QUICK,
    )
