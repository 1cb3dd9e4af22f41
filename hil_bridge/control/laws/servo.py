"""Where the robot is by its orders: a model of its servo.

A robot may report its position with a noise that is larger than the moves of a sample. Its orders have none, and the
force shows each error of the arm at once. So the model leads the orders through a loop of second order, as late as the
robot is, and the position stays within a bound of the reported one. Source: internal model control, as textbooks have
it.
"""

from dataclasses import dataclass

from msgspec import Struct

from hil_bridge.control.limiting import within
from hil_bridge.control.types import Measurement


class Served(Struct, frozen=True):
    """State of the loop."""

    position: float
    """m"""
    speed: float = 0.0
    """m/s"""


@dataclass(frozen=True, slots=True)
class Servo:
    """A loop of second order."""

    lag_s: float
    """Time by which a steady motion comes after its orders, s."""
    damping: float
    """Damping ratio."""
    error_m: float
    """Farthest that the position is taken to be from the reported one, m."""

    def begin(self, measurement: Measurement, coming: bool) -> Served:
        """Return the state at the first sample in contact: the robot is where it reports.

        `coming`: it comes with an even speed, as at a first touch; else it stands.
        """
        speed = (measurement.commanded - measurement.position) / self.lag_s if coming else 0.0
        return Served(measurement.position, speed)

    def after(self, served: Served, measurement: Measurement) -> Served:
        """Return the state after a sample. Backward Euler: stable for any time."""
        reported, dt = measurement.position, measurement.dt
        frequency = 2.0 * self.damping / self.lag_s
        pull = dt * frequency
        speed = served.speed + pull * frequency * (measurement.commanded - served.position)
        speed /= 1.0 + pull * (2.0 * self.damping + pull)
        position = served.position + dt * speed
        return Served(within(position, reported - self.error_m, reported + self.error_m), speed)
