"""Model of the robot's servo, which computes the robot's position from its orders.

The position that a robot reports may have more noise than the tool moves in one sample. Orders have no noise, and
the force responds at once to each position error of the arm. So the model passes the orders through a second-order
loop with the robot's lag, and keeps the position within a bound around the reported position. Source: textbook
internal model control.

A link does not send an order at once: its set points move towards the order with a limited speed and acceleration. The
model does the same. Otherwise it would lead the robot in each large step.
"""

import math
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
    setpoint: float = 0.0
    """Modelled set point, m."""
    setpoint_speed: float = 0.0
    """Speed of that set point, m/s."""


@dataclass(frozen=True, slots=True)
class Servo:
    """Second-order loop that models the robot's servo."""

    lag_s: float
    """Time by which the robot lags behind its orders in steady motion, s."""
    damping: float
    """Damping ratio of the loop."""
    error_m: float
    """Largest difference between the modelled and the reported position, m."""
    setpoint_m_s: float = math.inf
    """Largest speed of a set point, m/s."""
    setpoint_m_s2: float = math.inf
    """Largest acceleration of a set point, and its deceleration at an order, m/s²."""

    def begin(self, measurement: Measurement, coming: bool) -> Served:
        """Return the state at the first sample in contact, at the reported position of the robot.

        `coming` states whether the robot approaches at a constant speed, as at a first touch; otherwise it is
        stationary.
        """
        speed = (measurement.commanded - measurement.position) / self.lag_s if coming else 0.0
        return Served(measurement.position, speed, measurement.commanded, speed)

    def after(self, served: Served, measurement: Measurement) -> Served:
        """Return the state after a sample, by the backward Euler method, which is stable for any step size."""
        reported, dt = measurement.position, measurement.dt
        setpoint, setpoint_speed = self._move(served, measurement.commanded, dt)
        frequency = 2.0 * self.damping / self.lag_s
        pull = dt * frequency
        speed = served.speed + pull * frequency * (setpoint - served.position)
        speed /= 1.0 + pull * (2.0 * self.damping + pull)
        position = served.position + dt * speed
        position = within(position, reported - self.error_m, reported + self.error_m)
        return Served(position, speed, setpoint, setpoint_speed)

    def _move(self, served: Served, order: float, dt: float) -> tuple[float, float]:
        """Return the set point after a sample and its speed. It never passes the order. If the order is in the other
        direction, the set point has no speed at first.
        """
        gap = order - served.setpoint
        if not dt:
            return served.setpoint, served.setpoint_speed
        if not gap:
            return order, 0.0
        direction, distance = math.copysign(1.0, gap), abs(gap)
        speed = max(served.setpoint_speed * direction, 0.0) + self.setpoint_m_s2 * dt
        speed = min(speed, self.setpoint_m_s, math.sqrt(2.0 * self.setpoint_m_s2 * distance))
        if speed * dt >= distance:
            return order, direction * distance / dt
        return served.setpoint + direction * speed * dt, direction * speed
