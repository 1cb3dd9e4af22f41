"""The small model of the guard accepts every cycle of a run, and its end."""

from collections.abc import Iterator, Mapping

from hil_bridge.lab.guard_model import GuardModel, Unaccepted, first_unaccepted
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation

_MODEL = GuardModel()


def unaccepted_cycles(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first cycle, or the end, that the model does not accept, and what the recording shows there."""
    found = first_unaccepted(evidence.recording, _MODEL)
    if found is not None:
        detail = _detail(found, evidence.recording.end)
        yield Violation(Promise.MODEL, found.at, {"cycle": float(found.cycle)}, detail=detail)


def _detail(found: Unaccepted, end: Mapping[str, str]) -> str:
    """Return the phase, the causes and the order of a cycle, or the outcome and the cause of the end, as text."""
    shown = found.shown
    if shown is None:
        outcome, cause = end["outcome"], end.get("cause") or "none"
        return f"the end of the run after {found.cycle} cycles (outcome: {outcome}; cause: {cause})"
    causes = ", ".join(shown.causes) or "none"
    order = f"{shown.way.name.lower()}, clamped" if shown.held else shown.way.name.lower()
    return f"cycle {found.cycle} (phase: {shown.phase}; causes: {causes}; order: {order})"
