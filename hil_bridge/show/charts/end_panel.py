"""Panel that states how a run ended, the same in a report and on the page of a run."""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from msgspec import Struct

from hil_bridge.errors.causes import Cause, describe_lateness
from hil_bridge.record.analysis.why import sentence
from hil_bridge.record.ending import Outcome, RunEnd
from hil_bridge.record.records import EventRecord

_STYLES = {Outcome.STOPPED: "alarm", Outcome.INTERRUPTED: "caution"}
"""Colours of the panel, as classes of `pages.css`."""


_QUANTITY = re.compile(r"(?<=\d) (?=(?:N·m|N|mm|ms|s|g)\b|%)")
"""Space between a number and its unit."""


class EndLine(NamedTuple):
    """Sentence of the panel."""

    text: str
    style: str = ""
    """Class of `pages.css`: `lead`, `alarm`, `todo` or `quiet`; empty for plain text."""


class EndPanel(Struct, frozen=True):
    """How a run ended."""

    outcome: str
    style: str
    """Colour of the panel: `alarm`, `caution` or empty."""
    lines: Sequence[EndLine]
    """Injected faults and cause, position of the tool, remedy, and details, in this order."""
    repeats: Sequence[str] = ()
    """Texts of events that the lines contain, so that a list of events does not repeat them."""


def end_panel(end: RunEnd, events: Iterable[EventRecord], when: str, lift: bool = False) -> EndPanel:
    """Return the panel. `when` describes time and phase of the end; it may be empty.

    `events` are those until the end, with the injected faults. With `lift`, the panel names the command that lifts
    the tool off.
    """
    faults = dict.fromkeys(one.fault.phrase for one in events if one.fault and one.fault.is_injected)
    stated = [end.reason] if end.reason and end.reason.fact else []
    return EndPanel(
        end.outcome,
        _STYLES.get(end.outcome, ""),
        [
            EndLine(unbreakable(text), style)
            for text, style in _lines(end, [] if end.outcome is Outcome.COMPLETED else [*faults], when, lift)
        ],
        repeats=[reason.fact for reason in (*stated, *end.followed)],
    )


def unbreakable(text: str) -> str:
    """Return a text that has no line break between a number and its unit."""
    return _QUANTITY.sub("\u00a0", text)


def _lines(end: RunEnd, faults: Sequence[str], when: str, lift: bool) -> Iterator[EndLine]:
    """Yield the lines; the first one leads."""
    reason, left = end.reason, end.place or end.left
    facts = [f"injected fault{'s' * (len(faults) > 1)}: {', '.join(faults)}"] if faults else []
    facts += [reason.fact] if reason is not None and reason.fact else []
    if not facts and end.outcome is not Outcome.COMPLETED:
        facts, when = [when] * bool(when), ""
    for place, text in enumerate(facts):
        yield EndLine(sentence(text), "" if place else "lead")
    if reason is not None and reason.facts:
        yield EndLine(sentence(reason.facts))
    for followed in end.followed:
        yield EndLine(f"Then: {followed.fact}.")
    known = end.place and end.rest.get("force_n") is not None and not end.rest.get("unverified")
    tool = (
        f"The tool was {left}{' measured' * bool(known)}{'; `hil-bridge free` lifts it off' * lift}"
        if left
        else "No position of the tool was recorded"
    )
    tool = "It is unknown where the tool is" if end.cause is Cause.CUT else tool
    yield EndLine(f"{tool}.", "alarm" if end.retracted is False else "" if facts else "lead")
    if reason is not None:
        if reason.remedy:
            yield EndLine(f"Next: {reason.remedy}.", "todo")
        details = (when, f"cause: {reason.cause}", describe_lateness(reason.late_s))
        yield EndLine(sentence("; ".join(filter(None, details))), "quiet")
