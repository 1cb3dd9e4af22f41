"""Corrections of the axes for a program that takes no Cartesian ones: each cycle's pose by the arm's kinematics.

The set pose and the set axes tell the tool: it is the way from the flange to the tool centre point, and stays the same.
So no length of the tool is asked for. The program's base has to be the robot's own (`$BASE` at `$ROBROOT`); another
one, or another arm, shows as soon as the robot moves, and is told as a fault.

The tool goes straight, or it stands. Where an axis would have to turn faster than it may, as next to a singularity, the
cycle's way is cut short. Where that does not help, as at a flip of the wrist, it is not begun.
"""

import math
from typing import NamedTuple

from protocol.devices.rsi.arm import KukaArm
from protocol.devices.rsi.profile import RsiLink
from protocol.geometry import Pose, from_angles, inverse, product, rotate
from protocol.kinematics import Joints

NO_TURN: Joints = (0.0,) * 6
_SHORTER = 0.9
"""Chosen: part of the way that an axis at its fastest would allow, which is tried where all of it is too fast."""


class Programmed(NamedTuple):
    """The place of the robot's program without any correction, as its telegrams tell it."""

    pose: Pose
    """RSol: the tool in the base."""
    axes: Joints
    """ASPos, degrees."""


class Followed(NamedTuple):
    """The corrections of a cycle."""

    axes: Joints
    """Of each axis, degrees."""
    correction: tuple[float, ...]
    """The Cartesian one that these axes make, mm and degrees."""
    refusal: str = ""
    """Reason for which the robot stands, or is slower than its set point; empty without."""


class AxisChannel:
    """The axes of one robot behind its Cartesian correction."""

    def __init__(self, link: RsiLink) -> None:
        self._link = link
        self._arm = KukaArm(link.model, 0.0)
        self._most = link.fastest_axis_deg_s * link.cycle_ms / 1e3
        self.total: Joints = NO_TURN
        """Correction of each axis that the robot has, as far as is known, degrees."""
        self._programmed: Programmed | None = None
        self._to_flange = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        """The flange in the frame of the tool."""

    def learn(self, programmed: Programmed) -> None:
        """Learn the position that the program set."""
        if programmed == self._programmed:
            return
        self._programmed = programmed
        flange, tool = self._arm.pose(programmed.axes), programmed.pose
        turn = inverse(tool.quaternion)
        x, y, z = (to - at for to, at in zip(flange.position, tool.position, strict=True))
        self._to_flange = Pose(rotate(turn, (x, y, z)), product(turn, flange.quaternion))

    def beside_mm(self, actual: Pose, axes: Joints) -> float:
        """Distance of the flange by a pose of the tool from that by the axes, mm: 0 if arm and base are as set."""
        return math.dist(self._flange(actual).position, self._arm.pose(axes).position) * 1e3

    def follow(self, before: tuple[float, ...], correction: tuple[float, ...]) -> Followed:
        """Corrections of the axes that bring the tool from one Cartesian correction to another, as far as a cycle
        allows. The robot stands where there are none.
        """
        axes, refusal = self._axes_of(correction)
        if axes is None:
            return Followed(self.total, before, refusal)
        share = self._most / max(self._steps(axes))
        if share >= 1.0:
            return Followed(axes, correction)
        number = 1 + max(range(6), key=self._steps(axes).__getitem__)
        refusal = (
            f"axis {number} would turn by {max(self._steps(axes)):.2g}° in a cycle, allowed are {self._most:.2g}°: "
            "a singularity is near, or the set point is too fast"
        )
        way = zip(before, correction, strict=True)
        shorter = tuple([here + _SHORTER * share * (there - here) for here, there in way])
        axes, _ = self._axes_of(shorter)
        if axes is None or max(self._steps(axes)) > self._most:
            return Followed(self.total, before, refusal)
        return Followed(axes, shorter, refusal)

    def _axes_of(self, correction: tuple[float, ...]) -> tuple[Joints | None, str]:
        """Corrections of the axes for a Cartesian one; None with the reason where they are refused."""
        programmed, link = self._programmed, self._link
        if programmed is None:
            return None, "the place of its program is told as no numbers"
        x, y, z, *angles = correction
        a, b, c = angles
        (u, v, w), turned = programmed.pose
        tool = Pose((u + x / 1e3, v + y / 1e3, w + z / 1e3), product(from_angles(a, b, c), turned))
        p, q, r, s, t, o = (set_to + by for set_to, by in zip(programmed.axes, self.total, strict=True))
        held = self._arm.holding(self._flange(tool), (p, q, r, s, t, o))
        if held is None:
            return None, f"no axes of a {link.model} hold the tool there"
        p, q, r, s, t, o = (to - set_to for to, set_to in zip(held, programmed.axes, strict=True))
        for number, by in enumerate((p, q, r, s, t, o), 1):
            if not abs(by) <= link.limit_axis_deg:  # NaN too
                return None, (
                    f"axis {number} would be {abs(by):.4g}° beside the robot's program, allowed are "
                    f"{link.limit_axis_deg:g}°"
                )
        return (p, q, r, s, t, o), ""

    def _steps(self, axes: Joints) -> list[float]:
        """Turn of each axis from the present corrections to these, degrees; never quite zero."""
        return [abs(to - at) + 1e-12 for to, at in zip(axes, self.total, strict=True)]

    def _flange(self, tool: Pose) -> Pose:
        x, y, z = rotate(tool.quaternion, self._to_flange.position)
        u, v, w = tool.position
        return Pose((u + x, v + y, w + z), product(tool.quaternion, self._to_flange.quaternion))
