"""Force mode, freedrive and contact of one controller: what its programs set, and the arm's cycle with it."""

import math
from typing import NamedTuple

from emulators.devices.rtde.arm import Hold, JointArm, Paces, Place
from emulators.devices.rtde.contact import History
from emulators.devices.rtde.force_mode import (
    Admittance,
    ForceMode,
    ForceTask,
    Steered,
    solve_motion,
)
from emulators.devices.rtde.kinematics import Arm, compose, flange
from emulators.devices.rtde.profile import RtdeProfile
from protocol.geometry import Pose, Wrench

TOO_FAST = "a joint is too fast"
"""Reason of a protective stop."""


class ToolState(NamedTuple):
    """The tool in a cycle, as force mode knows it."""

    tcp: Pose
    """Tool in the flange, as the controller takes it to be."""
    force: Wrench
    """actual_TCP_force with its moments about the tool. The arm's own tells none of a contact."""


class Compliance:
    """Settings of force mode that programs make, and the cycle of an arm with it."""

    def __init__(self, profile: RtdeProfile, period: float, lengths: Arm) -> None:
        self._profile, self._period, self._lengths = profile, period, lengths
        self._fastest = profile.max_joint_speed_rad_s
        """Of a joint, rad/s."""
        self.history = History()
        self._mode: ForceMode | None = None
        self._free = False
        """The mode is freedrive."""
        self.reset()

    def reset(self) -> None:
        """Reset force mode and its settings at the end of a program."""
        self._mode = None
        self.damping = self._profile.force_mode_damping
        """0 … 1, of force_mode_set_damping()."""
        self.gain_scaling = self._profile.force_mode_gain_scaling
        """0 … 2, of force_mode_set_gain_scaling()."""

    @property
    def on(self) -> bool:
        """Whether force mode or freedrive is on."""
        return self._mode is not None

    def begin(self, task: ForceTask) -> None:
        """force_mode(): from the next cycle on. Another call changes what is on."""
        if self._mode is not None and not self._free:
            self._mode.change(task)
        else:
            self._mode = ForceMode(task, self._period)
        self._free = False

    def free(self, frame: Pose, axes: tuple[bool, ...]) -> None:
        """freedrive_mode(): the axes of the frame yield to a force."""
        profile = self._profile
        speed, turn = profile.freedrive_speed_mm_s * 1e-3, profile.freedrive_turn_rad_s
        limits = (speed, speed, speed, turn, turn, turn)
        self._mode, self._free = ForceMode(ForceTask(frame, axes, (0.0,) * 6, 2, limits), self._period), True

    def end(self, freedrive: bool) -> None:
        """end_force_mode(), or end_freedrive_mode(): nothing happens where that one is not on."""
        if self._free == freedrive:
            self._mode = None

    def _admittance(self) -> Admittance:
        profile = self._profile
        gain, turn_gain = profile.force_mode_gain_mm_s_n * 1e-3, profile.force_mode_turn_gain_rad_s_nm
        if self._free:
            return Admittance(gain, turn_gain, 1.0, profile.freedrive_least_n)
        scale = self.gain_scaling
        return Admittance(gain * scale, turn_gain * scale, self.damping, profile.force_mode_least_n)

    def step(self, arm: JointArm, paces: Paces, plays: bool, tool: ToolState) -> str:
        """One cycle of the arm; `paces` as for `JointArm.step`. Why it must stop before that cycle, or empty.

        While no program plays, or the arm is held, nothing yields: it stands, or brakes from the speed that it has.
        """
        mode = self._mode
        if mode is None or not plays or isinstance(arm.order, Hold):
            arm.settle()
            before = arm.joints
            arm.step(paces)
            if all(-self._fastest <= speed <= self._fastest for speed in arm.speeds):
                return ""
            arm.stay(before)  # also from a speed that is not a number
            return TOO_FAST
        before = arm.joints
        old = compose(flange(self._lengths, before), tool.tcp)
        arm.step(paces)
        if not all(map(math.isfinite, arm.joints)):
            arm.stay(before)
            return TOO_FAST
        planned = compose(flange(self._lengths, arm.joints), tool.tcp)
        steered = Steered(old, planned, isinstance(arm.order, Place))
        poses = mode.step(self._admittance(), steered, tool.force)
        motion = solve_motion(self._lengths, tool.tcp, poses, arm.joints)
        fastest = self._fastest * self._period
        if motion is None or max(abs(b - a) for a, b in zip(before, motion.joints, strict=True)) > fastest:
            arm.stay(before)
            return (
                "force mode leaves the workspace" if motion is None else "force mode makes a joint too fast"
            )
        arm.yield_to(before, motion.path, motion.joints)
        return ""
