"""The bound of the true force: kept, as long as sensor and robot do not lie and nothing else moves."""

from collections.abc import Iterator

import numpy as np

from hil_bridge.invariants.evidence import Evidence, Promise, Violation
from hil_bridge.settings.configuration import Config

LATENCY_CYCLES = 3
"""Cycles from an order to the force that shows its effect: answer, motion, filter, and the cycle that sees it."""
ASKED_CYCLE_S = 0.187
"""Longest cycle of a robot that is asked. Source: the paper's chain, whose cycle takes 172 … 187 ms."""


def stated_bound_n(config: Config) -> float:
    """Largest true force that may come of what was ordered: the limit, and what is under way, N."""
    period = config.run.period_ms * 1e-3 or ASKED_CYCLE_S
    speed = max(config.limits.correction_mm_s, config.task.approach_speed_mm_s) * 1e-3
    stiffness = config.cell.surface.stiffness_n_m
    return config.limits.force_limit_n + float(stiffness) * speed * period * LATENCY_CYCLES


def beyond_bound(evidence: Evidence) -> Iterator[Violation]:
    """The largest true force, if it is beyond the bound."""
    truth = evidence.truth
    if truth is None or not len(truth.forces):
        return
    place, bound_n = int(np.argmax(truth.forces)), stated_bound_n(evidence.config)
    true_n = float(truth.forces[place])
    if true_n > bound_n:
        yield Violation(Promise.BOUND, float(truth.times[place]), {"true_n": true_n, "bound_n": bound_n})
