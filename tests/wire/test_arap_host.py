"""The PC's end, connected to a robot's end of the link with scripted answers."""

import pytest

from protocol.devices.s3.adlp import (
    EVENT_LIMIT,
    Link,
    LinkFailed,
    LinkFailure,
    LinkNotice,
    LinkProfile,
    MessageReceived,
    Role,
    encode_block,
)
from protocol.devices.s3.arap import (
    Answered,
    ArapHost,
    Move,
    MoveKind,
    OrderFailed,
    OrderFailure,
    Refusal,
    Refused,
    Spontaneous,
    SpontaneousReceived,
    Status,
    Telegram,
    UnexpectedReceived,
    join_blocks,
    read_status,
    receive_program,
    response,
    split_telegram,
    start_program,
    stop_program,
)
from protocol.endpoint import LocalProtocolError

PROFILE = LinkProfile(baudrate=11000)
STATUS = Status((4073, -6692, 5255), (2071, -11179, 2455, 11539), operation=True)


class Cell:
    """A host and the robot's end of its link, on a wire without delay; counts characters in both directions."""

    def __init__(self, profile=PROFILE, answer=None):
        self.host = ArapHost(profile)
        self.robot = Link(Role.ROBOT, profile)
        self.answer = answer or (lambda order: ())
        self.now = 500.25
        self.characters = 0
        self.orders = []
        self.connected = True
        self.on_wire = lambda data: data

    def run(self, until=0.0):
        """Exchange until silent, then through the deadlines of `until` seconds; return the host's events."""
        end = self.now + until
        while True:
            self._exchange()
            times = [t for e in (self.host, self.robot) if (t := e.next_deadline()) is not None]
            if not times or min(times) > end:
                break
            self.now = max(self.now, min(times))
            self.host.handle_deadline(self.now)
            self.robot.handle_deadline(self.now)
        self.now = end
        events = []
        while (event := self.host.next_event()) is not None:
            events.append(event)
        return events

    def _exchange(self):
        while True:
            self._let_robot_answer()
            to_robot = self.host.data_to_send(self.now)
            to_host = self.robot.data_to_send(self.now)
            if not to_robot and not to_host:
                return
            self.characters += len(to_robot) + len(to_host)
            if self.connected:
                self.robot.receive(to_robot, self.now)
                self.host.receive(self.on_wire(to_host), self.now)

    def _let_robot_answer(self):
        while (event := self.robot.next_event()) is not None:
            if isinstance(event, MessageReceived):
                order = join_blocks([Telegram.decode(raw, from_robot=False) for raw in event.telegrams])
                self.orders.append(order)
                for message in self.answer(order):
                    self.robot.send([t.encode() for t in message])

    def send(self, *telegrams):
        self.robot.send([t.encode() for t in telegrams])


def answers(*messages):
    return lambda order: messages


def test_status_transaction_is_58_characters():
    # Specification section 5.
    cell = Cell(answer=answers([STATUS.to_telegram()]))
    cell.host.order(read_status())
    (event,) = cell.run()
    assert isinstance(event, Answered)
    assert Status.from_telegram(event.answer) == STATUS
    assert event.blocks == (event.answer,)
    assert cell.characters == 58


def test_move_transaction_is_78_characters():
    order = Move(MoveKind.POINT, (0.5, 0.0, 0.6), (1.0, 0.0, 0.0, 0.0), 0.1).to_telegram()
    cell = Cell(answer=answers([response(order)]))
    cell.host.order(order)
    assert cell.run() == [Answered(order, response(order), (response(order),))]
    assert cell.orders == [order]
    assert cell.characters == 78


def test_host_may_state_the_data_length():
    order = Move(MoveKind.POINT).to_telegram()
    cell = Cell(LinkProfile(length_style="data"), answers([response(order)]))
    cell.host.order(order)
    assert cell.host.data_to_send(cell.now) == b"\x05"
    cell.robot.receive(b"\x05", cell.now)
    assert len(cell.run()) == 1
    assert cell.orders == [order]


def test_one_order_at_a_time():
    cell = Cell(answer=answers([STATUS.to_telegram()]))
    cell.host.order(read_status())
    assert cell.host.outstanding == read_status()
    with pytest.raises(LocalProtocolError, match="outstanding: read status"):
        cell.host.order(stop_program())
    cell.run()
    assert cell.host.outstanding is None
    cell.host.order(read_status())


def test_announced_order_is_sent_with_the_bid_ahead_of_it():
    cell = Cell(answer=answers([STATUS.to_telegram()]))
    cell.host.announce()
    assert cell.run() == []
    assert cell.host.link.ahead
    cell.host.order(read_status())
    (event,) = cell.run()
    assert isinstance(event, Answered)
    assert not cell.host.link.ahead
    assert cell.host.link.counters["bid sent"] == 1


