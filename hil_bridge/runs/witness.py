"""Force measured by the robot itself, relative to the zero of the run, as a check of the force sensor."""

import math

from hil_bridge.control.course.witness import Witness
from hil_bridge.devices.robots.seam import RobotLink, RobotReport
from hil_bridge.errors import BridgeError
from protocol.geometry import Vector

_NOTHING: Vector = (0.0, 0.0, 0.0)


class OwnForce:
    """Force measured by the robot, less its mean while the tool was away from the surface.

    The zero is kept in the base frame. A weight that the robot does not know, or knows wrongly, stays the same in
    this frame when the tool turns.
    """

    def __init__(self, approach: Vector) -> None:
        """Create the force. `approach` is the unit vector into the surface, base frame."""
        self._approach = approach
        self._sum, self._count = _NOTHING, 0
        self._zero: Vector | None = None

    def add_zero_sample(self, report: RobotReport) -> None:
        """Add a report to the zero. The tool must be stationary and away from the surface."""
        if report.force is not None:
            x, y, z = (total + part for total, part in zip(self._sum, report.force, strict=True))
            self._sum, self._count = (x, y, z), self._count + 1
            self._zero = x / self._count, y / self._count, z / self._count

    def along(self, report: RobotReport) -> float | None:
        """Return the contact force along the approach, N, positive while pressing; None if unknown."""
        if report.force is None or self._zero is None:
            return None
        (a, b, c), (x, y, z), (u, v, w) = report.force, self._zero, self._approach
        return (x - a) * u + (y - b) * v + (z - c) * w

    async def disagreement(self, force: float, rule: Witness, robot: RobotLink) -> float:
        """Return the magnitude of the robot's own force on a stationary tool, N, if it disagrees with the sensor's
        `force`, N; NaN if it is unknown or the difference is normal.
        """
        try:
            measured = None if self._zero is None else (await robot.report()).force
        except BridgeError:
            return math.nan
        own = math.nan if measured is None or self._zero is None else math.dist(measured, self._zero)
        return own if not abs(own - force) <= rule.ordinary_n else math.nan
