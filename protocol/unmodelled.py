"""Things that a real device has and an emulated one does not model: the value by which such a thing is told."""

from collections.abc import Sequence
from dataclasses import dataclass

NAMED = 8
"""Chosen: things that one sentence names; the others are counted."""


@dataclass(frozen=True, slots=True)
class NotModelled:
    """Something that a client used, and that has no effect, or no truth behind it, in the emulated device."""

    device: str
    """Kind of the emulated device."""
    thing: str
    """The thing that the client used, as the device's manual names it."""
    detail: str
    """Its treatment here."""

    def __str__(self) -> str:
        return f"{self.thing} of {self.device} is not modelled: {self.detail}"


def relied_on(things: Sequence[NotModelled]) -> str:
    """All of them in one sentence; empty if there are none."""
    if not things:
        return ""
    count = len(things)
    words = "1 thing that is" if count == 1 else f"{count} things that are"
    named = "; ".join(f"{each.thing} ({each.detail})" for each in things[:NAMED])
    more = f"; and {count - NAMED} more" if count > NAMED else ""
    return f"your client relied on {words} not modelled: {named}{more}"
