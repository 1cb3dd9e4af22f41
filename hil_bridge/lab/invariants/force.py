"""The bound of the true force: kept, as long as sensor and robot do not lie and nothing else moves."""

import math
from collections.abc import Iterator

import numpy as np

from hil_bridge.errors import ConfigError
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.force_bound import force_bound_n


def stated_bound_n(evidence: Evidence) -> float:
    """Largest true force that a run's facts allow, N; infinite where they do not tell it."""
    surface = evidence.config.cell.surface
    hardest = surface.stiffness_n_m
    if surface.wall_at_mm is not None:
        hardest = max(hardest, surface.wall_stiffness_n_m)
    try:
        return force_bound_n(evidence.config, devices_of(evidence.recording), float(hardest))
    except ConfigError:  # the sensor was never ready, so that nothing has moved
        return math.inf


def beyond_bound(evidence: Evidence) -> Iterator[Violation]:
    """The largest true force, if it is beyond the bound."""
    truth = evidence.truth
    if truth is None or not len(truth.forces):
        return
    place, bound_n = int(np.argmax(truth.forces)), stated_bound_n(evidence)
    true_n = float(truth.forces[place])
    if true_n > bound_n:
        yield Violation(Promise.BOUND, float(truth.times[place]), {"true_n": true_n, "bound_n": bound_n})
