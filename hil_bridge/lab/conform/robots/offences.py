"""Orders of a client that break a rule, with what the robot did with them."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from math import degrees

from emulators.orders import ReceivedOrder
from hil_bridge.lab.conform.robots.scenarios import Rules
from hil_bridge.lab.conform.robots.strides import Stride


class Offence(StrEnum):
    """Rule that an order breaks."""

    UNREADABLE = "unreadable"
    BREACH = "breach"
    LEAP = "leap"
    TURN = "turn"
    RUSH = "rush"
    AFTER_STOP = "after stop"
    """The order would have moved the tool later than `react_s` after the fault."""
    RELEASE = "release"


@dataclass(frozen=True, slots=True)
class Offender:
    """First order with an offence. Times are in s since the start of the scenario."""

    offence: Offence
    at: float
    text: str
    """Description of the order, or of its breach, in the terminology of the robot."""
    step_m: float
    is_accepted: bool
    """Whether the robot could execute the order."""
    before_at: float | None
    """Time of the previous order; None if there was none."""


def find_offences(order: ReceivedOrder, stride: Stride, rules: Rules) -> Iterator[Offence]:
    """Yield the offences of a motion order at any time. If a rule is 0, the limit of the robot applies."""
    if order.breach:
        yield Offence.BREACH
    if stride.step_m * 1e3 > rules.max_step_mm if rules.max_step_mm else stride.leaps:
        yield Offence.LEAP
    if degrees(stride.turn_rad) > rules.max_turn_deg if rules.max_turn_deg else stride.turns:
        yield Offence.TURN
    if stride.rushes and not rules.max_speed_mm_s:
        yield Offence.RUSH
