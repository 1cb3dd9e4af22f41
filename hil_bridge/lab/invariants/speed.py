"""The tool moves no faster than the path velocity that the robot was given."""

from collections.abc import Iterator

import numpy as np

from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation

FASTER_SHARE = 1.5
"""Chosen: a servo that catches up may be faster by this factor; the guard judges a reported position by the same."""
WINDOW_S = 0.1
"""Chosen: the speed is a mean over at least so long, s: a servo rings within less."""


def too_fast(evidence: Evidence) -> Iterator[Violation]:
    """The fastest motion of the true tool, if it was too fast."""
    truth = evidence.truth
    if truth is None or truth.positions is None or len(truth.times) < 2:
        return
    later = np.searchsorted(truth.times, truth.times + WINDOW_S)
    first = np.flatnonzero(later < len(truth.times))
    if not len(first):
        return
    way = np.linalg.norm(truth.positions[later[first]] - truth.positions[first], axis=1)
    speeds = way / (truth.times[later[first]] - truth.times[first])
    place, allowed = int(np.argmax(speeds)), evidence.config.robot.velocity_mm_s * 1e-3 * FASTER_SHARE
    if speeds[place] > allowed:
        figures = {"true_mm_s": float(speeds[place]) * 1e3, "allowed_mm_s": allowed * 1e3}
        yield Violation(Promise.SPEED, float(truth.times[first[place]]), figures)
