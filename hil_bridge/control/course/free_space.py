"""Proof that the sensor lives while the tool moves through free space, where no force answers a move. Pure.

There the reading from the zero is 0, and it is noisy. A reading that lost the tool's weight tells a pull or a press
instead. Counts that stay identical while the tool moves are those of a converter that stands still.
"""

import math

from msgspec import Struct

from hil_bridge.control.course.limits import Limits
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Vector

LASTS_S = 0.15
"""Time for which a pull must last in free space before it counts. Chosen: two samples of a line of 180 ms, and longer
than the shock of a start or a single peak.
"""


class FreeSpace(Struct, frozen=True):
    """The sensor's behaviour since the tool moves through free space."""

    at: Vector
    """Reported position when the counts changed last, base frame, m."""
    pulled_since: float | None = None
    """When the pull began that lasts, s on the run's clock; None if there is none."""


def watch_sample(
    before: FreeSpace | None, limits: Limits, now: float, pull: float, counts: tuple[bool, Vector]
) -> FreeSpace:
    """Return the state with one more sample.

    `pull` is the force away from the surface, N, from the newest zero. `counts` are whether the sensor's counts
    have changed since the sample before, and the reported position, base frame, m.
    """
    changed, position = counts
    since = None
    if pull > limits.weight_tolerance_n:
        since = now if before is None or before.pulled_since is None else before.pulled_since
    return FreeSpace(position if changed or before is None else before.at, since)


def lifeless(
    state: FreeSpace, limits: Limits, now: float, pull: float, unchanged: tuple[float, Vector]
) -> Reason | None:
    """Why the sensor cannot be one that lives; None while it may be. `unchanged` is the time for which its
    counts have been identical, s, and the reported position, base frame, m.
    """
    if state.pulled_since is not None and now - state.pulled_since >= LASTS_S:
        return Reason(
            Cause.LOST_WEIGHT,
            f"the sensor reads a pull of {pull:.1f} N where the tool in free space must read 0: it lost the tool's "
            "weight, its zero has changed, or what the tool has left holds on to it",
        )
    still, position = unchanged
    moved_mm = math.dist(state.at, position) * 1e3
    if still * 1e3 > limits.stale_after_ms and moved_mm > limits.unchanged_mm:
        return Reason(
            Cause.UNCHANGED,
            f"the force sensor repeated the same counts for {still:.2f} s while the tool moved {moved_mm:.1f} mm "
            "through free space",
        )
    return None
