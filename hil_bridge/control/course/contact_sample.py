"""One sample of the run in the work frame, as a program and its steps use it."""

import math

from msgspec import Struct

from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.sample import Sample
from hil_bridge.control.types import Measurement
from protocol.geometry import Vector


class ContactSample(Struct, frozen=True, gc=False):
    """Contact force and place of the tool in one sample, in the work frame."""

    sample: Sample
    measurement: Measurement
    """The direction in which the force is controlled."""
    place: Place
    """Reported x and y from the start point, m."""
    force: Vector
    """Contact force along the approach, x and y, N, positive where the tool presses that way; from the newest zero."""
    wrench: tuple[float, ...]
    """Contact wrench in the tool frame from the newest zero, N and N·m, (6,); empty where it is unknown."""

    @property
    def aside(self) -> float:
        """Length of the force across the approach, or the force that the moments show there, whichever is larger, N.
        0 where the axes that measure it are verified.
        """
        hidden = self.sample.hidden
        return 0.0 if hidden is None else max(math.hypot(self.force[1], self.force[2]), hidden)

    def against(self, heading: Place) -> float:
        """Force against a motion in this direction of the work frame, N."""
        return self.force[1] * heading[0] + self.force[2] * heading[1]
