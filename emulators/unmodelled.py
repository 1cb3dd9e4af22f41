"""Tells, once each, the things that a client uses and that an emulated device does not model, and counts them.

A client's text is a stranger's: so many names are kept and no more, each cut to a length and made printable.
"""

from collections import Counter
from collections.abc import Callable
from typing import Protocol, runtime_checkable

from protocol.unmodelled import NotModelled

KEPT = 64
"""Chosen: different things that are told of one device."""
LONGEST = 80
"""Chosen: characters of a name."""
OTHERS = "more"
"""Name of all things beyond `KEPT`."""


class Unmodelled:
    """Things of one device that a client has used."""

    __slots__ = ("_device", "_listener", "_told", "counts")

    def __init__(self, device: str) -> None:
        """`device` is its kind."""
        self._device = device
        self._listener: Callable[[NotModelled], object] | None = None
        self._told: dict[str, NotModelled] = {}
        self.counts: Counter[str] = Counter()
        """How often each was used, by name."""

    @property
    def things(self) -> tuple[NotModelled, ...]:
        """All of them, in the order in which they were used first."""
        return tuple(self._told.values())

    def touch(self, thing: str, detail: str) -> None:
        """Report that a client has used this; `detail` is its treatment here."""
        thing = "".join(
            sign if sign.isprintable() else "\N{REPLACEMENT CHARACTER}" for sign in thing[:LONGEST]
        )
        if thing not in self._told and len(self._told) >= KEPT:
            thing, detail = OTHERS, f"beyond {KEPT} names, which are not told apart"
        self.counts[thing] += 1
        if thing not in self._told:
            told = self._told[thing] = NotModelled(self._device, thing, detail)
            if self._listener is not None:
                self._listener(told)

    def follow(self, listener: Callable[[NotModelled], object]) -> None:
        """Tell each thing to this listener, those that were used before at once."""
        self._listener = listener
        for told in self.things:
            listener(told)


@runtime_checkable
class TaggingDevice(Protocol):
    """An emulated device that tells the things that it does not model."""

    unmodelled: Unmodelled
