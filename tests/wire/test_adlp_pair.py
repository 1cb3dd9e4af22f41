"""Both ends of a link connected without a transport, on a line that loses and mutilates bytes."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.s3.adlp import (
    SINGLE_CONTROLS,
    Link,
    LinkFailed,
    LinkProfile,
    MessageReceived,
    MessageSent,
    Role,
    State,
)

EPOCH = 777.25


def telegram(role, number, size=4):
    """Return a unique telegram that identifies its sender."""
    data = number.to_bytes(2, "big") + bytes((0x10, 0x03, 0x05, 0x06)[:size])
    return (8 + len(data)).to_bytes(2, "big") + bytes((role is Role.HOST, 0, 24, 1, 0, 0)) + data


class Wire:
    """Carries all data of the ends at once; faults come from a list, one for each chunk."""

    def __init__(self, faults, **changes):
        self.ends = {role: Link(role, LinkProfile(**changes)) for role in Role}
        self.faults = list(faults)
        self.now = EPOCH
        self.received = {role: [] for role in Role}
        self.outcomes = {role: [] for role in Role}

    def mutilate(self, data):
        if not self.faults:
            return data
        kind, where, value = self.faults.pop(0)
        at = where % len(data)
        if kind == "lose all":
            return b""
        if kind == "lose one":
            return data[:at] + data[at + 1 :]
        # A character that became another control byte would be undetectable by any rule of this link; parity
        # catches the result of one wrong bit.
        if kind == "change" and data[at] != value and value not in SINGLE_CONTROLS:
            return data[:at] + bytes((value,)) + data[at + 1 :]
        return data

    def exchange(self):
        """Carry data until both are silent; both send before either receives, so that bids can collide."""
        for _ in range(200):
            chunks = {role: end.data_to_send(self.now) for role, end in self.ends.items()}
            if not any(chunks.values()):
                return
            for role, other in ((Role.HOST, Role.ROBOT), (Role.ROBOT, Role.HOST)):
                if chunks[role] and (data := self.mutilate(chunks[role])):
                    self.ends[other].receive(data, self.now)
            self.collect()
        raise AssertionError("the ends never fall silent")

    def collect(self):
        for role, end in self.ends.items():
            while (event := end.next_event()) is not None:
                match event:
                    case MessageReceived(telegrams):
                        self.received[role] += telegrams
                    case MessageSent():
                        self.outcomes[role].append(True)
                    case LinkFailed(reason) if reason not in ("early EOT", "incomplete", "too long"):
                        self.outcomes[role].append(False)

    def run(self):
        for _ in range(1000):
            self.exchange()
            times = [t for end in self.ends.values() if (t := end.next_deadline()) is not None]
            if not times:
                return
            self.now = max(self.now, min(times))
            for end in self.ends.values():
                end.handle_deadline(self.now)
            self.collect()
        raise AssertionError("the ends never come to rest")


def test_clean_line_delivers_everything_in_order():
    wire = Wire(())
    host = [telegram(Role.HOST, n) for n in range(5)]
    robot = [telegram(Role.ROBOT, n) for n in range(6)]
    for raw in host:
        wire.ends[Role.HOST].send([raw])
    wire.ends[Role.ROBOT].send(robot[:3])
    wire.ends[Role.ROBOT].send(robot[3:])
    wire.run()
    assert wire.received == {Role.HOST: robot, Role.ROBOT: host}
    assert wire.outcomes == {Role.HOST: [True] * 5, Role.ROBOT: [True] * 2}
    assert wire.now < EPOCH + 0.001


faults = st.lists(
    st.tuples(
        st.sampled_from(["none", "none", "lose all", "lose one", "change"]),
        st.integers(0, 40),
        st.integers(0, 255),
    ),
    max_size=40,
)


@pytest.mark.full
@given(
    faults,
    st.lists(st.integers(1, 3), max_size=3),
    st.lists(st.integers(1, 3), max_size=3),
    st.sampled_from(["off", "toggle"]),
    st.sampled_from(["off", "double"]),
    st.sampled_from(["robot", "host"]),
)
@settings(max_examples=200, deadline=None)
def test_bad_line_never_delivers_wrongly_and_always_settles(
    faults, host_sizes, robot_sizes, alternation, stuffing, winner
):
    wire = Wire(faults, stx_alternation=alternation, dle_stuffing=stuffing, collision_winner=winner)
    messages = {
        role: [[telegram(role, 10 * n + block) for block in range(size)] for n, size in enumerate(sizes)]
        for role, sizes in ((Role.HOST, host_sizes), (Role.ROBOT, robot_sizes))
    }
    for role, all_of_it in messages.items():
        for message in all_of_it:
            wire.ends[role].send(message)
    wire.run()
    for role, other in ((Role.HOST, Role.ROBOT), (Role.ROBOT, Role.HOST)):
        sent = [raw for message in messages[role] for raw in message]
        got = wire.received[other]
        assert len(wire.outcomes[role]) == len(messages[role]), "every message has one outcome"
        assert got == [raw for raw in sent if raw in got], "in order, nothing twice, nothing invented"
        for message, done in zip(messages[role], wire.outcomes[role], strict=True):
            assert not done or all(raw in got for raw in message), "what was acknowledged was delivered"
    # Once the line is clean, the next message gets through both ways.
    wire.faults.clear()
    for role, other in ((Role.HOST, Role.ROBOT), (Role.ROBOT, Role.HOST)):
        raw = telegram(role, 999)
        wire.ends[role].send([raw])
        wire.run()
        assert wire.outcomes[role][-1]
        assert wire.received[other][-1] == raw
        assert wire.ends[role].state is State.IDLE
