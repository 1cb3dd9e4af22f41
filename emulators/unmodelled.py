"""Counts and one-time reports of the features that a client uses and an emulated device does not model.

Names from a client are untrusted: their number and length are limited, and unprintable characters are replaced.
"""

from collections import Counter
from collections.abc import Callable
from typing import Protocol, runtime_checkable

from protocol.unmodelled import NotModelled

KEPT = 64
"""Maximum number of different features reported for one device. Chosen."""
LONGEST = 80
"""Maximum number of characters in a name. Chosen."""
OTHERS = "more"
"""Collective name of all features beyond `KEPT`."""


class Unmodelled:
    """Features that a client has used and one device does not model."""

    __slots__ = ("_by_name", "_device", "_listener", "counts")

    def __init__(self, device: str) -> None:
        """`device` is the kind of the device."""
        self._device = device
        self._listener: Callable[[NotModelled], object] | None = None
        self._by_name: dict[str, NotModelled] = {}
        self.counts: Counter[str] = Counter()
        """Number of uses of each feature, by name."""

    @property
    def things(self) -> tuple[NotModelled, ...]:
        """All features used so far, in the order of first use."""
        return tuple(self._by_name.values())

    def touch(self, thing: str, detail: str) -> None:
        """Report that a client has used this feature. `detail` states what the emulation does instead."""
        thing = "".join(
            char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in thing[:LONGEST]
        )
        if thing not in self._by_name and len(self._by_name) >= KEPT:
            thing, detail = OTHERS, f"beyond {KEPT} names, which are not distinguished"
        self.counts[thing] += 1
        if thing not in self._by_name:
            feature = self._by_name[thing] = NotModelled(self._device, thing, detail)
            if self._listener is not None:
                self._listener(feature)

    def follow(self, listener: Callable[[NotModelled], object]) -> None:
        """Report each feature to this listener. Features that have already been used are reported at once."""
        self._listener = listener
        for feature in self.things:
            listener(feature)


@runtime_checkable
class TaggingDevice(Protocol):
    """Emulated device that reports the features that it does not model."""

    unmodelled: Unmodelled
