"""Joint targets of the emulated robot: servoj's filter, constant speeds, planned positions, and braking.

Model of servoj, for each joint in each cycle dt, after the description in Universal Robots' script manual: v +=
dt·κ·gain·(target - x - lookahead·v), x += dt·v. A slow motion then lags by the lookahead, regardless of the gain.
Assumed: this form and the scale κ. Measurements by users of Universal Robots fit it: a lag of 34 ms with a
lookahead of 30 ms.
"""

from typing import NamedTuple, TypeAlias

from emulators.arm.joint_loops import six
from emulators.devices.rtde.kinematics import Joints

STILL = 1e-4
"""Speed below which a joint is stationary, rad/s. Chosen."""
ZERO: Joints = (0.0,) * 6


class Servo(NamedTuple):
    """servoj command."""

    target: Joints
    lookahead: float
    """Look-ahead time, s."""
    gain: float
    cycles: int
    """Number of cycles for which the command applies."""


class Speed(NamedTuple):
    """Joint speeds, rad/s, to reach with an acceleration, rad/s²."""

    speeds: Joints
    acceleration: float


class Place(NamedTuple):
    """Joint positions at the end of this cycle, given by a planned motion."""

    target: Joints


class Brake(NamedTuple):
    """Deceleration to standstill, rad/s²."""

    deceleration: float


class Hold(NamedTuple):
    """Immediate standstill, as with brakes."""


class Paces(NamedTuple):
    """Speed scaling of commands by the speed slider, 0 … 1."""

    servo: float = 1.0
    speed: float = 1.0


Order: TypeAlias = Servo | Speed | Place | Brake | Hold


class JointArm:
    """Target joint angles and speeds that the controller sends to its drives in each cycle; see `drives`."""

    def __init__(self, joints: Joints, period: float, gain_scale: float, stop_deceleration: float) -> None:
        """Start stationary. `period` is the cycle time, s. `stop_deceleration`, rad/s², applies if there is no
        order.
        """
        self.joints, self.speeds = joints, ZERO
        """Target joint angles, rad, and the speeds that the program commands, rad/s."""
        self.yielding = ZERO
        """Additional speeds caused by a force, rad/s."""
        self.target = joints
        """Joint angles that the program commands as the target: the argument of servoj."""
        self._period, self._scale = period, gain_scale
        self._stop = Brake(stop_deceleration)
        self.order: Order = self._stop
        self._cycles_left = 0
        """Number of cycles for which the order still applies."""

    @property
    def still(self) -> bool:
        """Whether no joint moves."""
        return max(map(abs, self.speeds)) < STILL

    @property
    def motion(self) -> Joints:
        """Total joint speeds, rad/s."""
        if self.yielding is ZERO:
            return self.speeds
        return six([a + b for a, b in zip(self.speeds, self.yielding, strict=True)])

    def end_compliance(self) -> None:
        """End the motion by a force. The arm keeps its current speed, and brakes as its order requires."""
        self.speeds, self.yielding = self.motion, ZERO

    def yield_to(self, before: Joints, path: Joints, joints: Joints) -> None:
        """Record that a force moved the arm to other joint angles in the last cycle.

        `path` are the joint angles that the program's motion alone would have reached from `before`.
        """
        dt = self._period
        self.speeds = six([(b - a) / dt for a, b in zip(before, path, strict=True)])
        self.yielding = six([(b - a) / dt for a, b in zip(path, joints, strict=True)])
        self.joints = joints
        if not isinstance(self.order, Servo):
            self.target = joints

    def note_standstill(self, joints: Joints) -> None:
        """Record that the arm did not move in the last cycle."""
        self.joints = self.target = joints
        self.speeds = self.yielding = ZERO

    def take(self, order: Order) -> None:
        """Accept an order for the next cycle. A servoj order applies for its own number of cycles."""
        self.order = order
        self._cycles_left = order.cycles if isinstance(order, Servo) else 1

    def step(self, paces: Paces) -> None:
        """Advance by one cycle. Braking is not scaled by the speed slider (assumed). A move scales its planned
        positions itself.
        """
        if self._cycles_left:
            self._cycles_left -= 1
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
        desired = _scaled(order.speeds, paces.speed) if isinstance(order, Speed) else ZERO
        limit = (order.acceleration if isinstance(order, Speed) else order.deceleration) * dt
        self.speeds = _towards(self.speeds, desired, limit)
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
            v + pull * (desired - x - lookahead * v)
            for x, v, desired in zip(self.joints, self.speeds, order.target, strict=True)
        ]
        a, b, c, d, e, f = self.joints
        self.joints = a + dt * u, b + dt * v, c + dt * w, d + dt * p, e + dt * q, f + dt * r
        self.speeds = u, v, w, p, q, r


def _scaled(speeds: Joints, share: float) -> Joints:
    return speeds if share == 1.0 else six([share * speed for speed in speeds])


def _towards(speeds: Joints, desired: Joints, limit: float) -> Joints:
    """Change all speeds in proportion, which keeps the direction of the arm, by no more than the limit."""
    changes = [to - now for now, to in zip(speeds, desired, strict=True)]
    largest = max(map(abs, changes))
    if largest <= limit:
        return desired
    return six([now + change * limit / largest for now, change in zip(speeds, changes, strict=True)])
