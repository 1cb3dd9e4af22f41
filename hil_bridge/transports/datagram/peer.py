"""Which address a datagram wire speaks with."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports.back_off import Notice

Address = TypeVar("Address", bound=Hashable)

IN_USE_S = 1.0
"""For how long a peer that has spoken is in use, s. Chosen: a streaming robot speaks a hundred times within it, and
one that restarts with another port takes longer to come back."""

KNOWN_SIDES = 16
"""Sides that a wire which listens can answer, beside the newest. Chosen: a device has one or two clients."""

TELL_AGAIN_S = 1.0
"""Least time between two notices of one kind, s. Chosen: a stream of refused datagrams must not fill the record."""


MISSED = 3
"""Datagrams without a program at their end, in a row, by which one that was heard counts as gone. Chosen: what the
network told of datagrams before its first one may be read behind that.
"""


class Notices:
    """Hands notices on, at most one of a kind for each `TELL_AGAIN_S`."""

    __slots__ = ("_now", "_on_notice", "_told_at")

    def __init__(self, now: Callable[[], float], on_notice: Notice) -> None:
        self._now = now
        self._on_notice = on_notice
        self._told_at: dict[str, float] = {}

    def tell(self, kind: str, text: str) -> None:
        """Hand on, unless this kind was told just now."""
        now = self._now()
        if now - self._told_at.get(kind, float("-inf")) >= TELL_AGAIN_S:
            self._told_at[kind] = now
            self._on_notice(kind, text)


class Presence:
    """Tells a program that has left the other end from one that was never there."""

    __slots__ = ("_heard", "_missed", "_notices")

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._heard = False
        self._missed = 0
        """Datagrams for which no program was there since it was heard last."""

    def hear(self) -> None:
        """Note that the peer has sent something."""
        self._heard, self._missed = True, 0

    def miss(self, wire: str, place: str, advice: str) -> None:
        """No program takes a datagram at this place."""
        self._missed += 1
        if not self._heard:
            self._notices.tell(EventKind.ABSENT, f"{wire}: {place} cannot be reached: {advice}")
        elif self._missed == MISSED:
            self._notices.tell(
                EventKind.LEFT, f"{wire}: the program at {place} has left; it was heard before"
            )


class Peer(Generic[Address]):
    """The other side of a wire. It is fixed when an address is given, else it is the side that spoke last.

    A stranger is another address that speaks while the peer is in use. It becomes the peer, or it is refused.
    """

    __slots__ = ("_fixed", "_known", "_refuse", "_spoke_at", "address", "refused", "strangers")

    def __init__(self, address: Address | None = None, refuse: bool = False) -> None:
        self.address = address
        """Address to send to, or None before the other side has spoken."""
        self.strangers = 0
        """Datagrams of strangers."""
        self.refused = 0
        """Strangers that were refused."""
        self._fixed = address is not None
        self._known: dict[Hashable, Address] = {}
        """Sides that have spoken, the oldest first."""
        self._refuse = refuse
        self._spoke_at = float("-inf")

    def takes(self, source: Address, now: float) -> bool:
        """Whether a datagram of this source that came at `now`, s, is taken."""
        if source != self.address and self._is_used(now):
            self.strangers += 1
            if self._fixed or self._refuse:
                self.refused += 1
                return False
        if not self._fixed:
            self.address, self._spoke_at = source, now
            if source not in self._known:
                if len(self._known) >= KNOWN_SIDES:
                    del self._known[next(iter(self._known))]
                self._known[source] = source
        return True

    def target(self, side: Hashable) -> Address | None:
        """Where a datagram goes that names this side: there, if it has spoken to a wire that listens."""
        if side is None or self._fixed or side not in self._known:
            return self.address
        return self._known[side]

    def _is_used(self, now: float) -> bool:
        return self._fixed or now - self._spoke_at < IN_USE_S
