"""Both ends of a link on a line that loses, doubles, changes and delays bytes, in any interleaving.

The line, at its worst, as `Line` below has it:

- of the bytes handed out at once (a control byte or a block) one is lost, doubled or changed, or all from one byte on
  are lost. Or all further bytes of this side are lost. A changed byte becomes no control byte, one STX does not become
  the other, and a doubled byte arrives together with its twin. Any more damage can have another meaning than the
  original, and no rule of this link could detect it: ACK has no number, BCC is one XOR and STX is not included in it;
- a pause inside a block stays under `gap_timeout_s`, and bytes in transit are late by at most `LATE`, so that an
  answer, a gap time-out before it included, comes within `answer_timeout_s`.

Then, with blocks whose STX alternates and with such that all begin with 02:

- no telegram is delivered twice, none out of order, none that was not sent;
- what is reported to the sender as sent has been delivered, each telegram exactly once;
- any other message is a link error at the sender, reported once per message. A message with an error may have been
  delivered: the ACK of its last block can be lost as often as the block is repeated;
- a message of several blocks may be delivered in pieces, since an ACK that comes late looks like a lost EOT;
- the outcome comes within `longest` of a message, for each message of either side that was waiting.

The last two tests have what alternation is for. The usual run takes the same 200 examples each time, the nightly one 10
000 new ones: `HIL_BRIDGE_NIGHTLY=1 pytest tests/wire/test_adlp_faults.py`.
"""

import os
from itertools import count

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from protocol.devices.s3.adlp import (
    INCOMING_FAILURES,
    SINGLE_CONTROLS,
    Control,
    Link,
    LinkFailed,
    LinkProfile,
    MessageReceived,
    MessageSent,
    Role,
    State,
)

NIGHTLY = bool(os.environ.get("HIL_BRIDGE_NIGHTLY"))
EPOCH = 777.25
HOST, ROBOT = Role.HOST, Role.ROBOT
OTHER = {HOST: ROBOT, ROBOT: HOST}
STARTS = {Control.STX, Control.STX_ODD}
LATE = 0.8
"""Longest delay of a byte, s; twice that plus the gap time-out is less than the answer time-out."""
PAUSE = 0.2
"""Longest sum of the pauses inside a chunk, s."""


def telegram(role, number):
    """Return a unique telegram that identifies its sender, and holds DLE ETX ENQ ACK as data."""
    data = number.to_bytes(2, "big") + bytes((0x10, 0x03, 0x05, 0x06))
    return (8 + len(data)).to_bytes(2, "big") + bytes((role is HOST, 0, 24, 1, 0, 0)) + data


def longest(profile, sizes):
    """Time from the first bid for a message with telegrams of these sizes to its outcome, s, at the most.

    Every bid and every block is over after an answer time-out behind its last character, WACK starts one more.
    """
    answer, character = profile.answer_timeout_s, profile.character_time
    bids = profile.bid_limit * (answer + character)
    blocks = sum((profile.repeat_limit + 1) * (answer + (2 * size + 5) * character) for size in sizes)
    return bids + blocks + profile.wack_limit * answer


class Line:
    """One direction: bytes in transit as [arrival, bytes, chunk, arrival on time], free for more from `free` on."""

    def __init__(self, character):
        self.character = character
        self.under_way = []
        self.free = EPOCH
        self.cut = False
        self.damaged = set()
        self.pauses = {}
        self.begun = -1
        self.chunks = count()

    def put(self, data, now):
        chunk = next(self.chunks)
        if self.cut:
            return
        for byte in data:
            self.free = max(self.free, now) + self.character
            self.under_way.append([self.free, bytes((byte,)), chunk, self.free])

    def take(self, until):
        """Return the arrivals, one bytes object per moment; FIFO."""
        arrivals = []
        while self.under_way and self.under_way[0][0] <= until:
            arrivals.append(self.under_way.pop(0))
            self.begun = arrivals[-1][2]
        return arrivals

    def damage(self, position, how):
        """Damage a byte, once for each chunk: the byte at `position`, modulo the length."""
        at = position % len(self.under_way)
        chunk = self.under_way[at][2]
        if chunk not in self.damaged:
            self.damaged.add(chunk)
            how(at, chunk)

    def lose_one(self, at, chunk):
        del self.under_way[at]

    def lose_rest(self, at, chunk):
        self.under_way[at:] = [item for item in self.under_way[at:] if item[2] != chunk]

    def double(self, at, chunk):
        self.under_way[at][1] *= 2

    def delay(self, position, seconds):
        """Delay all bytes from one on, as far as the rules of the line allow."""
        at = position % len(self.under_way)
        chunk = self.under_way[at][2]
        seconds = min(seconds, *(LATE - (late[0] - late[3]) for late in self.under_way[at:]))
        if chunk == (self.under_way[at - 1][2] if at else self.begun):
            seconds = min(seconds, PAUSE - self.pauses.get(chunk, 0.0))
            self.pauses[chunk] = self.pauses.get(chunk, 0.0) + max(seconds, 0.0)
        if seconds > 0.0:
            for item in self.under_way[at:]:
                item[0] += seconds


