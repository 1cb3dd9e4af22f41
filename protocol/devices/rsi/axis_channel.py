"""Axis corrections for a program that accepts no Cartesian corrections, computed in each cycle with the arm's
kinematics.

The set pose and the set axes determine the constant transform from the flange to the tool centre point, so the tool
length need not be configured. The base of the program must be the robot's own (`$BASE` at `$ROBROOT`). Another
base, or another arm, is detected as soon as the robot moves, and is reported as a fault.

The tool moves in a straight line, or not at all. If an axis would exceed its speed limit, as near a singularity,
the motion of the cycle is shortened. If the shortened motion is still too fast, as at a flip of the wrist, the
robot does not move.
"""

import math
from typing import NamedTuple

from protocol.devices.rsi.arm import KukaArm
from protocol.devices.rsi.profile import RsiLink
from protocol.geometry import Pose, from_angles, inverse, product, rotate
from protocol.kinematics import Joints

NO_TURN: Joints = (0.0,) * 6
_SHORTER = 0.9
"""Fraction of the shortened motion that is commanded if the complete motion is too fast for an axis. Chosen."""


class Programmed(NamedTuple):
    """Position set by the robot's program, without any correction, as reported in the robot's telegrams."""

    pose: Pose
    """Set pose of the tool in the base frame, RSol."""
    axes: Joints
    """Set axes, ASPos, degrees."""


class Followed(NamedTuple):
    """Corrections for one cycle."""

    axes: Joints
    """Correction of each axis, degrees."""
    correction: tuple[float, ...]
    """Cartesian correction that results from the axis corrections, mm and degrees."""
    refusal: str = ""
    """Reason why the robot does not move, or moves more slowly than its set point; empty if there is none."""


class AxisChannel:
    """Converter of the Cartesian corrections of one robot to axis corrections."""

    def __init__(self, link: RsiLink) -> None:
        self._link = link
        self._arm = KukaArm(link.model, 0.0)
        self._most = link.fastest_axis_deg_s * link.cycle_ms / 1e3
        self.total: Joints = NO_TURN
        """Current correction of each axis, degrees, as far as it is known."""
        self._programmed: Programmed | None = None
        self._to_flange = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        """Pose of the flange in the tool frame."""

    def learn(self, programmed: Programmed) -> None:
        """Store the position set by the program."""
        if programmed == self._programmed:
            return
        self._programmed = programmed
        flange, tool = self._arm.pose(programmed.axes), programmed.pose
        turn = inverse(tool.quaternion)
        x, y, z = (to - at for to, at in zip(flange.position, tool.position, strict=True))
        self._to_flange = Pose(rotate(turn, (x, y, z)), product(turn, flange.quaternion))

    def flange_deviation_mm(self, actual: Pose, axes: Joints) -> float:
        """Return the distance, mm, between the flange position computed from the tool pose and the one computed
        from the axes. It is 0 if the configured arm and base are correct.
        """
        return math.dist(self._flange(actual).position, self._arm.pose(axes).position) * 1e3

    def follow(self, before: tuple[float, ...], correction: tuple[float, ...]) -> Followed:
        """Return the axis corrections that move the tool from one Cartesian correction towards another, as far as
        one cycle allows. If no axis corrections do, the robot does not move.
        """
        axes, refusal = self._axes_of(correction)
        if axes is None:
            return Followed(self.total, before, refusal)
        share = self._most / max(self._steps(axes))
        if share >= 1.0:
            return Followed(axes, correction)
        number = 1 + max(range(6), key=self._steps(axes).__getitem__)
        refusal = (
            f"axis {number} would turn by {max(self._steps(axes)):.2g}° in a cycle; allowed: at most "
            f"{self._most:.2g}°: a singularity is near, or the set point is too fast"
        )
        pairs = zip(before, correction, strict=True)
        shorter = tuple([here + _SHORTER * share * (there - here) for here, there in pairs])
        axes, _ = self._axes_of(shorter)
        if axes is None or max(self._steps(axes)) > self._most:
            return Followed(self.total, before, refusal)
        return Followed(axes, shorter, refusal)

    def _axes_of(self, correction: tuple[float, ...]) -> tuple[Joints | None, str]:
        """Return the axis corrections for a Cartesian correction and an empty reason; None and the reason if the
        correction is refused.
        """
        programmed, link = self._programmed, self._link
        if programmed is None:
            return None, "the position of its program is not numeric"
        x, y, z, *angles = correction
        a, b, c = angles
        (u, v, w), turned = programmed.pose
        tool = Pose((u + x / 1e3, v + y / 1e3, w + z / 1e3), product(from_angles(a, b, c), turned))
        p, q, r, s, t, o = (set_to + by for set_to, by in zip(programmed.axes, self.total, strict=True))
        axes = self._arm.holding(self._flange(tool), (p, q, r, s, t, o))
        if axes is None:
            return None, f"no axes of a {link.model} reach that pose"
        p, q, r, s, t, o = (to - set_to for to, set_to in zip(axes, programmed.axes, strict=True))
        for number, by in enumerate((p, q, r, s, t, o), 1):
            if not abs(by) <= link.limit_axis_deg:  # also true for NaN
                return None, (
                    f"axis {number} would be {abs(by):.4g}° away from the robot's program; allowed: at most "
                    f"{link.limit_axis_deg:g}°"
                )
        return (p, q, r, s, t, o), ""

    def _steps(self, axes: Joints) -> list[float]:
        """Return the rotation of each axis from the current axis corrections to `axes`, degrees. No value is
        exactly zero.
        """
        return [abs(to - at) + 1e-12 for to, at in zip(axes, self.total, strict=True)]

    def _flange(self, tool: Pose) -> Pose:
        x, y, z = rotate(tool.quaternion, self._to_flange.position)
        u, v, w = tool.position
        return Pose((u + x, v + y, w + z), product(tool.quaternion, self._to_flange.quaternion))
