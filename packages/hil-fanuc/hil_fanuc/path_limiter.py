"""Set points of the tool that keep the limits of the joints.

The limits of the joints are converted to limits of each coordinate of the tool by the Jacobian at the present posture.
Each coordinate is then limited by itself, so that a fast motion along the surface does not delay the motion towards it.
The joints are limited once more, because the conversion holds for small motions only.
"""

from collections.abc import Sequence

import numpy as np

from hil_fanuc.arms import FanucArm, Joints
from hil_fanuc.limits import AxisLimits, AxisState, JointLimiter, next_state
from hil_fanuc.packets import Limit
from protocol.geometry import Pose, Quaternion, product, rotation_vector, turn_between, turn_by

_TURNING_SHARE = 0.5
"""Share of the limits for translations while the tool turns; the rest is for the rotation. Chosen."""
_MARGIN = 0.7
"""Share of the limits of the joints that each coordinate uses. Chosen: several seldom need theirs at once."""


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
        pose = self._arm.pose(joints)
        self._about: Quaternion = pose.quaternion
        """Orientation from which rotations are counted."""
        self._states = (*(AxisState(part) for part in pose.position), *(AxisState(0.0),) * 3)
        self._goal = (*pose.position, 0.0, 0.0, 0.0)
        self._is_lost = False

    @property
    def joints(self) -> Joints:
        """Newest set points, degrees."""
        a, b, c, d, e, f = self._limiter.joints
        return a, b, c, d, e, f

    @property
    def speed(self) -> float:
        """Speed of the tool's set point, m/s."""
        return float(np.linalg.norm([state.speed for state in self._states[:3]]))

    def aim(self, pose: Pose) -> None:
        """Set the goal of the tool."""
        turn = rotation_vector(turn_between(self._about, pose.quaternion))
        self._goal = (*pose.position, *turn)

    def step(self, limits: Sequence[AxisLimits]) -> bool:
        """Move towards the goal by one cycle. Return False if the arm cannot hold the next pose; it then stays."""
        before, here = self._states, self.joints
        if self._goal != tuple(state.position for state in before) or any(state.speed for state in before):
            within = self._coordinate_limits(here, limits)
            self._states = tuple(
                next_state(state, goal, limit, self._cycle)
                for state, goal, limit in zip(before, self._goal, within, strict=True)
            )
        x, y, z, *turn = (state.position for state in self._states)
        pose = Pose((x, y, z), product(turn_by(turn), self._about))
        joints = self._arm.nearest(pose, here)
        if joints is None:
            self.rest(here)
            return False
        self._limiter.step(joints, limits, exact=True)
        return True

    def _coordinate_limits(self, joints: Joints, limits: Sequence[AxisLimits]) -> tuple[AxisLimits, ...]:
        """Return the limits of the six coordinates, m and rad."""
        rates = np.abs(self._arm.rates(joints))
        turns = self._goal[3:] != tuple(state.position for state in self._states[3:]) or any(
            state.speed for state in self._states[3:]
        )
        share = _TURNING_SHARE if turns else 1.0
        shares = share, max(1.0 - share, 1e-3)
        groups = []
        for part, first in zip(shares, (0, 3), strict=True):
            rows = rates[:, first : first + 3].max(axis=1)
            values = (
                _MARGIN
                * part
                * float(min(limit[kind] / row for limit, row in zip(limits, rows, strict=True)))
                for kind in Limit
            )
            groups.append(AxisLimits(*values))
        translation, rotation = groups
        return (translation,) * 3 + (rotation,) * 3