class LinkUnderFaults(RuleBasedStateMachine):
    """Rules are events that may happen at any time; the invariants are checked once the line is idle."""

    @initialize(
        alternation=st.sampled_from(["off", "toggle"]),
        stuffing=st.sampled_from(["off", "double"]),
        winner=st.sampled_from(["robot", "host"]),
    )
    def begin(self, alternation, stuffing, winner):
        self.profile = LinkProfile(
            baudrate=11000, stx_alternation=alternation, dle_stuffing=stuffing, collision_winner=winner
        )
        self.ends = {role: Link(role, self.profile) for role in Role}
        self.lines = {role: Line(self.profile.character_time) for role in Role}  # by sender
        self.now = EPOCH
        self.numbers = count(1)
        self.announced = 0
        self.sent = {role: [] for role in Role}
        self.outcomes = {role: [] for role in Role}
        self.received = {role: [] for role in Role}

    roles = st.sampled_from(list(Role))
    positions = st.integers(0, 60)

    @precondition(lambda self: sum(map(len, self.sent.values())) < 6)
    @rule(role=roles, blocks=st.integers(1, 3))
    def send(self, role, blocks):
        message = [telegram(role, next(self.numbers)) for _ in range(blocks)]
        self.ends[role].send(message)
        self.sent[role].append((self.now, message))
        self.hand_out()

    @precondition(lambda self: self.announced < 6)
    @rule(role=roles)
    def announce(self, role):
        if len(self.outcomes[role]) == len(
            self.sent[role]
        ):  # as a host does: nothing of its own is outstanding
            self.announced += 1
            self.ends[role].announce()
            self.hand_out()

    def has_bytes_in_transit(self):
        return any(line.under_way for line in self.lines.values())

    def line(self, role):
        """Return the line of this role, or the other one if nothing is in transit on it."""
        line = self.lines[role]
        return line if line.under_way else self.lines[OTHER[role]]

    @precondition(has_bytes_in_transit)
    @rule(role=roles, position=positions, what=st.sampled_from(["lose_one", "lose_rest", "double"]))
    def damage(self, role, position, what):
        line = self.line(role)
        line.damage(position, getattr(line, what))

    @precondition(has_bytes_in_transit)
    @rule(
        role=roles,
        position=positions,
        value=st.sampled_from([v for v in range(256) if v not in SINGLE_CONTROLS]),
    )
    def change(self, role, position, value):
        line = self.line(role)

        def put_value(at, chunk):
            if not {value, *line.under_way[at][1]} <= STARTS:
                line.under_way[at][1] = bytes((value,))

        line.damage(position, put_value)

    @rule(role=roles)
    def cut(self, role):
        """Lose all bytes from this role until the line is mended."""
        self.lines[role].cut = True

    @precondition(has_bytes_in_transit)
    @rule(role=roles, position=positions, seconds=st.sampled_from([0.003, 0.1, 0.2, 0.25, 0.5, 0.8]))
    def delay(self, role, position, seconds):
        self.line(role).delay(position, seconds)

    @rule(happenings=st.sampled_from([1, 2, 5, 20, 100]))
    def go_on(self, happenings):
        for _ in range(happenings):
            if not self.happen():
                return

    def happen(self):
        """Process the next byte or time-out; false if there is none."""
        times = [line.under_way[0][0] for line in self.lines.values() if line.under_way]
        times += [at for end in self.ends.values() if (at := end.next_deadline()) is not None]
        if not times:
            return False
        self.now = max(self.now, min(times))
        for role, line in self.lines.items():
            for _, data, _, _ in line.take(self.now):
                self.ends[OTHER[role]].receive(data, self.now)
        for end in self.ends.values():
            end.handle_deadline(self.now)
        self.hand_out()
        return True

    def hand_out(self):
        for role, end in self.ends.items():
            self.lines[role].put(end.data_to_send(self.now), self.now)
            while (event := end.next_event()) is not None:
                match event:
                    case MessageReceived(telegrams):
                        self.received[role] += telegrams
                    case MessageSent():
                        self.settle(role, True)
                    case LinkFailed(reason) if reason not in INCOMING_FAILURES:
                        self.settle(role, False)

    def settle(self, role, done):
        """The oldest open message has its outcome; an early bid may fail before there is a message."""
        if len(self.outcomes[role]) == len(self.sent[role]):
            assert not done
            return
        queued, _ = self.sent[role][len(self.outcomes[role])]
        self.outcomes[role].append(done)
        assert self.now <= queued + self.bound(), "the outcome comes in time"

    def bound(self):
        """For all messages of both sides. Each may wait while the other side's end, its bids begun again, and for every
        bid that no message has followed.
        """
        p = self.profile
        waits = p.bid_limit * (p.answer_timeout_s + p.character_time) + p.answer_timeout_s + p.gap_timeout_s
        return self.announced * (waits + p.answer_timeout_s + 2 * LATE) + sum(
            longest(p, map(len, message)) + waits + 2 * LATE
            for sent in self.sent.values()
            for _, message in sent
        )

    def teardown(self):
        if not hasattr(self, "ends"):
            return
        self.rest()
        for role, other in OTHER.items():
            sent = [raw for _, message in self.sent[role] for raw in message]
            got = self.received[other]
            assert len(self.outcomes[role]) == len(self.sent[role]), "every message has one outcome"
            assert got == [raw for raw in sent if raw in got], "in order, nothing twice, nothing invented"
            for (_, message), done in zip(self.sent[role], self.outcomes[role], strict=True):
                assert not done or all(raw in got for raw in message), "what was acknowledged was delivered"
        for line in self.lines.values():
            line.cut = False
        for role, other in OTHER.items():
            last = telegram(role, 999)
            self.ends[role].send([last])
            self.sent[role].append((self.now, [last]))
            self.hand_out()
            self.rest()
            assert self.outcomes[role][-1], "a line that is quiet again carries the next message"
            assert self.received[other][-1] == last
            assert self.ends[role].state is State.IDLE

    def rest(self):
        for _ in range(20_000):
            if not self.happen():
                return
        raise AssertionError("the ends never come to rest")


