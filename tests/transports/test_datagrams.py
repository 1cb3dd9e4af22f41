"""Datagrams in virtual time beyond the suite: exact times, faults by seed, peers, and an endpoint over a lossy wire."""

from asyncio import sleep as pass_time  # in virtual time, where nothing waits
from collections import deque
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import TransportClosed, TransportError, TransportUnavailable
from hil_bridge.transports import Datagrams, Direction, Tap, connect_datagrams, listen_datagrams
from hil_bridge.transports.datagram.memory import HELD_S
from hil_bridge.transports.datagram.peer import IN_USE_S, KNOWN_SIDES, Notices, Peer
from hil_bridge.transports.datagram.statistics import QUEUE_DATAGRAMS
from hil_bridge.transports.pump import Pump
from protocol.datagram import Datagram, arrived_at, side_of


class Log:
    """Arrived datagrams, with arrival time and time stamp of the wire."""

    def __init__(self, wire: Any, clock: Clock) -> None:
        self.items: list[tuple[float, bytes]] = []
        self.stamps: list[float] = []
        self.ends: list[TransportError] = []
        self._clock = clock
        wire.start(self._arrived, self.ends.append)

    def _arrived(self, data: Datagrams) -> None:
        self.items += [(self._clock.now(), datagram) for datagram in data]
        self.stamps += [arrived_at(datagram, -1.0) for datagram in data]

    @property
    def datagrams(self) -> list[bytes]:
        return [datagram for _, datagram in self.items]


async def _pair(clock: Clock, client: str = "", listener: str = "") -> tuple[Any, Any]:
    listening = await listen_datagrams(f"udp+memory:robot{listener}", clock)
    return await connect_datagrams(listening.address + client, clock), listening.transport


def test_datagram_is_bytes_with_time() -> None:
    datagram = Datagram(b"abc", 1.5)
    assert datagram == b"abc"
    assert hash(datagram) == hash(b"abc")
    assert arrived_at(datagram, 2.0) == 1.5
    assert arrived_at(Datagram(b"abc"), 2.0) == 2.0
    assert arrived_at(b"abc", 2.0) == 2.0


def test_datagram_delays_of_both_paths_add_up() -> None:
    async def main() -> None:
        clock = Clock.running()
        left, right = await _pair(clock, "?latency_ms=2", "?latency_ms=0.5")
        near_log, far_log = Log(left, clock), Log(right, clock)
        start = clock.now()
        left.send([b"a", b"b"])
        await pass_time(0.1)
        right.send([b"c"])
        await pass_time(0.1)
        assert far_log.items == [(start + 0.002 + 0.0005, b"a"), (start + 0.002 + 0.0005, b"b")]
        assert near_log.items == [(start + 0.1 + 0.0005 + 0.002, b"c")]
        assert far_log.stamps == [at for at, _ in far_log.items]

    run_virtual(main)


def test_datagram_jitter_is_bounded_and_keeps_order() -> None:
    async def main() -> None:
        clock = Clock.running()
        left, right = await _pair(clock, "?latency_ms=2&jitter_ms=5&seed=1")
        far_log, sent = Log(right, clock), []
        for k in range(200):
            sent.append(clock.now())
            left.send([b"%d" % k])
            await pass_time(0.001)
        await pass_time(0.1)
        assert far_log.datagrams == [b"%d" % k for k in range(200)]
        delays = [at - begun for (at, _), begun in zip(far_log.items, sent, strict=True)]
        assert min(delays) >= 0.002
        assert 0.006 < max(delays) <= 0.007 + 1e-9

    run_virtual(main)


def _run(client: str, count: int = 2000) -> tuple[list[tuple[float, bytes]], Any]:
    """Return the arrivals of numbered datagrams every 4 ms, and the counts of the sender."""
    result: list[Any] = []

    async def main() -> None:
        clock = Clock.running()
        left, right = await _pair(clock, client)
        far_log = Log(right, clock)
        for k in range(count):
            left.send([b"%d" % k])
            await pass_time(0.004)
        await pass_time(1.0)
        result.extend((far_log.items, left.statistics))

    run_virtual(main)
    return result[0], result[1]


