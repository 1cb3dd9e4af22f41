"""Model of the robot's servo, which computes the robot's position from its orders.

The position that a robot reports may have more noise than the tool moves in one sample. Orders have no noise, and
the force responds at once to each position error of the arm. So the model passes the orders through a second-order
loop with the robot's lag, and keeps the position within a bound around the reported position. Source: textbook
internal model control.
"""

from dataclasses import dataclass

from msgspec import Struct

from hil_bridge.control.limiting import within
from hil_bridge.control.types import Measurement


class Served(Struct, frozen=True):
    """State of the second-order loop."""

    position: float
    """Modelled position, m."""
    speed: float = 0.0
    """Modelled speed, m/s."""


@dataclass(frozen=True, slots=True)
class Servo:
    """Second-order loop that models the robot's servo."""

    lag_s: float
    """Time by which the robot lags behind its orders in steady motion, s."""
    damping: float
    """Damping ratio of the loop."""
    error_m: float
    """Largest difference between the modelled and the reported position, m."""

    def begin(self, measurement: Measurement, coming: bool) -> Served:
        """Return the state at the first sample in contact, at the reported position of the robot.

        `coming` states whether the robot approaches at a constant speed, as at a first touch; otherwise it is
        stationary.
        """
        speed = (measurement.commanded - measurement.position) / self.lag_s if coming else 0.0
        return Served(measurement.position, speed)

    def after(self, served: Served, measurement: Measurement) -> Served:
        """Return the state after a sample, by the backward Euler method, which is stable for any step size."""
        reported, dt = measurement.position, measurement.dt
        frequency = 2.0 * self.damping / self.lag_s
        pull = dt * frequency
        speed = served.speed + pull * frequency * (measurement.commanded - served.position)
        speed /= 1.0 + pull * (2.0 * self.damping + pull)
        position = served.position + dt * speed
        return Served(within(position, reported - self.error_m, reported + self.error_m), speed)