LinkUnderFaults.TestCase.settings = settings(
    max_examples=10_000 if NIGHTLY else 200,
    stateful_step_count=40,
    deadline=None,
    derandomize=not NIGHTLY,
    suppress_health_check=list(HealthCheck),
)
test_any_interleaving_delivers_once_or_tells_the_sender = pytest.mark.full(
    pytest.mark.timeout(0 if NIGHTLY else 120)(LinkUnderFaults.TestCase)
)


def both_ends(alternation, answer_timeout):
    profile = LinkProfile(stx_alternation=alternation, answer_timeout_s=answer_timeout)
    return Link(HOST, profile), Link(ROBOT, profile)


def carry(source, sink, now):
    """Carry all bytes that one end hands out to the other."""
    sink.receive(source.data_to_send(now), now)


def delivered(link):
    events = iter(link.next_event, None)
    return [raw for event in events if isinstance(event, MessageReceived) for raw in event.telegrams]


@pytest.mark.parametrize(("alternation", "times"), [("off", 2), ("toggle", 1)])
def test_without_alternation_an_early_repeat_counts_as_new(alternation, times):
    """The guarantee needs a sender whose answer time-out is longer than the receiver's gap time-out, or alternation."""
    host, robot = both_ends(alternation, 0.1)
    only = telegram(HOST, 1)
    host.send([only])
    carry(host, robot, EPOCH)
    carry(robot, host, EPOCH)
    carry(host, robot, EPOCH)
    robot.data_to_send(EPOCH)  # the ACK is lost
    again = host.next_deadline()
    host.handle_deadline(again)
    carry(host, robot, again)
    carry(robot, host, again)
    carry(host, robot, again)
    assert delivered(robot) == [only] * times


@pytest.mark.parametrize(("alternation", "times"), [("off", 1), ("toggle", 2)])
def test_without_alternation_an_equal_block_may_count_as_repeat(alternation, times):
    """The guarantee is for telegrams that differ from the previous one in the same message, or alternation."""
    host, robot = both_ends(alternation, 2.0)
    same = telegram(HOST, 1)
    host.send([same, same])
    carry(host, robot, EPOCH)
    carry(robot, host, EPOCH)
    carry(host, robot, EPOCH)
    late = robot.data_to_send(EPOCH)
    robot.handle_deadline(EPOCH + 0.5)
    host.receive(late, EPOCH + 0.5)
    carry(host, robot, EPOCH + 0.5)
    carry(robot, host, EPOCH + 0.5)
    carry(host, robot, EPOCH + 0.5)
    assert delivered(robot) == [same] * times
