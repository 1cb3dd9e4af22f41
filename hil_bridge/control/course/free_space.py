"""Check that the sensor works while the tool moves through free space, where no force responds to motion. Pure.

In free space the force relative to the zero is 0 with noise. A sensor that no longer measures the tool's weight
reports a pull or a press instead. Counts that stay identical while the tool moves come from a converter that has
stopped.
"""

import math

from msgspec import Struct

from hil_bridge.control.course.limits import Limits
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Vector

LASTS_S = 0.15
"""Minimum duration of a pull in free space that counts as a fault, s. Chosen: two samples of a link with a cycle of
180 ms, and longer than the shock of a start or a single peak.
"""


class FreeSpace(Struct, frozen=True):
    """Behaviour of the sensor since the tool began to move through free space."""

    at: Vector
    """Reported position when the counts last changed, base frame, m."""
    pulled_since: float | None = None
    """Time at which the current pull began, s on the run's clock; None if there is no pull."""


def watch_sample(
    before: FreeSpace | None, limits: Limits, now: float, pull: float, counts: tuple[bool, Vector]
) -> FreeSpace:
    """Return the state after one more sample.

    `pull` is the force away from the surface relative to the newest zero, N. `counts` holds whether the sensor's
    counts have changed since the previous sample, and the reported position, base frame, m.
    """
    changed, position = counts
    since = None
    if pull > limits.weight_tolerance_n:
        since = now if before is None or before.pulled_since is None else before.pulled_since
    return FreeSpace(position if changed or before is None else before.at, since)


def dead_sensor_reason(
    state: FreeSpace, limits: Limits, now: float, pull: float, unchanged: tuple[float, Vector]
) -> Reason | None:
    """Return the reason why the sensor must be dead; None if it may work. `unchanged` holds the time for which its
    counts have been identical, s, and the reported position, base frame, m.
    """
    if state.pulled_since is not None and now - state.pulled_since >= LASTS_S:
        return Reason(
            Cause.LOST_WEIGHT,
            f"the sensor reads a pull of {pull:.1f} N although the tool is in free space: it lost the tool's "
            "weight, its zero has changed, or the tool is stuck to the surface",
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
