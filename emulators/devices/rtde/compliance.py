"""Force mode, freedrive and contact of one controller: the settings made by programs, and the arm's motion with
them.
"""

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
"""Reason of a protective stop: the motion is too fast."""


class ToolState(NamedTuple):
    """State of the tool in one cycle, as force mode receives it."""

    tcp: Pose
    """Tool centre point in the flange frame, as set in the controller."""
    force: Wrench
    """actual_TCP_force with moments about the tool. The arm's own sensor reports no moments of a contact."""


class Compliance:
    """Settings of force mode made by programs, and the arm's motion with them."""

    def __init__(self, profile: RtdeProfile, period: float, lengths: Arm) -> None:
        self._profile, self._period, self._lengths = profile, period, lengths
        self._fastest = profile.max_joint_speed_rad_s
        """Largest joint speed, rad/s."""
        self.history = History()
        self._mode: ForceMode | None = None
        self._free = False
        """Whether the mode is freedrive."""
        self.reset()

    def reset(self) -> None:
        """Reset force mode and its settings at the end of a program."""
        self._mode = None
        self.damping = self._profile.force_mode_damping
        """Damping set by force_mode_set_damping(), 0 … 1."""
        self.gain_scaling = self._profile.force_mode_gain_scaling
        """Gain scaling set by force_mode_set_gain_scaling(), 0 … 2."""

    @property
    def on(self) -> bool:
        """Whether force mode or freedrive is on."""
        return self._mode is not None

    def begin(self, task: ForceTask) -> None:
        """Start force mode in the next cycle, as force_mode() does, or change an active force mode."""
        if self._mode is not None and not self._free:
            self._mode.change(task)
        else:
            self._mode = ForceMode(task, self._period)
        self._free = False

    def free(self, frame: Pose, axes: tuple[bool, ...]) -> None:
        """Start freedrive: the axes of the frame yield to a force."""
        profile = self._profile
        speed, turn = profile.freedrive_speed_mm_s * 1e-3, profile.freedrive_turn_rad_s
        limits = (speed, speed, speed, turn, turn, turn)
        self._mode, self._free = ForceMode(ForceTask(frame, axes, (0.0,) * 6, 2, limits), self._period), True

    def end(self, freedrive: bool) -> None:
        """End force mode or freedrive. No effect if the mode is not on."""
        if self._free == freedrive:
            self._mode = None

    def _admittance(self) -> Admittance:
        profile = self._profile
        gain, turn_gain = profile.force_mode_gain_mm_s_n * 1e-3, profile.force_mode_turn_gain_rad_s_nm
        if self._free:
            return Admittance(gain, turn_gain, 1.0, profile.freedrive_least_n)
        scale = self.gain_scaling
        least, lag = profile.force_mode_least_n, profile.force_mode_lag_ms * 1e-3
        return Admittance(gain * scale, turn_gain * scale, self.damping, least, lag)

    def step(self, arm: JointArm, paces: Paces, plays: bool, tool: ToolState) -> str:
        """Advance the arm by one cycle. `paces` is the same as for `JointArm.step`.

        Return the reason of a protective stop that prevents the cycle, or an empty string. While no program runs,
        or the arm is held, no axis is compliant: the arm is stationary, or brakes from its current speed.
        """
        mode = self._mode
        if mode is None or not plays or isinstance(arm.order, Hold):
            if mode is not None:
                mode.rest()
            arm.end_compliance()
            before = arm.joints
            arm.step(paces)
            if all(-self._fastest <= speed <= self._fastest for speed in arm.speeds):
                return ""
            arm.note_standstill(before)  # also if a speed is NaN
            return TOO_FAST
        before = arm.joints
        old = compose(flange(self._lengths, before), tool.tcp)
        arm.step(paces)
        if not all(map(math.isfinite, arm.joints)):
            arm.note_standstill(before)
            return TOO_FAST
        planned = compose(flange(self._lengths, arm.joints), tool.tcp)
        steered = Steered(old, planned, isinstance(arm.order, Place))
        poses = mode.step(self._admittance(), steered, tool.force)
        motion = solve_motion(self._lengths, tool.tcp, poses, arm.joints)
        fastest = self._fastest * self._period
        if motion is None or max(abs(b - a) for a, b in zip(before, motion.joints, strict=True)) > fastest:
            arm.note_standstill(before)
            return (
                "force mode leaves the workspace" if motion is None else "force mode makes a joint too fast"
            )
        arm.yield_to(before, motion.path, motion.joints)
        return ""