def test_datagram_faults_are_reproducible_at_their_rates() -> None:
    faults = "?loss=0.1&duplicate=0.05&reorder=0.02&jitter_ms=1"
    items, counts = _run(faults + "&seed=7")
    assert (items, counts) == _run(faults + "&seed=7")
    assert items != _run(faults + "&seed=8")[0]
    assert 150 < counts.lost < 250
    assert 60 < counts.duplicated < 120
    assert len(items) == counts.sent + counts.duplicated - counts.lost


def test_datagram_faults_are_drawn_independently() -> None:
    def lost(options: str) -> set[bytes]:
        received = {datagram for _, datagram in _run(f"?loss=0.1&seed=7{options}", 500)[0]}
        return {b"%d" % k for k in range(500)} - received

    assert lost("") == lost("&duplicate=0.3&reorder=0.2&jitter_ms=3") != set()


def test_datagram_directions_are_drawn_independently() -> None:
    def datagrams_received(answers: int) -> list[bytes]:
        log: list[Log] = []

        async def main() -> None:
            clock = Clock.running()
            left, right = await _pair(clock, "?loss=0.3&seed=5")
            log.append(Log(right, clock))
            for k in range(100):
                left.send([b"%d" % k])
                await pass_time(0.01)
                right.send([b"answer"] * answers)

        run_virtual(main)
        return log[0].datagrams

    assert datagrams_received(0) == datagrams_received(1) == datagrams_received(3)


def test_datagram_reordered_arrives_after_next() -> None:
    items, _ = _run("?reorder=0.1&seed=2", 400)
    numbers = [int(datagram) for _, datagram in items]
    assert sorted(numbers) == list(range(400))
    reordered = [k for k, number in enumerate(numbers) if number != k]
    assert 30 < len(reordered) < 120
    assert all(abs(numbers[k] - k) == 1 for k in reordered)


def test_datagram_reordered_without_next_arrives_late() -> None:
    async def main() -> None:
        clock = Clock.running()
        left, right = await _pair(clock, "?reorder=1&latency_ms=1")
        far_log, start = Log(right, clock), clock.now()
        left.send([b"alone"])
        await pass_time(1.0)
        assert far_log.datagrams == [b"alone"]
        assert far_log.items[0][0] == pytest.approx(start + HELD_S + 0.001, abs=1e-12)

    run_virtual(main)


def test_datagram_full_network_drops_and_counts() -> None:
    async def main() -> None:
        clock = Clock.running()
        left, right = await _pair(clock, "?latency_ms=10")
        left.send([b"x"] * (QUEUE_DATAGRAMS + 5))
        assert (left.statistics.sent, left.statistics.dropped) == (QUEUE_DATAGRAMS, 5)
        await pass_time(0.1)
        left.send([b"x"] * 3)
        await pass_time(0.1)
        far_log = Log(right, clock)
        assert len(far_log.items) == QUEUE_DATAGRAMS
        assert right.statistics.overruns == 3

    run_virtual(main)


def test_datagram_client_may_start_before_listener() -> None:
    notices: list[tuple[str, str]] = []

    async def main() -> None:
        clock = Clock.running()
        left = await connect_datagrams("udp+memory:robot", clock, lambda *notice: notices.append(notice))
        for _ in range(20):
            left.send([b"hello"])
            await pass_time(0.1)
        assert left.statistics.unreachable == 20
        notice_text = (
            "udp+memory:robot: robot cannot be reached: no program listens there; start the other side"
        )
        assert notices == [("absent", notice_text)] * 2  # at most one a second
        listening = await listen_datagrams("udp+memory:robot", clock)
        there = Log(listening.transport, clock)
        left.send([b"hello"])
        await pass_time(0.1)
        assert there.datagrams == [b"hello"]
        with pytest.raises(TransportUnavailable, match="the name is already in use"):
            await listen_datagrams("udp+memory:robot", clock)
        await listening.transport.aclose()
        await (await listen_datagrams("udp+memory:robot", clock)).transport.aclose()

    run_virtual(main)


