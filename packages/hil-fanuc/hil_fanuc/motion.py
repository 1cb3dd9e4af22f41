"""Arm of the emulated controller: set points of the joints, their delay, position loops, and the path of the tool."""

from collections.abc import Callable
from enum import Enum, auto

from emulators.arm.chain import straight_tool
from emulators.arm.cycled import CycledPath
from emulators.arm.joint_loops import STILL, JointLoops, six
from emulators.arm.loops import PositionLoop
from emulators.seams import StartPose
from hil_fanuc.arms import FanucArm, Joints
from hil_fanuc.limits import JointLimiter
from hil_fanuc.profile import FanucProfile
from protocol.geometry import Pose, normalise


class Drive(Enum):
    """Action of the drives in a cycle."""

    FOLLOW = auto()
    """The loops follow the set points."""
    BRAKE = auto()
    """The arm brakes on its path."""
    LOCKED = auto()
    """The arm stays where it is."""


class Motion:
    """Joints of the arm, cycle by cycle. Angles are in degrees."""

    def __init__(
        self, profile: FanucProfile, start: StartPose, now: float, decide: Callable[[float], Joints]
    ) -> None:
        """Power up stationary. `decide` returns the set points for the cycle that begins at a time, s; it may change
        `drive`. Raises ValueError for a start pose that the arm cannot hold.
        """
        self._cycle = profile.cycle_s
        self.arm = FanucArm(profile.model, straight_tool(start.tool_length))
        pose = Pose(start.position, normalise(start.quaternion))
        joints = self.arm.at_rest(pose)
        if joints is None:
            raise ValueError(
                f"no joints of the {profile.model} hold the start pose; change start_position_mm or start_quaternion "
                f"(tool at {', '.join(f'{p * 1e3:g}' for p in start.position)} mm)"
            )
        self._decide = decide
        self.limiter = JointLimiter(joints, self._cycle)
        self.joints = self._next = joints
        """Joints at the begin and the end of the current cycle."""
        self.speeds: Joints = STILL
        """Speeds in the current cycle, degrees/s."""
        self.drive = Drive.FOLLOW
        loop = PositionLoop(profile.natural_frequency_rad_s, profile.damping_ratio)
        self.loops = JointLoops(joints, loop, profile.transport_delay_ms / 1e3, self._cycle)
        self._brake_s = profile.stop_ms / 1e3
        self._braked_from: tuple[Joints, float] = STILL, 0.0
        self.path = CycledPath(pose, now, self._cycle, self._step)

    @property
    def set_point(self) -> Joints:
        """Newest set points."""
        return six(self.limiter.joints)

    @property
    def set_speed(self) -> float:
        """Speed of the fastest joint's set point, degrees/s."""
        return max(abs(state.speed) for state in self.limiter.states)

    @property
    def fastest_deg_s(self) -> float:
        """Speed of the fastest joint, degrees/s."""
        return max(map(abs, self.speeds))

    @property
    def is_still(self) -> bool:
        """Whether no joint moves."""
        return self.fastest_deg_s < 1e-9

    @property
    def has_arrived(self) -> bool:
        """Whether the loops follow the newest set points."""
        return all(joints == self.set_point for joints in self.loops.delayed)

    def brake(self, now: float) -> None:
        """Brake the arm, and then lock it. No effect if it brakes or is locked."""
        if self.drive is Drive.FOLLOW:
            self.drive, self._braked_from = Drive.BRAKE, (self.speeds, now)

    def lock(self) -> None:
        """Stop the arm at once."""
        self.drive = Drive.LOCKED

    def release(self) -> None:
        """Let the drives follow set points from the present joints on."""
        if self.drive is not Drive.FOLLOW:
            self._rest(self._next)
            self.drive = Drive.FOLLOW

    def _step(self, at: float) -> Pose:
        """Run the cycle that begins at a time, and return the pose of the tool at its end."""
        self.joints = self._next
        set_point = self._decide(at)
        match self.drive:
            case Drive.FOLLOW:
                self._next = self.loops.follow(set_point, self.is_still)
            case Drive.BRAKE:
                self._next = self._brake(at)
            case Drive.LOCKED:
                self._next = self.joints
        self.speeds = _speeds(self.joints, self._next, self._cycle)
        if self.drive in (Drive.BRAKE, Drive.LOCKED):
            self._rest(self._next)
        return self.path.pose if self._next == self.joints else self.arm.pose(self._next)

    def _brake(self, at: float) -> Joints:
        speeds, since = self._braked_from
        share = 1.0 - (at - since) / self._brake_s if self._brake_s else 0.0
        if share <= 0.0:
            self.drive = Drive.LOCKED
            return self.joints
        return _moved(self.joints, six([share * speed for speed in speeds]), self._cycle)

    def _rest(self, joints: Joints) -> None:
        """Put set points and loops at rest at these joints."""
        self.limiter.rest(joints)
        self.loops.rest(joints)


def _moved(joints: Joints, speeds: Joints, seconds: float) -> Joints:
    return six([q + v * seconds for q, v in zip(joints, speeds, strict=True)])


def _speeds(joints: Joints, after: Joints, seconds: float) -> Joints:
    if joints == after:
        return STILL
    return six([(b - a) / seconds for a, b in zip(joints, after, strict=True)])
