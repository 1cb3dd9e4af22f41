"""One sample of the run in the work frame, as the program and its steps receive it."""

import math

from msgspec import Struct

from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.sample import Sample
from hil_bridge.control.types import Measurement
from protocol.geometry import Vector


class ContactSample(Struct, frozen=True, gc=False):
    """Contact force and position of the tool in one sample, in the work frame."""

    sample: Sample
    measurement: Measurement
    """Measurement along the force-controlled direction, as the controller receives it."""
    place: Place
    """Reported x and y relative to the start point, m."""
    force: Vector
    """Contact force along the approach, x and y, N, since the newest zero. A component is positive if the tool
    presses in its direction.
    """
    wrench: tuple[float, ...]
    """Contact wrench in the tool frame since the newest zero, N and N·m, shape (6,); empty if unknown."""

    @property
    def aside(self) -> float:
        """Force across the approach, N: the larger of the measured force and the force derived from the moments. 0
        if the axes that measure it are verified.
        """
        hidden = self.sample.hidden
        return 0.0 if hidden is None else max(math.hypot(self.force[1], self.force[2]), hidden)

    def against(self, heading: Place) -> float:
        """Return the force that opposes a motion in the given direction of the work frame, N."""
        return self.force[1] * heading[0] + self.force[2] * heading[1]
