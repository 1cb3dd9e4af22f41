"""Whether the robot goes the way that it is ordered to, in the time that it has always taken for it. Pure.

A robot that takes its orders later and later, or does more than they say, reports truly where it is. It then stands
where no order of the last moments was. The depths that were ordered lately make a band: between the least and the
deepest. A robot that follows is in it. The orders are kept in some parts of that time, so that a quick cycle costs no
more than a slow one.
"""

from dataclasses import dataclass
from typing import TypeAlias

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation

Trail: TypeAlias = tuple[tuple[float, float, float], ...]
"""Begin of a part of time, s, and the least and the deepest depth ordered in it, m; oldest first."""

PARTS = 4
"""Parts of the time. Chosen: the band is by a quarter of it too wide at most."""


@dataclass(frozen=True, slots=True)
class Following:
    """The watch over a robot that has done an order after this time."""

    within_s: float
    """Time from an order to where the robot has done it, with a margin, s."""
    step_m: float = 0.0
    """Resolution of its position, m."""

    def after(self, trail: Trail, depths: tuple[float, float], now: float, at: float | None) -> Trail:
        """Return the trail with the depth that is ordered now, s, and without what a pose of the time `at` has passed.

        `depths` are the reported and the ordered one, m: a trail begins with the place that the robot comes from.
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

    def fault(self, trail: Trail, seen: Observation, limits: Limits) -> str:
        """Why a robot at the reported depth does not follow, in words; empty while it may."""
        depth = seen.depth
        if not trail or seen.sample.tilt is None:
            return ""
        allowed = limits.path_error_mm * 1e-3 + self.step_m
        _, lowest, deepest = trail[-1]
        if lowest - allowed <= depth <= deepest + allowed:  # in the newest part, as in nearly every cycle
            return ""
        _, lows, depths = zip(*trail, strict=True)
        lowest, deepest = min(lows), max(depths)
        if lowest - allowed <= depth <= deepest + allowed:
            return ""
        outside, side = max((lowest - depth, "behind"), (depth - deepest, "ahead of"))
        return (
            f"the reported position is {outside * 1e3:.2f} mm {side} all that was ordered in the last "
            f"{self.within_s * 1e3:.0f} ms, allowed are {limits.path_error_mm:g} mm"
        )