@pytest.mark.parametrize("strangers", ["follow", "refuse"])
def test_datagram_answer_goes_to_newest_sender(strangers: str) -> None:
    async def main() -> None:
        clock = Clock.running()
        first, right = await _pair(clock, listener=f"?strangers={strangers}")
        second = await connect_datagrams("udp+memory:robot", clock)
        one, two, far_log = Log(first, clock), Log(second, clock), Log(right, clock)
        first.send([b"first"])
        await pass_time(0.1)
        second.send([b"second"])
        await pass_time(0.1)
        right.send([b"answer"])
        await pass_time(0.1)
        refused = strangers == "refuse"
        assert (one.datagrams, two.datagrams) == (([b"answer"], []) if refused else ([], [b"answer"]))
        assert far_log.datagrams == ([b"first"] if refused else [b"first", b"second"])
        assert (right.statistics.strangers, right.statistics.refused) == (1, refused)
        await pass_time(IN_USE_S)
        second.send([b"again"])
        await pass_time(0.1)
        assert far_log.datagrams[-1] == b"again"
        assert right.statistics.strangers == 1

    run_virtual(main)


def test_datagram_answer_may_go_to_earlier_sender() -> None:
    """It cannot go to a side that has not sent, and a connecting wire sends to its peer only."""

    async def main() -> None:
        clock = Clock.running()
        listening = await listen_datagrams("udp+memory:box", clock)
        clients = [await connect_datagrams(listening.address, clock) for _ in range(2)]
        logs, messages = [Log(client, clock) for client in clients], list[bytes]()
        listening.transport.start(lambda data: messages.extend(data), lambda error: None)
        for client in clients:
            client.send([b"hello"])
            await pass_time(0.1)
        first, second = (side_of(datagram) for datagram in messages)
        assert first != second
        notices = [
            Datagram(b"to the first", side=first),
            Datagram(b"to an unknown side", side="box#99"),
            b"to the last",
        ]
        listening.transport.send(notices)
        clients[0].send([Datagram(b"back", side=second)])
        await pass_time(0.1)
        assert [log.datagrams for log in logs] == [[b"to the first"], [b"to an unknown side", b"to the last"]]
        assert messages[-1] == b"back"
        for wire in (*clients, listening.transport):
            await wire.aclose()

    run_virtual(main)


def test_datagram_wire_limits_known_senders() -> None:
    peer: Peer[int] = Peer()
    for side in range(KNOWN_SIDES + 1):
        assert peer.takes(side, 0.0)
    assert [peer.target(side) for side in (0, 1, None)] == [KNOWN_SIDES, 1, KNOWN_SIDES]


def test_datagram_fixed_peer_does_not_change() -> None:
    peer = Peer("device")
    assert peer.takes("device", 0.0)
    assert not peer.takes("other", 1000.0)
    assert (peer.address, peer.strangers, peer.refused) == ("device", 1, 1)


def test_datagram_wire_accepts_its_sender_only() -> None:
    peer: Peer[tuple[str, int]] = Peer(sender="127.0.0.2")
    assert not peer.takes(("127.0.0.3", 1000), 0.0)
    assert peer.takes(("127.0.0.2", 1000), 0.0)
    assert peer.takes(("127.0.0.2", 2000), 0.1)
    assert (peer.address, peer.refused) == (("127.0.0.2", 2000), 1)


def test_datagram_notices_are_rate_limited() -> None:
    times = iter((0.0, 0.5, 0.5, 1.0, 1.9, 2.0))
    reported: list[tuple[str, str]] = []
    notices = Notices(lambda: next(times), lambda kind, text: reported.append((kind, text)))
    for k, kind in enumerate("aabaaa"):
        notices.tell(kind, str(k))
    assert reported == [("a", "0"), ("b", "2"), ("a", "3"), ("a", "5")]


