"""Tests of the emulated controller with site-specific extensions: orders with memories, programs, several blocks.

The controller is accessed through the project's own link; other tests check its blocks and headers.
"""

from dataclasses import replace

import pytest

from emulators.devices.s3 import S3Controller, S3Profiles, S3Site, SiteOrders
from emulators.seams import StartPose
from protocol.devices.s3.adlp import Link, LinkProfile, MessageReceived, Role
from protocol.devices.s3.arap import (
    Emulation,
    Mode,
    OrderBook,
    OrderDefinition,
    Payload,
    ProgramAnswer,
    Refusal,
    Rest,
    Telegram,
    join_blocks,
    receive_program,
    split_telegram,
    start_program,
    stop_program,
    write_mode,
)
from protocol.fields import Field, Layout
from protocol.marks import Mark

T0 = 700.125


def word(name: str, byte: int, kind: str = "H", scale: float = 1.0) -> Field:
    return Field(name, byte - 8, kind, Mark.ASSUMED, "", scale)


def payload(size: int, *fields: Field, rest: Rest | None = None) -> Payload:
    return Payload(Layout("payload", size, ">", fields), rest)


NUMBER = word("number", 8)
READ = OrderDefinition(
    "read_register",
    6,
    payload(2, NUMBER),
    payload(4, NUMBER, word("value", 10, "h", 0.5)),
    emulation=Emulation("register", ("number",), {"value": 1.5}),
)
WRITE = OrderDefinition(
    "write_register",
    14,
    payload(6, NUMBER, word("value", 10, "i", 0.25)),
    emulation=Emulation("register", ("number",)),
)
CONTENT = Rest("content", Mark.ASSUMED)
SEND = OrderDefinition(
    "send_program",
    1,
    payload(2, word("program", 8), rest=CONTENT),
    blocks="several",
    emulation=Emulation("sent", ("program",)),
)
FETCH = OrderDefinition(
    "fetch",
    21,
    payload(2, word("program", 8)),
    payload(0, rest=CONTENT),
    emulation=Emulation("sent", ("program",)),
)
OVERRIDE = OrderDefinition(
    "read_status_more",
    19,
    answer=payload(26, word("override", 32)),
    extends=True,
    emulation=Emulation(initial={"override": 80}),
)
PROFILE = LinkProfile()


class Host:
    """Host of the controller over a wire without delay."""

    def __init__(self, *definitions: OrderDefinition, programs: dict[int, bytes] | None = None) -> None:
        self.book = OrderBook(definitions)
        self.robot = S3Controller(
            S3Profiles(link=PROFILE),
            StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2),
            T0,
            1,
            S3Site(self.book, programs or {}),
        )
        self.link = Link(Role.HOST, PROFILE)
        self.now = T0
        self.blocks: tuple[bytes, ...] = ()

    def ask(self, *telegrams: Telegram) -> Telegram:
        """Return the answer to one order, with all its blocks joined."""
        self.link.send([telegram.encode() for telegram in telegrams])
        while True:
            while to_robot := self.link.data_to_send(self.now):
                self.robot.receive(to_robot, self.now)
                self.link.receive(self.robot.data_to_send(self.now), self.now)
            while to_host := self.robot.data_to_send(self.now):
                self.link.receive(to_host, self.now)
                self.robot.receive(self.link.data_to_send(self.now), self.now)
            while (event := self.link.next_event()) is not None:
                if isinstance(event, MessageReceived):
                    self.blocks = event.telegrams
                    return join_blocks([Telegram.decode(raw, from_robot=True) for raw in self.blocks])
            due = self.robot.next_deadline()
            assert due is not None, "the robot has nothing more to say"
            self.now = due
            self.robot.handle_deadline(due)

    def call(self, name: str, suffix: int | None = None, **values: float | bytes) -> dict[str, float | bytes]:
        definition = self.book.named(name)
        answer = self.ask(*definition.telegrams(values, suffix, PROFILE))
        assert answer.type == 2, Refusal.from_telegram(answer).text
        return definition.answer.decode(answer.data)

    def refusal(self, *telegrams: Telegram) -> int:
        return Refusal.from_telegram(self.ask(*telegrams)).code


def test_register_is_read_in_unit_of_answer() -> None:
    host = Host(READ, WRITE)
    assert host.call("read_register", number=3) == {"number": 3, "value": 1.5}
    assert host.call("write_register", number=3, value=-7.25) == {}
    assert host.call("write_register", number=4, value=2.0) == {}
    assert host.call("read_register", number=3) == {"number": 3, "value": -7.0}, "steps of 0.5"
    assert host.call("read_register", number=4) == {"number": 4, "value": 2.0}
    assert host.call("read_register", number=5) == {"number": 5, "value": 1.5}


