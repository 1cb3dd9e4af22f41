"""Orders that came to an emulated robot over its wire, taken or not: for judges of clients.

A robot tells them to one listener. Without a listener nothing is kept, and nothing is computed.
"""

import math
from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple, Protocol, runtime_checkable

from protocol.geometry import Pose


class Act(StrEnum):
    """Kinds of orders."""

    MOTION = "motion"
    """It leads the tool to a place, or at a speed."""
    PROGRAM = "program"
    """It brings or starts a program of the robot's own, which may move the tool."""
    RELEASE = "release"
    """It releases a stop, or switches the power on: acts that belong to an operator at the robot."""
    CONTACT = "contact"
    """The client is there: a connection, or a question."""
    UNREADABLE = "unreadable"
    """The robot can make nothing of it."""
    REFUSED = "refused"
    """It asks for something that this emulated robot, as it is set up, does not have: a mode, a variable."""


class Reach(NamedTuple):
    """How fast a robot follows orders that come one a cycle. An order that is farther from the one before leaps."""

    cycle_s: float
    """Time between two orders for which the robot looks, s."""
    speed_m_s: float
    """Fastest that it takes its tool, m/s."""
    turn_rad_s: float = math.inf
    """Fastest that it turns its tool, rad/s."""
    own_way: bool = False
    """It plans a way of its own to each place, at this speed: a far place alone is no leap."""


class ReceivedOrder(NamedTuple):
    """An order as the robot understood it."""

    at: float
    """When it came, s."""
    act: Act
    words: str
    """The order in the robot's own words."""
    taken: bool
    """The robot could act on it as it was then."""
    pose: Pose | None = None
    """Where it leads the tool, base frame, m; None for an order that tells no place."""
    moves: bool = True
    """For an order without a place: whether it moves the tool. A speed of zero does not."""
    reach: Reach | None = None
    """How fast the robot follows it; None where any place and speed is an order for it, as of a planned move."""
    tool: Pose | None = None
    """The tool as the robot tells it now, in the terms of `pose`; None where it is the true tool."""
    speed: tuple[float, float] = (0.0, 0.0)
    """Speed that it orders, m/s, and of the turn, rad/s; zero for an order of a place."""
    breach: str = ""
    """A rule of the wire that it breaks and the robot bears, in words; empty for none."""


class Hindrance(NamedTuple):
    """A state in which the robot does not move by orders."""

    words: str
    by_order: bool
    """An order of the client brought it about, such as a leap or a place out of reach."""


class Orders:
    """Tells the orders that a robot hears."""

    __slots__ = ("listener",)

    def __init__(self) -> None:
        self.listener: Callable[[ReceivedOrder], object] | None = None
        """Called with each order at once; None while it is not wanted."""

    def tell(self, order: ReceivedOrder) -> None:
        """Report an order; no effect without a listener."""
        if self.listener is not None:
            self.listener(order)


@runtime_checkable
class ReportingRobot(Protocol):
    """Facts that an `EmulatedRobot` tells beside its motion, so that its client can be judged."""

    orders: Orders

    def hindrance(self, now: float) -> Hindrance | None:
        """Why it does not move by orders at this time, s; None where it would."""
