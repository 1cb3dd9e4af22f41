"""Instructions of the Remote Motion Interface that move the arm or wait, one after another.

An answer follows when its instruction is done (stated: manual B-84184EN, cited by vertec-io/Fanuc_RMI_API). Every
instruction ends with a stop: a smooth transition (CNT) is not modelled.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from emulators.arm.joint_loops import six
from hil_fanuc import rmi
from hil_fanuc.arms import Joints, from_pendant
from hil_fanuc.limits import AxisLimits
from hil_fanuc.motion import Motion
from hil_fanuc.packets import is_finite
from hil_fanuc.path_limiter import PathLimiter
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import Message
from protocol.geometry import Pose, from_angles, product, towards

WAIT = "FRC_WaitTime"
_JOINTS = "FRC_JointMotionJRep", "FRC_JointRelativeJRep"
_POSES = "FRC_JointMotion", "FRC_JointRelative", "FRC_LinearMotion", "FRC_LinearRelative"
NAMES = frozenset((WAIT, *_JOINTS, *_POSES))
"""Instructions that are carried out."""
_QUEUE_MAX = 200
"""Largest number of instructions that wait. Assumed."""
_AT_GOAL_DEG = 0.01
"""Largest difference of a joint from the goal at which the arm has reached it. Assumed."""
_LARGEST = 1e6
"""Upper limit of the numbers of an instruction. Chosen."""
_TURN_RAD_S = math.pi
"""Largest rotational speed of a linear motion, rad/s. Assumed."""


class Instruction(NamedTuple):
    """Instruction that was read."""

    name: str
    number: int
    values: tuple[float, ...] = ()
    """Joints of the pendant, degrees, or X Y Z in mm and W P R in degrees; relative ones are differences."""
    speed: float = 1.0
    """Share of the largest speeds of the joints, or a speed of the tool, m/s."""
    wait_s: float = 0.0
    act: Callable[[float], int] | None = None
    """Function that carries out an instruction without motion at a time, s, and returns an ErrorID."""

    @property
    def is_relative(self) -> bool:
        """Whether the values are differences."""
        return "Relative" in self.name

    @property
    def is_linear(self) -> bool:
        """Whether the tool moves on a straight line."""
        return self.name.startswith("FRC_Linear")


def read(name: str, message: Message, override: float) -> Instruction | None:
    """Return the instruction in a message; None if a value is missing or invalid. `override` is a share."""
    number = int(message["SequenceID"])
    if name == WAIT:
        seconds = _number(message.get("Time"))
        return Instruction(name, number, wait_s=seconds) if seconds >= 0.0 else None
    key, names = (
        ("JointAngle", ("J1", "J2", "J3", "J4", "J5", "J6")) if name in _JOINTS else ("Position", "XYZWPR")
    )
    section, speed = message.get(key), _number(message.get("Speed"))
    unit = {"Percent": 0.01, "mmSec": 1e-3}.get(str(message.get("SpeedType")))
    is_linear = name.startswith("FRC_Linear")
    if not isinstance(section, dict) or not speed > 0.0 or unit is None or is_linear != (unit == 1e-3):
        return None
    values = tuple(_number(section.get(one, 0.0)) for one in names)
    if not is_finite(values):
        return None
    share = speed * unit if is_linear else min(speed * unit, 1.0)
    return Instruction(name, number, values, share * override)


def _number(value: object) -> float:
    """Return a finite number; NaN for anything else."""
    return float(value) if isinstance(value, int | float) and abs(value) < _LARGEST else math.nan


class _Running(NamedTuple):
    """Instruction that is carried out."""

    instruction: Instruction
    goal: Joints
    line: PathLimiter | None
    """Path of a linear motion."""
    to: Pose
    """Goal of a linear motion."""
    ends_at: float


class RmiMotions:
    """Instructions of one controller."""

    def __init__(self, profile: FanucProfile, limits: Callable[[], tuple[AxisLimits, ...]]) -> None:
        """`limits` returns the limits of the joints."""
        self._profile, self._limits = profile, limits
        self.motion: Motion
        """Arm; set once it is powered up."""
        self._queue: deque[Instruction] = deque()
        self._running: _Running | None = None
        self.is_paused = False
        self.done: list[Message] = []
        """Answers to instructions that have ended."""

    @property
    def is_busy(self) -> bool:
        """Whether there are instructions."""
        return self._running is not None or bool(self._queue)

    def add(self, instruction: Instruction) -> bool:
        """Append an instruction; return whether there is room for it."""
        if len(self._queue) == _QUEUE_MAX:
            return False
        self._queue.append(instruction)
        return True

    def clear(self) -> None:
        """Drop all instructions, as an abort does. They are not answered."""
        self._queue.clear()
        self._running, self.is_paused = None, False

    def goal_of(self, instruction: Instruction) -> Pose | None:
        """Return the pose to which an instruction moves the tool from the present set point; None if out of reach."""
        goal = self._joints(instruction)
        return None if goal is None else self.motion.arm.pose(goal)

    def decide(self, at: float) -> Joints:
        """Return the set points for the cycle that begins at a time, s."""
        motion = self.motion
        if self.is_paused:
            motion.brake(at)
            return motion.set_point
        motion.release()
        if self._running is None:
            self._begin(self._queue.popleft(), at)
        if self._running is not None:
            self._advance(self._running, at)
        return motion.set_point

    def _begin(self, instruction: Instruction, at: float) -> None:
        """Begin an instruction. One whose goal the arm cannot reach is answered with an error."""
        if instruction.act is not None:
            self._answer(instruction, instruction.act(at))
            return
        goal = self._joints(instruction)
        if goal is None:
            self._answer(instruction, rmi.BAD_VALUE)
            return
        here = self.motion.set_point
        line = PathLimiter(self.motion.arm, here, self._profile.cycle_s) if instruction.is_linear else None
        to = self.motion.arm.pose(goal)
        self._running = _Running(instruction, goal, line, to, at + instruction.wait_s)

    def _advance(self, running: _Running, at: float) -> None:
        motion, instruction = self.motion, running.instruction
        if instruction.name == WAIT:
            is_done = at >= running.ends_at - 1e-9
        else:
            self._step(running)
            apart = max(abs(a - b) for a, b in zip(motion.joints, running.goal, strict=True))
            is_done = apart < _AT_GOAL_DEG and motion.fastest_deg_s <= self._profile.in_motion_deg_s
        if is_done:
            self._running = None
            self._answer(instruction, 0)

    def _step(self, running: _Running) -> None:
        """Move the set points by one cycle."""
        motion, speed, limits = self.motion, running.instruction.speed, self._limits()
        if running.line is None:
            slow = [axis._replace(speed=axis.speed * speed) for axis in limits]
            motion.limiter.step(running.goal, slow)
            return
        line, cycle = running.line, self._profile.cycle_s
        line.aim(towards(line.goal, running.to, speed * cycle, _TURN_RAD_S * cycle))
        if not line.step(limits):
            self._running = None
            self._answer(running.instruction, rmi.BAD_VALUE)
        motion.limiter.accept(line.joints)

    def _answer(self, instruction: Instruction, error: int) -> None:
        self.done.append(
            {"Instruction": instruction.name, "ErrorID": error, "SequenceID": instruction.number}
        )

    def _joints(self, instruction: Instruction) -> Joints | None:
        """Return the joints to which an instruction leads from the present set points."""
        arm, here = self.motion.arm, self.motion.set_point
        if instruction.name == WAIT:
            return here
        if instruction.name in _JOINTS:
            goal = from_pendant(six(instruction.values))
            if instruction.is_relative:
                goal = six([a + b for a, b in zip(here, goal, strict=True)])
            return goal if arm.allows(goal) else None
        pose = self._pose(instruction)
        joints = arm.nearest(pose, here)
        return arm.at_rest(pose) if joints is None and not instruction.is_linear else joints

    def _pose(self, instruction: Instruction) -> Pose:
        """Return the pose of the tool to which an instruction leads, base frame."""
        x, y, z, w, p, r = instruction.values
        turn, arm = from_angles(r, p, w), self.motion.arm
        if not instruction.is_relative:
            return arm.in_base(Pose((x / 1e3, y / 1e3, z / 1e3), turn))
        (a, b, c), quaternion = arm.pose(self.motion.set_point)
        return Pose((a + x / 1e3, b + y / 1e3, c + z / 1e3), product(turn, quaternion))
