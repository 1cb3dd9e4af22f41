"""Check that the robot follows its orders within its usual time. Pure.

A robot that carries out its orders with increasing delay, or moves farther than ordered, still reports its true
position, but that position matches none of the recent orders. The recently ordered depths form a band from the
smallest to the largest. A robot that follows its orders is within this band. The orders are kept in a few time
slots, so that a fast cycle needs no more memory or time than a slow one.
"""

from dataclasses import dataclass
from typing import TypeAlias

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation

Trail: TypeAlias = tuple[tuple[float, float, float], ...]
"""Time slots, oldest first: start of the slot, s, and the smallest and the largest depth ordered in it, m."""

PARTS = 4
"""Number of time slots. Chosen: the band covers at most a quarter more time than necessary."""


@dataclass(frozen=True, slots=True)
class Following:
    """Check that a robot carries out each order within a given time."""

    within_s: float
    """Time limit for the robot to carry out an order, including a margin, s."""
    step_m: float = 0.0
    """Resolution of the robot's position, m."""

    def after(self, trail: Trail, depths: tuple[float, float], now: float, at: float | None) -> Trail:
        """Return the trail with the depth ordered at time `now`, s. Orders that a pose of time `at` has passed are
        dropped.

        `depths` holds the reported and the ordered depth, m. A trail begins at the robot's previous position.
        """
        reported, depth = depths
        trail = trail or self._begin(now, reported)
        passed = (now if at is None else at) - self.within_s
        while len(trail) > 1 and trail[1][0] <= passed:
            trail = trail[1:]
        began, low, high = trail[-1]
        if now - began >= self.within_s / PARTS:
            return trail + ((now, depth, depth),)  # noqa: RUF005 – half the time of unpacking
        if low <= depth <= high:
            return trail
        return (*trail[:-1], (began, min(low, depth), max(high, depth)))

    def _begin(self, now: float, reported: float) -> Trail:
        return ((now, min(reported, 0.0), max(reported, 0.0)),)

    def fault(self, trail: Trail, observation: Observation, limits: Limits) -> str:
        """Return the reason why a robot at the reported depth does not follow its orders; empty if it may follow
        them.
        """
        depth = observation.depth
        if not trail or observation.sample.tilt is None:
            return ""
        allowed = limits.path_error_mm * 1e-3 + self.step_m
        _, lowest, deepest = trail[-1]
        if (
            lowest - allowed <= depth <= deepest + allowed
        ):  # already true for the newest slot in nearly every cycle
            return ""
        _, lows, depths = zip(*trail, strict=True)
        lowest, deepest = min(lows), max(depths)
        if lowest - allowed <= depth <= deepest + allowed:
            return ""
        outside, side = max((lowest - depth, "behind"), (depth - deepest, "ahead of"))
        return (
            f"the reported position is {outside * 1e3:.2f} mm {side} all that was ordered in the last "
            f"{self.within_s * 1e3:.0f} ms, allowed: at most {limits.path_error_mm:g} mm"
        )
