"""Targets of the emulated robot's joints: servoj's filter, even speeds, prescribed places, and braking.

Model of servoj, of each joint in each cycle dt, from the words of Universal Robots' script manual:
v += dt·κ·gain·(target - x - lookahead·v), x += dt·v. A slow motion then lags by the lookahead, whatever the gain.
Assumed: its form and the scale κ. Measurements of Universal Robots' users fit it: 34 ms with lookahead 30 ms.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from emulators.devices.rtde.kinematics import Joints

STILL = 1e-4
"""Chosen: a joint slower than this, rad/s, stands still."""
ZERO: Joints = (0.0,) * 6


class Servo(NamedTuple):
    """servoj: towards joints."""

    target: Joints
    lookahead: float
    """s"""
    gain: float
    cycles: int
    """It holds for so many cycles."""


class Speed(NamedTuple):
    """Joint speeds, reached with an acceleration, rad/s and rad/s²."""

    speeds: Joints
    acceleration: float


class Place(NamedTuple):
    """A place for the end of this cycle, of a motion that was planned."""

    target: Joints


class Brake(NamedTuple):
    """To a standstill, rad/s²."""

    deceleration: float


class Hold(NamedTuple):
    """Standstill at once, as with brakes."""


class Paces(NamedTuple):
    """Share of their speed, 0 … 1, that orders have by the speed slider."""

    servo: float = 1.0
    speed: float = 1.0


Order: TypeAlias = Servo | Speed | Place | Brake | Hold


class JointArm:
    """Joints and their velocities that the controller wants of its drives, cycle by cycle; see `drives`."""

    def __init__(self, joints: Joints, period: float, gain_scale: float, stop_deceleration: float) -> None:
        """At rest. `period` is the cycle, s; `stop_deceleration`, rad/s², holds where nothing is ordered."""
        self.joints, self.speeds = joints, ZERO
        """Joints, and the speeds that the program gives them, rad/s."""
        self.yielding = ZERO
        """Speeds that a force gives them beside, rad/s."""
        self.target = joints
        """Joints to which the program sends it: the argument of servoj."""
        self._period, self._scale = period, gain_scale
        self._stop = Brake(stop_deceleration)
        self.order: Order = self._stop
        self._left = 0
        """Cycles for which the order still holds."""

    @property
    def still(self) -> bool:
        """Whether no joint moves."""
        return max(map(abs, self.speeds)) < STILL

    @property
    def motion(self) -> Joints:
        """Speeds of the joints, rad/s."""
        if self.yielding is ZERO:
            return self.speeds
        return _six([a + b for a, b in zip(self.speeds, self.yielding, strict=True)])

    def settle(self) -> None:
        """No force moves it any more: it continues with the speed that it has, and brakes as its order says."""
        self.speeds, self.yielding = self.motion, ZERO

    def yield_to(self, before: Joints, path: Joints, joints: Joints) -> None:
        """Note that a force moved the arm to other joints in the last cycle.

        `path` is where the program alone would have led from `before`.
        """
        dt = self._period
        self.speeds = _six([(b - a) / dt for a, b in zip(before, path, strict=True)])
        self.yielding = _six([(b - a) / dt for a, b in zip(path, joints, strict=True)])
        self.joints = joints
        if not isinstance(self.order, Servo):
            self.target = joints

    def stay(self, joints: Joints) -> None:
        """Note that the arm has not moved in the last cycle."""
        self.joints = self.target = joints
        self.speeds = self.yielding = ZERO

    def take(self, order: Order) -> None:
        """Do this in the next cycle; servoj for as long as it says."""
        self.order = order
        self._left = order.cycles if isinstance(order, Servo) else 1

    def step(self, paces: Paces) -> None:
        """One cycle. A braking arm is not slowed down (assumed); a place has been slowed down by its move."""
        if self._left:
            self._left -= 1
        else:
            self.order = self._stop
        dt, order = self._period, self.order
        if isinstance(order, Servo):
            self._servo(order, dt * paces.servo)
            return
        if isinstance(order, Place):
            a, b, c, d, e, f = ((new - old) / dt for new, old in zip(order.target, self.joints, strict=True))
            self.speeds, self.joints, self.target = (a, b, c, d, e, f), order.target, order.target
            return
        if isinstance(order, Hold):
            self.speeds = ZERO
            self.target = self.joints
            return
        wanted = _scaled(order.speeds, paces.speed) if isinstance(order, Speed) else ZERO
        limit = (order.acceleration if isinstance(order, Speed) else order.deceleration) * dt
        self.speeds = _towards(self.speeds, wanted, limit)
        a, b, c, d, e, f = (old + dt * speed for old, speed in zip(self.joints, self.speeds, strict=True))
        self.joints = self.target = a, b, c, d, e, f

    def _servo(self, order: Servo, dt: float) -> None:
        stiffness = self._scale * order.gain
        lookahead = order.lookahead
        self.target = order.target
        if order.target == self.joints and self.speeds == ZERO:
            return
        pull = dt * stiffness
        u, v, w, p, q, r = [
            v + pull * (wanted - x - lookahead * v)
            for x, v, wanted in zip(self.joints, self.speeds, order.target, strict=True)
        ]
        a, b, c, d, e, f = self.joints
        self.joints = a + dt * u, b + dt * v, c + dt * w, d + dt * p, e + dt * q, f + dt * r
        self.speeds = u, v, w, p, q, r


def _scaled(speeds: Joints, share: float) -> Joints:
    return speeds if share == 1.0 else _six([share * speed for speed in speeds])


def _towards(speeds: Joints, wanted: Joints, limit: float) -> Joints:
    """All speeds changed in one proportion, so that the arm keeps its direction; by no more than the limit."""
    changes = [to - now for now, to in zip(speeds, wanted, strict=True)]
    largest = max(map(abs, changes))
    if largest <= limit:
        return wanted
    return _six([now + change * limit / largest for now, change in zip(speeds, changes, strict=True)])


def _six(values: Sequence[float]) -> Joints:
    a, b, c, d, e, f = values
    return a, b, c, d, e, f
