"""Network of datagrams inside one event loop, exact in virtual time. Its faults are reproducible with the seed.

Each end has a path to the network, with its own delays and faults. A datagram passes both paths: the path of its
sender and the path of its receiver. The two directions of a path use separate random numbers.

Datagrams that are sent together arrive together if no path changes them. A sender may give a datagram the time at
which it left, `received_at`; it then arrives with the time at which it would have arrived.
"""

import itertools
import random
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from typing import TypeAlias

from hil_bridge.clock import Clock, Timer
from hil_bridge.clock.per_loop import of_loop
from hil_bridge.errors import TransportBroken, TransportError, TransportUnavailable
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports.back_off import Notice
from hil_bridge.transports.base import Datagrams
from hil_bridge.transports.datagram.peer import Notices, Peer, Presence
from hil_bridge.transports.datagram.statistics import QUEUE_DATAGRAMS, DatagramStatistics, check_sizes
from hil_bridge.transports.delivery import Delivery, TimedQueue
from protocol.datagram import Datagram, arrived_at, side_of

HELD_S = 0.1
"""Longest time for which a datagram is held so that the next one overtakes it, s. Chosen: several cycles of a
streaming robot.
"""

Timed: TypeAlias = list[tuple[float, bytes]]
"""Datagrams that travel together, each with its time, s."""


@dataclass(frozen=True, slots=True)
class Path:
    """Delays and faults between one end and the network, the same for both directions."""

    latency_s: float = 0.0
    """Delay of every datagram, s."""
    jitter_s: float = 0.0
    """Largest additional delay of a datagram, s; uniformly distributed from 0. It does not change the order."""
    loss: float = 0.0
    """Probability that a datagram is lost, 0 … 1."""
    duplicate: float = 0.0
    """Probability that a datagram arrives twice, 0 … 1."""
    reorder: float = 0.0
    """Probability that a datagram arrives right after the next one, or after `HELD_S` if there is no next one; 0 …
    1.
    """
    seed: int = 0
    """Seed of the random numbers."""

    @property
    def changes_nothing(self) -> bool:
        """Whether every datagram passes unchanged and without delay."""
        return not (self.latency_s or self.jitter_s or self.loss or self.duplicate or self.reorder)


@dataclass(slots=True)
class _Network:
    """Ends of all wires of one event loop, by address. A listener's address is its name, a client's address is the
    name and a number.
    """

    ends: dict[str, "MemoryDatagrams"] = field(default_factory=dict)
    numbers: "itertools.count[int]" = field(default_factory=lambda: itertools.count(1))


def _network(clock: Clock) -> _Network:
    """Return the network of this loop."""
    return of_loop(clock.loop, _Network, "network of datagrams")


def listen_memory(
    name: str, path: Path, clock: Clock, on_notice: Notice, refuse_strangers: bool = False
) -> "MemoryDatagrams":
    """Wait for datagrams of clients that use this name in this loop. Raises TransportUnavailable if the name is in
    use.
    """
    network = _network(clock)
    if name in network.ends:
        raise TransportUnavailable(f"udp+memory:{name}: the name is already in use; choose another")
    return MemoryDatagrams(name, Peer(refuse=refuse_strangers), path, clock, on_notice)


def connect_memory(name: str, path: Path, clock: Clock, on_notice: Notice) -> "MemoryDatagrams":
    """Open a wire to the listener of this name in this loop. The listener may start later; datagrams sent before
    are counted as unreachable.
    """
    network = _network(clock)
    return MemoryDatagrams(f"{name}#{next(network.numbers)}", Peer(name), path, clock, on_notice)