def test_no_bid_is_announced_while_an_order_has_no_answer():
    host = ArapHost(PROFILE)
    host.order(read_status())
    with pytest.raises(LocalProtocolError, match="outstanding"):
        host.announce()


def test_bid_failing_before_its_order_fails_no_order():
    cell = Cell(answer=answers([STATUS.to_telegram()]))
    cell.connected = False
    cell.host.announce()
    events = cell.run(20.0)
    assert [event.reason for event in events if isinstance(event, LinkFailed)] == [LinkFailure.NO_ANSWER]
    assert not any(isinstance(event, OrderFailed) for event in events)
    cell.connected = True
    cell.host.order(read_status())
    assert isinstance(cell.run()[-1], Answered)


def test_order_that_cannot_be_sent_is_not_outstanding():
    host = ArapHost(PROFILE)
    with pytest.raises(LocalProtocolError, match="too long"):
        host.order(Telegram(1, 1, 0, bytes(130)))
    assert host.outstanding is None
    assert host.next_deadline() is None


def test_order_of_several_blocks_is_one_message():
    order = Telegram(1, 1, 0, bytes(300))
    cell = Cell(answer=answers([response(order)]))
    cell.host.order(*split_telegram(order, PROFILE.max_telegram))
    assert cell.host.outstanding == order
    assert cell.run() == [Answered(order, response(order), (response(order),))]
    assert cell.orders == [order]
    assert cell.host.link.counters["blocks sent"] == 3
    assert cell.host.link.counters["messages sent"] == 1


@pytest.mark.parametrize("telegrams", [[Telegram(1, 9)], [Telegram(1, 1), Telegram(1, 1)]])
def test_blocks_that_form_no_order_are_not_sent(telegrams):
    host = ArapHost(PROFILE)
    with pytest.raises(LocalProtocolError):
        host.order(*telegrams)
    assert host.outstanding is None
    assert host.data_to_send(0.0) == b""


def test_refusal():
    cell = Cell(answer=lambda order: ([Refusal(15).to_telegram(order)],))
    cell.host.order(read_status())
    assert cell.run() == [Refused(read_status(), Refusal(15))]


def blocks(*data):
    types = [0x0A] * (len(data) - 1) + [0x02]
    return [Telegram(29, kind, 1, part, True) for kind, part in zip(types, data, strict=True)]


def test_blocks_of_an_answer_are_joined():
    parts = blocks(b"\0\0\0\7" + b"abc", b"def", b"g")
    cell = Cell(answer=answers(parts))
    cell.host.order(receive_program(7))
    (event,) = cell.run()
    assert event.answer == Telegram(29, 2, 1, b"\0\0\0\7abcdefg", True)
    assert event.blocks == tuple(parts)


def test_blocks_of_an_answer_are_joined_over_two_messages():
    parts = blocks(b"abc", b"d")
    cell = Cell(answer=answers(parts[:1], parts[1:]))
    cell.host.order(receive_program(7))
    (event,) = cell.run()
    assert event.answer.data == b"abcd"


def test_spontaneous_before_the_answer_and_unasked():
    message = Spontaneous(17, 5, 6)
    cell = Cell(answer=answers([message.to_telegram()], [STATUS.to_telegram()]))
    cell.host.order(read_status())
    first, second = cell.run()
    assert first == SpontaneousReceived(message)
    assert isinstance(second, Answered)
    cell.send(message.to_telegram())
    assert cell.run() == [SpontaneousReceived(message)]


def test_collision_with_a_spontaneous_message_delays_the_order():
    message = Spontaneous(7, 1, 2)
    cell = Cell(answer=answers([STATUS.to_telegram()]))
    cell.send(message.to_telegram())
    cell.host.order(read_status())
    collision, first, second = cell.run()
    assert (type(collision), first) == (LinkNotice, SpontaneousReceived(message))
    assert isinstance(second, Answered)


@pytest.mark.parametrize(
    ("telegram", "text"),
    [
        (Telegram(20, 2, 0, b"", True), "another order"),
        (Telegram(19, 9, 0, b"", True), "no answer has this type"),
        (Telegram(19, 6, 0, b"", True), "refusal needs 2 bytes"),
    ],
)
def test_unmatched_answer_fails_the_order(telegram, text):
    cell = Cell(answer=answers([telegram]))
    cell.host.order(read_status())
    (event,) = cell.run()
    assert isinstance(event, OrderFailed)
    assert (event.order, event.reason) == (read_status(), OrderFailure.UNFIT_ANSWER)
    assert text in event.text


def test_unreadable_answer_fails_the_order():
    cell = Cell()
    cell.host.order(read_status())
    cell.run()
    cell.robot.send([bytes.fromhex("00 08 01 00 13 02 00 00")])
    (event,) = cell.run()
    assert (event.reason, "byte 2" in event.text) == (OrderFailure.UNFIT_ANSWER, True)