def test_tap_reports_datagrams() -> None:
    async def main() -> None:
        clock = Clock.running()
        left, right = await _pair(clock)
        traffic: list[tuple[Direction, list[bytes]]] = []
        tap: Any = Tap(left, lambda direction, data: traffic.append((direction, list(data))))
        Log(tap, clock)
        Log(right, clock)
        tap.send([b"ask", b""])
        await pass_time(0.1)
        right.send([b"answer"])
        await pass_time(0.1)
        assert traffic == [(Direction.SENT, [b"ask", b""]), (Direction.RECEIVED, [b"answer"])]
        await tap.aclose()

    run_virtual(main)


# --- an endpoint over a wire that loses


class Asker:
    """Endpoint that requests numbers one after the other, and again after 20 ms without an answer."""

    PATIENCE_S = 0.02

    def __init__(self) -> None:
        self.number = 0
        self.requested = 0
        self._due: float | None = None
        self._events: deque[tuple[int, float]] = deque()
        self._ask = True

    def receive(self, data: Datagrams, now: float) -> None:
        for datagram in data:
            if datagram == b"answer %d" % self.number:
                self._events.append((self.number, arrived_at(datagram, now)))
                self.number += 1
                self._ask = True

    def next_event(self) -> tuple[int, float] | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Datagrams:
        if not self._ask:
            return ()
        self._ask, self._due = False, now + self.PATIENCE_S
        self.requested += 1
        return [b"ask %d" % self.number]

    def next_deadline(self) -> float | None:
        return self._due

    def handle_deadline(self, now: float) -> None:
        if self._due is not None and self._due <= now:
            self._ask = True


class Answerer:
    """Endpoint that answers requests."""

    def __init__(self) -> None:
        self._answers: list[bytes] = []

    def receive(self, data: Datagrams, now: float) -> None:
        self._answers += [datagram.replace(b"ask", b"answer") for datagram in data]

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Datagrams:
        answers, self._answers = self._answers, []
        return answers

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        pass


def _conversation(faults: str) -> tuple[list[tuple[int, float]], int, int]:
    """Return the answers with their times, the number of requests and the number of lost datagrams, in one second."""
    answers: list[tuple[int, float]] = []
    ends: list[BaseException] = []
    asker = Asker()
    lost: list[int] = []

    async def main() -> None:
        clock = Clock.running()
        left, right = await _pair(clock, f"?latency_ms=1{faults}")
        start = clock.now()
        Pump(Answerer(), right, clock, lambda event: None, ends.append).start()
        pump = Pump(
            asker, left, clock, lambda event: answers.append((event[0], event[1] - start)), ends.append
        )
        pump.start()
        await clock.sleep_until(start + 1.0005)
        lost.append(left.statistics.lost)
        await left.aclose()
        await right.aclose()

    run_virtual(main)
    assert [type(end) for end in ends] == [TransportClosed, TransportClosed]
    return answers, asker.requested, lost[0]


def test_datagram_endpoint_works_on_perfect_network() -> None:
    answers, requests, lost = _conversation("")
    assert [number for number, _ in answers] == list(range(500))
    assert [at for _, at in answers] == pytest.approx([0.002 * k for k in range(1, 501)], abs=1e-9)
    assert (requests, lost) == (501, 0)


def test_datagram_endpoint_tolerates_losses() -> None:
    answers, requests, lost = _conversation("&loss=0.1&duplicate=0.1&reorder=0.05&seed=3")
    assert [number for number, _ in answers] == list(range(len(answers)))
    assert 100 < len(answers) < 500
    assert lost > 10
    assert requests > len(answers) + 1
    assert (answers, requests, lost) == _conversation("&loss=0.1&duplicate=0.1&reorder=0.05&seed=3")
