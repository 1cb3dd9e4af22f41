"""Orders that an emulated robot received over its wire, whether accepted or not, for the assessment of clients.

A robot reports its orders to one listener. Without a listener, nothing is stored and nothing is computed.
"""

import math
from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple, Protocol, runtime_checkable

from protocol.geometry import Pose


class Act(StrEnum):
    """Kind of an order."""

    MOTION = "motion"
    """The order moves the tool to a position, or at a given speed."""
    PROGRAM = "program"
    """The order loads or starts a program of the robot, which may move the tool."""
    RELEASE = "release"
    """The order releases a stop or switches the power on: actions that are reserved to an operator at the robot."""
    CONTACT = "contact"
    """The order only shows that the client is present: a connection, or a query."""
    UNREADABLE = "unreadable"
    """The robot cannot decode the order."""
    REFUSED = "refused"
    """The order requests a mode or a variable that this emulated robot, as configured, does not have."""


class Reach(NamedTuple):
    """Limits within which a robot follows orders sent once per cycle.

    An order that is farther from the previous order is a leap.
    """

    cycle_s: float
    """Time between two orders that the robot expects, s."""
    speed_m_s: float
    """Maximum speed of the tool, m/s."""
    turn_rad_s: float = math.inf
    """Maximum turn rate of the tool, rad/s."""
    plans_own_path: bool = False
    """Whether the robot plans a path of its own to each position at this speed. A distant position alone is then
    not a leap.
    """


class ReceivedOrder(NamedTuple):
    """Order as the robot interpreted it."""

    at: float
    """Time at which the order arrived, s."""
    act: Act
    words: str
    """Description of the order in the terminology of the robot."""
    taken: bool
    """Whether the robot could execute the order in its state at that time."""
    pose: Pose | None = None
    """Commanded tool pose, base frame, m; None for an order without a position."""
    moves: bool = True
    """Whether an order without a position moves the tool; False for a speed of zero."""
    reach: Reach | None = None
    """Limits within which the robot follows the order; None if any position and speed is allowed, as for a planned
    move.
    """
    tool: Pose | None = None
    """Reported tool pose at the time of arrival, in the same frame and unit as `pose`; None if it equals the true
    pose.
    """
    speed: tuple[float, float] = (0.0, 0.0)
    """Commanded speed, m/s, and turn rate, rad/s; zero for an order with a position."""
    breach: str = ""
    """Description of a protocol rule that the order breaks and the robot tolerates; empty if the order breaks no
    rule.
    """


class Hindrance(NamedTuple):
    """Reason why the robot does not follow motion orders."""

    words: str
    by_order: bool
    """Whether an order of the client caused this state, for example a leap or a position out of reach."""


class Orders:
    """Reporter of the orders that a robot receives."""

    __slots__ = ("listener",)

    def __init__(self) -> None:
        self.listener: Callable[[ReceivedOrder], object] | None = None
        """Callback for each order, at once; None if orders are not recorded."""

    def tell(self, order: ReceivedOrder) -> None:
        """Report an order to the listener. Has no effect without a listener."""
        if self.listener is not None:
            self.listener(order)


@runtime_checkable
class ReportingRobot(Protocol):
    """Optional extension of an `EmulatedRobot` that reports its orders, so that its client can be assessed."""

    orders: Orders

    def hindrance(self, now: float) -> Hindrance | None:
        """Return why the robot does not follow motion orders at this time, s; None if it follows them."""