class MemoryDatagrams:
    """Transport of datagrams over the network of its loop."""

    __slots__ = (
        "_address",
        "_arriving",
        "_clock",
        "_counts",
        "_delivery",
        "_ends",
        "_leaving",
        "_notices",
        "_peer",
        "_presence",
        "introduce",
    )

    def __init__(self, address: str, peer: Peer[str], path: Path, clock: Clock, on_notice: Notice) -> None:
        name, _, number = address.partition("#")
        self._address = address
        self._peer = peer
        self.introduce = peer.introduce
        self._clock = clock
        self._delivery: Delivery[Datagrams] = Delivery(f"udp+memory:{name}", QUEUE_DATAGRAMS)
        self._notices = Notices(clock.now, on_notice)
        self._presence = Presence(self._notices)
        self._counts = {"sent": 0, "received": 0, "dropped": 0, "unreachable": 0}
        self._leaving = _Direction(path, f"{path.seed} {number} out", clock)
        self._arriving = None if path.changes_nothing else _Direction(path, f"{path.seed} {number} in", clock)
        self._ends = _network(clock).ends
        self._ends[address] = self

    @property
    def name(self) -> str:
        return self._delivery.name

    @property
    def statistics(self) -> DatagramStatistics:
        """Counts since opening."""
        leaving, arriving = self._leaving, self._arriving
        return DatagramStatistics(
            **self._counts,
            strangers=self._peer.strangers,
            refused=self._peer.refused,
            overruns=self._delivery.overruns + (arriving.full if arriving else 0),
            lost=leaving.lost + (arriving.lost if arriving else 0),
            duplicated=leaving.duplicated + (arriving.duplicated if arriving else 0),
        )

    def start(self, on_data: Callable[[Datagrams], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)

    def send(self, data: Datagrams) -> None:
        self._delivery.check()
        check_sizes(self.name, data)
        if len(data) == 1:
            self._send_to(side_of(data[0]), data)
        else:
            for side, together in groupby(data, side_of):
                self._send_to(side, together)

    def _send_to(self, side: Hashable, data: Iterable[bytes]) -> None:
        now, target = self._clock.now(), self._peer.target(side)
        timed = [(arrived_at(one, now), one) for one in data]
        accepted = 0 if target is None else self._leaving.put(partial(self._reach, target), timed)
        self._counts["sent"] += accepted
        self._counts["dropped"] += len(timed) - accepted

    def take_in(self) -> None:
        """Do nothing, because there is no receive buffer of the operating system."""

    def cut(self) -> None:
        """Cut the cable. This end ends with TransportBroken, and the other ends receive nothing more from it."""
        self._leave_network()
        self._delivery.end(TransportBroken(f"{self.name}: the cable was cut"))

    async def aclose(self) -> None:
        if self._delivery.begin_close():
            self._leave_network()
            self._delivery.closed()

    def _leave_network(self) -> None:
        if self._ends.get(self._address) is self:
            del self._ends[self._address]

    def _reach(self, target: str, timed: Timed) -> None:
        """Deliver datagrams to the other end through that end's path."""
        there = self._ends.get(target)
        if there is None:
            for _ in timed:
                self._counts["unreachable"] += 1
                self._presence.miss(self.name, target, "no program listens there; start the other side")
        elif there._arriving is None:
            there._take(self._address, timed)
        else:
            there._arriving.put(partial(there._take, self._address), timed)

    def _take(self, source: str, timed: Timed) -> None:
        delivery, now = self._delivery, self._clock.now()
        if delivery.ended is not None:
            return
        if sum(self._peer.takes(source, now) for _ in timed) < len(timed):
            self._notices.tell(EventKind.STRANGER, f"{self.name}: datagrams of {source} are refused")
            return
        overruns = delivery.overruns
        delivery.data([Datagram(datagram, at, source) for at, datagram in timed])
        self._counts["received"] += len(timed) - (delivery.overruns - overruns)
        self._presence.hear()


class _Direction:
    """One direction of a path."""

    __slots__ = ("_clock", "_draw", "_held", "_path", "_queue", "_timer", "duplicated", "full", "lost")

    def __init__(self, path: Path, seed: str, clock: Clock) -> None:
        self._path = path
        self._clock = clock
        self._draw = None if path.changes_nothing else random.Random(seed).random
        self._queue = TimedQueue(clock)
        self._held: Callable[[float], None] | None = None
        self._timer: Timer | None = None
        self.lost = 0
        """Number of lost datagrams."""
        self.duplicated = 0
        """Number of duplicates."""
        self.full = 0
        """Number of datagrams dropped because the queue was full."""

    def put(self, action: Callable[[Timed], None], timed: Timed) -> int:
        """Execute `action` for datagrams that have passed, never within this call. Return for how many datagrams
        there was room.
        """
        room = max(QUEUE_DATAGRAMS - self._queue.weight, 0)
        if len(timed) > room:
            self.full += len(timed) - room
            timed = timed[:room]
        if self._draw is not None:
            for at, datagram in timed:
                self._disturb(action, at, datagram, self._draw)
        elif timed:
            self._queue.put(partial(action, timed), len(timed), 0.0)
        return len(timed)

    def _disturb(
        self, action: Callable[[Timed], None], at: float, datagram: bytes, draw: Callable[[], float]
    ) -> None:
        """Let a datagram pass a path with delays and faults."""
        path = self._path
        # draw all numbers for every datagram, so that no probability affects the numbers of the others
        lost, doubled, overtaken = draw() < path.loss, draw() < path.duplicate, draw() < path.reorder
        delays = [path.latency_s + path.jitter_s * draw() for _ in range(2)]
        passing = partial(self._pass, action, datagram, delays if doubled else delays[:1])
        if lost:
            self.lost += 1
        elif overtaken and self._held is None:
            self._held = passing
            self._timer = self._clock.call_at(at + HELD_S, lambda: self._release(self._clock.now()))
        else:
            passing(at)
            self._release(at)

    def _pass(
        self, action: Callable[[Timed], None], datagram: bytes, delays: Sequence[float], at: float
    ) -> None:
        self.duplicated += len(delays) - 1
        for delay in delays:
            self._queue.put_timed(lambda when: action([(when, datagram)]), 1, at + delay)

    def _release(self, at: float) -> None:
        """Release the held datagram, which leaves at this time, s."""
        release, self._held = self._held, None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if release is not None:
            release(at)
