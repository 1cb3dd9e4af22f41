"""The model in words: its phases, the size of a search, the rules, and where a recording leaves it."""

from collections.abc import Iterator

from hil_bridge.errors.cause_row import When
from hil_bridge.lab.guard_model.model import PHASES, GuardModel, GuardState, GuardStep, Told
from hil_bridge.lab.guard_model.searching import GuardRule, GuardSearch
from hil_bridge.lab.guard_model.tracing import Unaccepted


def describe_model(model: GuardModel, found: GuardSearch) -> Iterator[str]:
    """Every phase with its orders, conditions and followers; then what the search found."""
    for phase in PHASES:
        yield f"{phase}:"
        orders = sorted(model.asks.get(phase, ()))
        yield f"  orders        {', '.join(way.name.lower() for way in orders) or 'nothing'}"
        whens = [when.value for when in When if when in model.looks[phase]]
        yield f"  looked at     {'; '.join(whens) or 'nothing'}: {len(model.conditions(phase))} conditions"
        for words, table in (("goes on", model.follows), ("once it ends", model.ends)):
            after = [each for each in PHASES if each in table.get(phase, ())]
            if after:
                yield f"  {words:<14}{', '.join(after)}"
    yield ""
    yield f"{found.states} states, {found.steps} steps: no condition, each alone, and every two at once"
    for rule in GuardRule:
        yield f"  {'BROKEN' if rule in found.broken else 'holds ':<8}{rule.value}"
        for step in found.broken.get(rule, ()):
            yield f"            {describe_step(step)}"


def describe_step(step: GuardStep) -> str:
    """A step in a line: its conditions, its order, and where it leads."""
    held = " and ".join(step.conditions) or "no condition"
    ordered = "nothing ordered" if step.way is None else step.way.name.lower()
    return f"{held}: {ordered}, then {describe_state(step.after)}"


def describe_state(state: GuardState) -> str:
    """A state in a line."""
    code = "goes on" if state.code is None else f"will end with exit code {state.code}"
    place = "away from the surface" if state.away else "deeper than the start, or not known"
    told = f", told: {state.told}" if state.told is not Told.NOTHING else ""
    return f"{state.phase} ({state.stage}), {code}, {place}{told}"


def describe_unaccepted(found: Unaccepted) -> Iterator[str]:
    """Where a recording leaves the model, and where the run may have been before."""
    if found.shown is None:
        yield f"the model does not accept the end of the run, behind {found.cycle} cycles, at {found.at:.3f} s"
    else:
        shown = found.shown
        causes = " and ".join(shown.causes) or "no condition"
        held = ", held by a clamp" if shown.held else ""
        place = "away" if shown.away else "deeper than the start"
        yield f"the model does not accept cycle {found.cycle}, at {found.at:.3f} s"
        yield f"  it shows {shown.phase} with {causes}: {shown.way.name.lower()}{held}, then {place}"
    yield "  before it the run may be in"
    for state in found.states:
        yield f"    {describe_state(state)}"