def test_value_too_large_for_answer_is_refused_with_31() -> None:
    host = Host(READ, WRITE)
    host.call("write_register", number=3, value=1e6)
    assert host.refusal(*READ.telegrams({"number": 3}, None, PROFILE)) == 31


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emulators.devices.s3.site.PLACE_LIMIT", 2)
    host = Host(READ, WRITE)
    host.call("write_register", number=1, value=1.0)
    host.call("write_register", number=2, value=1.0)
    assert host.refusal(*WRITE.telegrams({"number": 3}, None, PROFILE)) == 10
    assert host.call("read_register", number=3)["value"] == 1.5
    host.call("write_register", number=2, value=5.0)
    assert host.call("read_register", number=2)["value"] == 5.0


def test_order_without_memory_may_echo() -> None:
    echo = OrderDefinition(
        "echo",
        45,
        payload(2, NUMBER),
        payload(4, NUMBER, word("version", 10)),
        emulation=Emulation(initial={"version": 33}),
    )
    host = Host(echo)
    assert host.call("echo", number=9) == {"number": 9, "version": 33}
    assert host.call("echo") == {"number": 0, "version": 33}


def test_site_orders_are_refused_like_known_ones() -> None:
    host = Host(READ)
    assert host.refusal(Telegram(6, 1, 1, b"\0\1")) == 2, "suffix"
    assert host.refusal(Telegram(6, 1, 0, b"\0")) == 255, "too short"
    assert host.refusal(Telegram(7, 1, 0, b"\0\1")) == 11, "not defined"
    assert Host().refusal(Telegram(6, 1, 0, b"\0\1")) == 11
    host.robot.set_link_control(False, host.now)
    assert host.refusal(Telegram(6, 1, 0, b"\0\1")) == 5


def test_multi_block_order_and_answer_are_complete() -> None:
    content = bytes(range(256)) * 3
    host = Host(SEND, FETCH)
    host.call("send_program", program=7, content=content)
    assert host.call("fetch", program=7) == {"content": content}
    assert [raw[5] for raw in host.blocks] == [0x0A] * 6 + [0x02]
    assert host.call("fetch", program=8) == {"content": b""}


def test_unexpected_multi_block_order_is_refused() -> None:
    host = Host(SEND, READ)
    long = split_telegram(Telegram(6, 1, 0, bytes(200)), 128)
    assert host.refusal(*long) == 4
    assert host.refusal(*split_telegram(Telegram(2, 1, 0, bytes(300)), 128)) == 4
    assert host.refusal(*SEND.telegrams({"content": bytes(300)}, None, PROFILE)[:2]) == 255
    assert host.refusal(long[0], long[1]._replace(function=1)) == 255
    assert host.refusal(Telegram(6, 9, 0, b"\0\1")) == 255


def test_uploaded_program_is_received_and_started() -> None:
    content = bytes(range(200)) * 2
    host = Host(programs={7: content, 9: b""})
    answer = ProgramAnswer.from_telegram(host.ask(receive_program(7)))
    assert answer == ProgramAnswer(7, content)
    assert [raw[5] for raw in host.blocks] == [0x0A, 0x0A, 0x0A, 0x02]
    # Header: length 128, from the robot, function 29, further block, suffix; error 0, program 7, contents.
    assert host.blocks[0][:16] == bytes.fromhex("0080 00 00 1D 0A 0000 0000 0007 00010203")
    assert ProgramAnswer.from_telegram(host.ask(receive_program(9))).content == b""
    assert host.refusal(receive_program(1)) == 7, "of program 1 only the number is known"
    assert host.ask(write_mode(Mode.OPERATION)).type == 2
    assert host.ask(start_program(7)).type == 2
    assert host.ask(stop_program()).type == 2
    assert host.ask(start_program(1)).type == 2


def test_site_extends_answer_of_known_order() -> None:
    host, plain = Host(OVERRIDE), Host()
    values = host.call("read_status_more")
    assert values == plain.call("read_status") | {"override": 80}
    assert (values["x"], values["flags_17"]) == (0.9, 1)
    assert plain.refusal(Telegram(19, 1, 1)) == 2, "and refusals stay as they are"
    assert host.refusal(Telegram(19, 1, 1)) == 2


def test_invalid_extension_refuses_order() -> None:
    override = replace(
        OVERRIDE,
        order=payload(2, word("level", 8)),
        answer=payload(25, word("level", 32, "B")),
        emulation=Emulation(),
    )
    orders = SiteOrders(OrderBook([override]))
    assert orders.extend(Telegram(19, 1, 0, b"\1\0"), Telegram(19, 2, 0, bytes(24), True)) == 31
    assert Host(override).call("read_status_more", level=7)["level"] == 7
