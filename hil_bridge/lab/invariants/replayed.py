"""The replay of a run decides the same in every cycle."""

from collections.abc import Iterator

from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation
from hil_bridge.runs.replay import replay


def other_decisions(evidence: Evidence) -> Iterator[Violation]:
    """The first cycle that is decided otherwise, with the number of all of them."""
    others = [
        cycle.record
        for cycle in replay(evidence.recording, evidence.config, forced=False)
        if cycle.differences
    ]
    if others:
        yield Violation(Promise.REPLAY, others[0].started_at, {"cycles": float(len(others))})
