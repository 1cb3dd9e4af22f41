"""The small model of the guard accepts every cycle of a run, and its end."""

from collections.abc import Iterator

from hil_bridge.lab.guard_model import GuardModel, first_unaccepted
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation

_MODEL = GuardModel()


def unaccepted_cycles(evidence: Evidence) -> Iterator[Violation]:
    """The first cycle that the model does not accept. `hil-bridge supervisor model FILE` shows where it leaves it."""
    found = first_unaccepted(evidence.recording, _MODEL)
    if found is not None:
        yield Violation(Promise.MODEL, found.at, {"cycle": float(found.cycle)})
