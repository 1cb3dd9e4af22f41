"""Address of the other side of a datagram wire."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports.back_off import Notice

Address = TypeVar("Address", bound=Hashable)

IN_USE_S = 1.0
"""Time for which a peer counts as in use after a datagram, s. Chosen: a streaming robot sends a hundred datagrams
in this time, and a robot that restarts with another port takes longer to return.
"""

KNOWN_SIDES = 16
"""Number of senders that a listening wire can answer in addition to the newest one. Chosen: a device has one or two
clients.
"""

NOTICE_INTERVAL_S = 1.0
"""Shortest time between two notices of the same kind, s. Chosen: a stream of refused datagrams must not fill the
recording.
"""


MISSED = 3
"""Number of consecutive undeliverable datagrams after which a program that has sent datagrams counts as gone.
Chosen: network reports about datagrams before its first one may be read after that one.
"""


class Notices:
    """Filter that forwards at most one notice of a kind per `NOTICE_INTERVAL_S`."""

    __slots__ = ("_noticed_at", "_now", "_on_notice")

    def __init__(self, now: Callable[[], float], on_notice: Notice) -> None:
        self._now = now
        self._on_notice = on_notice
        self._noticed_at: dict[str, float] = {}

    def tell(self, kind: str, text: str) -> None:
        """Forward a notice, unless a notice of this kind was forwarded recently."""
        now = self._now()
        if now - self._noticed_at.get(kind, float("-inf")) >= NOTICE_INTERVAL_S:
            self._noticed_at[kind] = now
            self._on_notice(kind, text)


class Presence:
    """Presence of a program at the other end. It distinguishes a program that has left from a program that was
    never there.
    """

    __slots__ = ("_has_sent", "_missed", "_notices")

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._has_sent = False
        self._missed = 0
        """Number of undeliverable datagrams since the last datagram of the program."""

    def hear(self) -> None:
        """Record that the program has sent a datagram."""
        self._has_sent, self._missed = True, 0

    def miss(self, wire: str, place: str, advice: str) -> None:
        """Record that no program receives datagrams at this address."""
        self._missed += 1
        if not self._has_sent:
            self._notices.tell(EventKind.ABSENT, f"{wire}: {place} cannot be reached: {advice}")
        elif self._missed == MISSED:
            self._notices.tell(
                EventKind.LEFT, f"{wire}: the program at {place} has left; it had sent datagrams before"
            )


class Peer(Generic[Address]):
    """Other side of a wire. If an address is given, the peer is fixed; otherwise it is the last sender.

    A stranger is another address that sends while the peer is in use. The stranger becomes the peer or is refused.
    """

    __slots__ = ("_fixed", "_known", "_refuse", "_spoke_at", "address", "refused", "sender", "strangers")

    def __init__(self, address: Address | None = None, refuse: bool = False, sender: str = "") -> None:
        """`sender` is the only host whose datagrams are accepted; empty for any. Others are refused as strangers."""
        self.address = address
        """Address to send to; None until the other side has sent a datagram."""
        self.sender = sender
        self.strangers = 0
        """Number of datagrams from strangers."""
        self.refused = 0
        """Number of refused datagrams from strangers."""
        self._fixed = address is not None
        self._known: dict[Hashable, Address] = {}
        """Known senders, oldest first."""
        self._refuse = refuse
        self._spoke_at = float("-inf")

    def takes(self, source: Address, now: float) -> bool:
        """Return whether to accept a datagram from `source` that arrived at `now`, s."""
        if self.sender and isinstance(source, tuple) and source[0] != self.sender:
            self.strangers += 1
            self.refused += 1
            return False
        if source != self.address and self._is_used(now):
            self.strangers += 1
            if self._fixed or self._refuse:
                self.refused += 1
                return False
        if not self._fixed:
            self.address, self._spoke_at = source, now
            self.introduce(source)
        return True

    def introduce(self, address: Address) -> None:
        """Make a sender known, as if it had sent a datagram."""
        if address not in self._known:
            if len(self._known) >= KNOWN_SIDES:
                del self._known[next(iter(self._known))]
            self._known[address] = address

    def target(self, side: Hashable) -> Address | None:
        """Return the destination of a datagram that names `side`. This is `side` itself if it has sent to a
        listening wire, otherwise the address of the peer.
        """
        if side is None or self._fixed or side not in self._known:
            return self.address
        return self._known[side]

    def _is_used(self, now: float) -> bool:
        return self._fixed or now - self._spoke_at < IN_USE_S
