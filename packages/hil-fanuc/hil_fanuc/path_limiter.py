"""Set points of the tool that keep the limits of the joints.

The limits of the joints are converted to limits of each coordinate of the tool by the Jacobian at the present posture.
Each coordinate is then limited by itself, so that a fast motion along the surface does not delay the motion towards it.
The joints are limited once more, because the conversion holds for small motions only.
"""

import math
from collections.abc import Sequence

import numpy as np

from hil_fanuc.arms import FanucArm, Joints
from hil_fanuc.limits import AxisLimits, AxisState, JointLimiter, next_state
from hil_fanuc.packets import Limit
from protocol.geometry import (
    Pose,
    Vector,
    normalise,
    product,
    rotation_vector,
    turn_between,
    turn_by,
)

_TURNING_SHARE = 0.5
"""Share of the limits for translations while the tool turns; the rest is for the rotation. Chosen."""
_MARGIN = 0.7
"""Share of the limits of the joints that each coordinate uses. Chosen: several seldom need theirs at once."""
_ROUNDING_RAD = 1e-12
_NO_TURN: Vector = (0.0, 0.0, 0.0)
_SLOWEST_DEG = 1e-3
"""Smallest rate of a joint that counts, degrees per m and per rad, so that no limit is infinite. Chosen."""


class PathLimiter:
    """Set points of one arm, in the coordinates of its tool and in joints."""

    def __init__(self, arm: FanucArm, joints: Joints, cycle: float) -> None:
        """Start stationary. `cycle` is the time between two set points, s."""
        self._arm, self._cycle = arm, cycle
        self._limiter = JointLimiter(joints, cycle)
        self.rest(joints)

    def rest(self, joints: Joints) -> None:
        """Restart stationary at these joints."""
        self._limiter.rest(joints)
        self._pose = self._goal = self._arm.pose(joints)
        self._place: tuple[AxisState, ...] = tuple(map(AxisState, self._pose.position))
        self._turn: tuple[AxisState, ...] = (AxisState(0.0),) * 3
        """Rotation of the last step, rad, with its differences, base frame."""

    @property
    def joints(self) -> Joints:
        """Newest set points, degrees."""
        a, b, c, d, e, f = self._limiter.joints
        return a, b, c, d, e, f

    @property
    def speed(self) -> float:
        """Speed of the tool's set point, m/s."""
        return math.hypot(*(state.speed for state in self._place))

    @property
    def goal(self) -> Pose:
        """Goal of the tool."""
        return self._goal

    def aim(self, pose: Pose) -> None:
        """Set the goal of the tool."""
        self._goal = pose

    def step(self, limits: Sequence[AxisLimits]) -> bool:
        """Move towards the goal by one cycle. Return False if the arm cannot hold the next pose; it then stays."""
        here = self.joints
        turn = self._turn_to_goal()
        moves = any(state.speed for state in (*self._place, *self._turn))
        if moves or any(turn) or self._goal.position != self._pose.position:
            self._move(turn, here, limits)
        joints = self._arm.nearest(self._pose, here)
        if joints is None:
            self.rest(here)
            return False
        self._limiter.step(joints, limits, exact=True)
        return True

    def _turn_to_goal(self) -> Vector:
        """Return the rotation to the goal, rad, base frame; zero if only a rounding error remains."""
        turn = rotation_vector(turn_between(self._pose.quaternion, self._goal.quaternion))
        return turn if math.hypot(*turn) > _ROUNDING_RAD else _NO_TURN

    def _move(self, turn: Vector, here: Joints, limits: Sequence[AxisLimits]) -> None:
        """Move the pose of the tool towards the goal, of which it is a rotation away."""
        turns = any(turn) or any(state.speed for state in self._turn)
        along, about = self._coordinate_limits(here, limits, turns)
        self._place = tuple(
            next_state(state, goal, along, self._cycle)
            for state, goal in zip(self._place, self._goal.position, strict=True)
        )
        turned = tuple(
            next_state(state, goal, about, self._cycle) for state, goal in zip(self._turn, turn, strict=True)
        )
        x, y, z = (state.position for state in self._place)
        quaternion = self._pose.quaternion
        if turns:
            step = turn_by([state.position for state in turned])
            quaternion = normalise(product(step, quaternion))
        self._turn = tuple(state._replace(position=0.0) for state in turned)
        self._pose = Pose((x, y, z), quaternion)

    def _coordinate_limits(
        self, joints: Joints, limits: Sequence[AxisLimits], turns: bool
    ) -> tuple[AxisLimits, AxisLimits]:
        """Return the limits of the translation along each axis, m, and of the rotation about each axis, rad."""
        rates = np.abs(self._arm.rates(joints))
        share = _TURNING_SHARE if turns else 1.0
        groups = []
        for part, first in ((share, 0), (max(1.0 - share, 1e-3), 3)):
            rows = np.maximum(rates[:, first : first + 3].max(axis=1), _SLOWEST_DEG)
            values = (
                _MARGIN
                * part
                * float(min(limit[kind] / row for limit, row in zip(limits, rows, strict=True)))
                for kind in Limit
            )
            groups.append(AxisLimits(*values))
        return groups[0], groups[1]