def test_too_many_blocks_fail_the_order(monkeypatch):
    monkeypatch.setattr("protocol.devices.s3.arap.host.MESSAGE_LIMIT", 2)
    cell = Cell(answer=answers(blocks(b"a", b"b", b"c", b"d")))
    cell.host.order(receive_program(1))
    failed, late = cell.run()
    assert "more than 2 blocks" in failed.text
    assert isinstance(late, UnexpectedReceived)


def test_answer_without_an_order_is_reported():
    cell = Cell()
    cell.send(STATUS.to_telegram())
    cell.send(Telegram(127, 3, 7, b"", True))
    cell.robot.send([bytes.fromhex("00 08 00 09 13 02 00 00")])
    first, second, third = cell.run()
    assert "without an outstanding order" in first.text
    assert "spontaneous needs 4" in second.text
    assert "byte 3" in third.text
    assert all(isinstance(event, UnexpectedReceived) for event in (first, second, third))
    assert first.raw == STATUS.to_telegram().encode()


def test_bad_spontaneous_telegram_does_not_fail_the_order():
    cell = Cell(answer=answers([Telegram(127, 3, 7, b"", True)], [STATUS.to_telegram()]))
    cell.host.order(read_status())
    first, second = cell.run()
    assert isinstance(first, UnexpectedReceived)
    assert isinstance(second, Answered)


def test_answer_before_the_order_was_sent_is_no_answer():
    cell = Cell(answer=answers([STATUS.to_telegram()]))
    cell.send(STATUS.to_telegram())
    cell.host.order(read_status())
    _, early, answer = cell.run()
    assert isinstance(early, UnexpectedReceived)
    assert isinstance(answer, Answered)


def test_no_answer_telegram_in_time():
    cell = Cell()
    cell.host.order(read_status())
    assert cell.run(9.99) == []
    (event,) = cell.run(0.02)
    assert (event.order, event.reason) == (read_status(), OrderFailure.TIME_OUT)
    assert "within 10 s to: read status" in event.text
    assert cell.host.next_deadline() is None
    cell.send(STATUS.to_telegram())
    (late,) = cell.run()
    assert isinstance(late, UnexpectedReceived)


def test_order_does_not_time_out_while_a_message_arrives():
    cell = Cell()
    cell.host.order(read_status())
    cell.run(9.9)
    cell.host.receive(b"\x05", cell.now)
    cell.host.data_to_send(cell.now)
    cell.now += 0.2
    cell.host.handle_deadline(cell.now)
    raw = STATUS.to_telegram().encode()
    cell.host.receive(encode_block(raw) + b"\x04", cell.now)
    assert isinstance(cell.host.next_event(), Answered)


def test_link_failure_fails_the_order_with_its_reason():
    cell = Cell()
    cell.connected = False
    cell.host.order(read_status())
    event = cell.run(20.0)[-1]
    assert isinstance(event, OrderFailed)
    assert event.reason == "no answer"
    assert "cable" in event.remedy
    assert "cable" not in event.text


def test_lost_acknowledgement_does_not_lose_the_order():
    cell = Cell(answer=answers([STATUS.to_telegram()]))
    states = []

    def lose_second_chunk(data):
        if data:
            states.append(data)
        return b"" if len(states) == 2 else data

    cell.on_wire = lose_second_chunk
    cell.host.order(read_status())
    events = cell.run(5.0)
    assert isinstance(events[-1], Answered)
    lost = [event.reason for event in events if isinstance(event, LinkFailed)]
    assert lost == [LinkFailure.INTERRUPTED], "it is told all the same"
    assert not cell.host.link.counters["block repeated"]
    assert cell.orders == [read_status()]
    assert not any(isinstance(event, OrderFailed) for event in events)


def test_lost_message_of_the_robot_is_passed_on():
    host = ArapHost(PROFILE)
    host.receive(b"\x05\x04", 0.0)
    event = host.next_event()
    assert isinstance(event, LinkFailed)
    assert event.reason == "early EOT"


def test_events_are_bounded():
    host = ArapHost(PROFILE)
    for _ in range(3):
        host.receive(b"\x15" * 500, 0.0)
    assert len(list(iter(host.next_event, None))) == EVENT_LIMIT
    assert host.link.counters["stray control byte"] == 1500


@pytest.mark.parametrize(("stuffing", "count"), [("off", 1), ("double", 0)])
def test_order_with_the_trailer_is_counted_and_reported(stuffing, count):
    """4099 is 1003h: no neighbour can be used."""
    order = start_program(0x1003)
    cell = Cell(LinkProfile(baudrate=11000, dle_stuffing=stuffing), answers([response(order)]))
    cell.host.order(order)
    notices = [event for event in cell.run() if isinstance(event, LinkNotice)]
    assert [notice.kind for notice in notices] == ["10 03 in data"] * count
    assert all("start program" in notice.text for notice in notices)
    assert cell.host.link.counters["10 03 in data"] == count
