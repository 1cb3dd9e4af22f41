"""No order goes deeper after a stop."""

import math
from collections.abc import Iterator

from hil_bridge.lab.guard_model.tracing import ROUNDING_M
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation
from hil_bridge.record import EventKind


def deeper_orders(evidence: Evidence) -> Iterator[Violation]:
    """The order that went deepest after the stop, if one did."""
    recording = evidence.recording
    stopped = next((event.at for event in recording.events if event.kind == EventKind.STOP), math.inf)
    after = [cycle for cycle in recording.cycles if cycle.answered_at >= stopped]
    worst, lowest = None, math.inf
    for cycle in after:
        deeper = cycle.depth_commanded - lowest
        if deeper > ROUNDING_M and (worst is None or deeper > worst[0]):
            worst = deeper, cycle.sent_at
        lowest = min(lowest, cycle.depth_commanded)
    if worst is not None:
        deeper, at = worst
        yield Violation(Promise.ORDERS, at, {"deeper_mm": deeper * 1e3, "after_s": at - stopped})
