"""Position loops of a servo: the closed form of one axis, and three axes on a resolution grid with a dead band.

Source: project specification of the computer link, section 6. The dead band comes from the paper's discussion of
position resolution.

At tick k (`powered_at + k * period`), a set point is issued. One transport delay later, the position loops receive
it. Between two successive times of this second grid, the input of a loop is constant, so its state has a closed
form.

A loop turns itself off inside the dead band. If the set point equals the reported position when the loop receives
it, the loop holds the axis at its current position until the set point changes or the axis leaves the band.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from protocol.geometry import Vector
from protocol.marks import Mark, above, at_least, between, check_settings, setting

Floats: TypeAlias = NDArray[np.float64]

REST_M = 1e-10
"""Largest distance from its input at which an axis counts as stationary, m. It must also move less than this
distance in one time constant.
"""
NOTHING: Vector = (0.0, 0.0, 0.0)
"""Zero offset, m."""


@dataclass(frozen=True, slots=True)
class ServoProfile:
    """Interpolation and position loops; the defaults are assumed for the S3, whose values are not public."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    interpolation_ms: float = setting(
        20.0, Mark.ASSUMED, "time between two set points of the interpolator", at_least(1.0), unit="ms"
    )
    transport_delay_ms: float = setting(
        20.0,
        Mark.ASSUMED,
        "delay from interpolator to position loop",
        between(0.0, 1000.0),
        unit="ms",
    )
    natural_frequency_rad_s: float = setting(
        40.0, Mark.ASSUMED, "natural frequency of the closed position loop", above(0.0), unit="rad/s"
    )
    damping_ratio: float = setting(1.0, Mark.ASSUMED, "damping ratio of the closed position loop", above(0.0))
    resolution_mm: float = setting(
        0.125, Mark.OBSERVED, "position resolution of the controller", above(0.0), unit="mm"
    )
    dead_band_steps: float = setting(
        0.5,
        Mark.OBSERVED,
        "maximum difference between the true and the reported position that the controller ignores",
        at_least(0.5),
        unit="resolution steps",
    )
    reorientation_deg_s: float = setting(
        90.0, Mark.ASSUMED, "maximum turn rate of the tool along a move", above(0.0), unit="°/s"
    )

    def __post_init__(self) -> None:
        check_settings(self)


class PositionLoop:
    """Closed second-order position loop of one axis with constant input, in closed form.

    With error e (position minus input) the state after `tau` is
    e = a·e0 + b·v0 and v = -ωn²·b·e0 + (a - 2ζωn·b)·v0.
    """

    def __init__(self, natural_frequency: float, damping_ratio: float) -> None:
        """`natural_frequency` is ωn, rad/s, and `damping_ratio` is ζ."""
        self.stiffness = natural_frequency**2
        self.drag = 2.0 * damping_ratio * natural_frequency
        self._damping_ratio = damping_ratio
        self._split = natural_frequency * math.sqrt(abs(1.0 - damping_ratio**2))
        """Half the difference of the two decay rates, or, if underdamped, the frequency of the oscillation, rad/s."""

    @overload
    def response(self, tau: float) -> tuple[float, float]: ...

    @overload
    def response(self, tau: Floats) -> tuple[Floats, Floats]: ...

    def response(self, tau: Floats | float) -> tuple[Floats | float, Floats | float]:
        """Return the coefficients a and b of the class docstring at the times `tau`, s, (n,) or scalar."""
        decay_rate, split = self.drag / 2.0, self._split
        if split == 0.0:
            even: Floats | float = np.exp(-decay_rate * tau)
            if isinstance(tau, float):  # numpy's exponential, then Python floats
                even = float(even)
            b: Floats | float = tau * even
        elif self._damping_ratio < 1.0:
            decay = np.exp(-decay_rate * tau)
            even = decay * np.cos(split * tau)
            b = decay * np.sin(split * tau) / split
        else:
            slow = np.exp((split - decay_rate) * tau)
            fast = np.exp(-(split + decay_rate) * tau)
            even = (slow + fast) / 2.0
            b = (slow - fast) / (2.0 * split)
        return even + decay_rate * b, b

    def over(self, period: float) -> tuple[float, float, float, float]:
        """Return the factors of e0 and v0 in e, and then in v, after `period`, s."""
        a, b = map(float, self.response(period))
        return a, b, -self.stiffness * b, a - self.drag * b

    def factors(
        self, inputs: list[float], errors: list[float], speeds: list[float], offset: Vector = NOTHING
    ) -> tuple[float, ...]:
        """Return the factors of 1, a and b in the three true positions, then in the three velocities.

        The result has 18 numbers. `inputs` and `errors` are in m, `speeds` in m/s. `offset` is the error of the
        measured position, m.
        """
        stiffness, drag = self.stiffness, self.drag
        px, py, pz = inputs
        ex, ey, ez = errors
        vx, vy, vz = speeds
        ox, oy, oz = offset
        # fmt: off
        return (
            px - ox, ex, vx,
            py - oy, ey, vy,
            pz - oz, ez, vz,
            0.0, vx, -stiffness * ex - drag * vx,
            0.0, vy, -stiffness * ey - drag * vy,
            0.0, vz, -stiffness * ez - drag * vz,
        )
        # fmt: on


@dataclass(frozen=True, slots=True)
class Ticks:
    """Two shifted time grids of a servo.

    Set points are issued at the times of the first grid, and the loops receive them at the times of the second.
    """

    powered_at: float
    """Time of tick 0, s."""
    period: float
    """Time from one tick to the next, s."""
    delay: float
    """Delay from a tick to the time at which the loops receive its set point, s."""


class Mechanics:
    """Constants of a powered servo: its time grids, its resolution and its loop."""

    def __init__(self, profile: ServoProfile, powered_at: float) -> None:
        self.ticks = Ticks(powered_at, profile.interpolation_ms / 1000.0, profile.transport_delay_ms / 1000.0)
        self.step = profile.resolution_mm / 1000.0
        self.turn_rate = math.radians(profile.reorientation_deg_s)
        self.rest_speed = REST_M * profile.natural_frequency_rad_s
        self.loop = PositionLoop(profile.natural_frequency_rad_s, profile.damping_ratio)
        self.over_a_tick = self.loop.over(self.ticks.period)
        self._band = profile.dead_band_steps

    def report(self, position: float, before: int) -> int:
        """Return the resolution step that is reported for a measured position, given the previously reported step."""
        steps = position / self.step
        return before if abs(steps - before) <= self._band else round(steps)


class Loops:
    """State of three axes at the time at which they receive a set point; `after_tick` returns the state one tick
    later.

    All positions are positions that the controller measures. The true position is the measured position minus the
    encoder offset.
    """

    __slots__ = ("_error", "_input", "_mechanics", "_velocity", "offset", "reported", "resting", "set_point")

    def __init__(self, mechanics: Mechanics, position: Vector) -> None:
        """Start with stationary loops at this position."""
        self._mechanics = mechanics
        self.set_point = [round(p / mechanics.step) for p in position]
        """Set point, resolution steps."""
        self.reported = self.set_point
        """Reported position, resolution steps."""
        self.offset = NOTHING
        """Error of the measured position, m."""
        self.resting = True
        self._input = list(position)
        self._error = [0.0, 0.0, 0.0]
        self._velocity = [0.0, 0.0, 0.0]

    def factors(self) -> tuple[float, ...]:
        """Return the factors of `PositionLoop.factors` from this time on."""
        return self._mechanics.loop.factors(self._input, self._error, self._velocity, self.offset)

    def reports(self, tau: float) -> list[int]:
        """Return the reported position, in resolution steps, `tau` seconds after this time."""
        mechanics = self._mechanics
        (a,), (b,) = (part.tolist() for part in mechanics.loop.response(np.array([tau])))
        state = zip(self._input, self._error, self._velocity, self.offset, self.reported, strict=True)
        return [
            mechanics.report(pulled_to - offset + a * error + b * velocity + offset, step)
            for pulled_to, error, velocity, offset, step in state
        ]

    def after_tick(self, at: Vector, jump: Vector = NOTHING) -> "Loops":
        """Return the loops one tick later, when they receive the set point nearest to `at`, m.

        At that time, the measured position jumps by `jump`, m.
        """
        mechanics = self._mechanics
        a, b, c, d = mechanics.over_a_tick
        after = Loops.__new__(Loops)
        after._mechanics = mechanics
        after.set_point, after.reported = set_points, reports = [], []
        after._input, after._error, after._velocity = inputs, errors, velocities = [], [], []
        resting = True
        before = zip(
            at, self.set_point, self.reported, self._input, self._error, self._velocity, jump, strict=True
        )
        for target, old, reported_before, pulled_to, error, velocity, leap in before:
            set_point = round(target / mechanics.step)
            if set_point == old == reported_before and error == velocity == leap == 0.0:
                # The axis is stationary and stays so.
                position = pull = pulled_to
                reported = set_point
            else:
                position = pulled_to + a * error + b * velocity + leap
                velocity = c * error + d * velocity
                reported = mechanics.report(position, reported_before)
                if reported != set_point:
                    pull = set_point * mechanics.step
                elif old == set_point == reported_before:
                    pull = pulled_to
                else:
                    pull = position
                error = position - pull
            if abs(error) < REST_M and abs(velocity) < mechanics.rest_speed:
                pull, error, velocity = position, 0.0, 0.0
                resting &= reported == set_point
            else:
                resting = False
            set_points.append(set_point)
            reports.append(reported)
            inputs.append(pull)
            errors.append(error)
            velocities.append(velocity)
        after.resting = resting
        after.offset = self.offset
        if jump != NOTHING:
            x, y, z = (offset + by for offset, by in zip(self.offset, jump, strict=True))
            after.offset = x, y, z
        return after
