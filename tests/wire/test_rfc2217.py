"""RFC 2217: bytes from the standards, any split, garbage, and client and server against each other and alone."""

import re
from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.rfc2217 import (
    BreakSet,
    Command,
    ComParity,
    ComPortClient,
    ComPortServer,
    Garbled,
    LineState,
    LineStateChanged,
    Malformed,
    Negotiation,
    Option,
    Payload,
    PortFailed,
    PortReady,
    PortSettings,
    SerialData,
    SettingsChanged,
    StopSize,
    Subnegotiation,
    TelnetReader,
    Verb,
    decode_command,
    encode_command,
    escaped,
    negotiation,
    subnegotiation,
)

EVEN = PortSettings(9600, ComParity.EVEN)


def drained(endpoint: Any) -> list[Any]:
    events = []
    while (event := endpoint.next_event()) is not None:
        events.append(event)
    return events


def joined(events: Iterable[Any]) -> list[Any]:
    """Payload that came in pieces as one."""
    whole: list[Any] = []
    for event in events:
        if isinstance(event, Payload | SerialData) and whole and type(whole[-1]) is type(event):
            whole[-1] = type(event)(whole[-1].data + event.data)
        else:
            whole.append(event)
    return whole


# --- bytes

GOLDEN = [
    # RFC 2217 section 2: "IAC SB COM-PORT-OPTION SET-BAUDRATE <value(4)> IAC SE", codes 255 250 44 1 ... 255 240
    (Command.SET_BAUDRATE, 9600, False, "FF FA 2C 01 00 00 25 80 FF F0"),
    (Command.SET_BAUDRATE, 19_200, True, "FF FA 2C 65 00 00 4B 00 FF F0"),
    (Command.SET_DATASIZE, 8, False, "FF FA 2C 02 08 FF F0"),
    (Command.SET_PARITY, ComParity.EVEN, False, "FF FA 2C 03 03 FF F0"),
    (Command.SET_PARITY, ComParity.NONE, True, "FF FA 2C 67 01 FF F0"),
    (Command.SET_STOPSIZE, StopSize.TWO, False, "FF FA 2C 04 02 FF F0"),
    (Command.SET_CONTROL, 5, False, "FF FA 2C 05 05 FF F0"),
    (Command.NOTIFY_LINESTATE, 8, True, "FF FA 2C 6A 08 FF F0"),
    (Command.FLOWCONTROL_SUSPEND, 0, True, "FF FA 2C 6C FF F0"),
    (Command.FLOWCONTROL_RESUME, 0, False, "FF FA 2C 09 FF F0"),
    # a value of 255 is doubled: RFC 2217 section 2, "If the value is 255, it must be doubled"
    (Command.SET_MODEMSTATE_MASK, 255, False, "FF FA 2C 0B FF FF FF F0"),
]


@pytest.mark.parametrize(("command", "value", "server", "golden"), GOLDEN)
def test_golden_commands(command: Command, value: int, server: bool, golden: str) -> None:
    data = bytes.fromhex(golden)
    assert encode_command(command, value, server=server) == data
    (event,) = TelnetReader().receive(data)
    assert isinstance(event, Subnegotiation)
    assert event.option == Option.COM_PORT
    assert decode_command(event.data, server=server) == (command, value)


def test_golden_negotiation() -> None:
    # RFC 2217 section 1: WILL COM-PORT-OPTION is 255 251 44; DO BINARY is 255 253 0 (RFC 856)
    assert negotiation(Verb.WILL, Option.COM_PORT) == bytes.fromhex("FF FB 2C")
    assert TelnetReader().receive(bytes.fromhex("FF FD 00")) == [Negotiation(Verb.DO, Option.BINARY)]


def test_signature_is_a_text_of_any_length() -> None:
    said = encode_command(Command.SIGNATURE, b"hil\xff", server=True)
    assert said == b"\xff\xfa\x2c\x64hil\xff\xff\xff\xf0"
    assert decode_command(b"\x64hil\xff", server=True) == (Command.SIGNATURE, 0)
    assert encode_command(Command.SIGNATURE) == b"\xff\xfa\x2c\x00\xff\xf0"


@given(
    st.sampled_from([c for c in Command if c is not Command.SIGNATURE]), st.integers(0, 255), st.booleans()
)
def test_commands_round_trip(command: Command, value: int, server: bool) -> None:
    if command in (Command.FLOWCONTROL_SUSPEND, Command.FLOWCONTROL_RESUME):
        value = 0
    (event,) = TelnetReader().receive(encode_command(command, value, server=server))
    assert isinstance(event, Subnegotiation)
    assert decode_command(event.data, server=server) == (command, value)


@given(st.lists(st.binary(max_size=6)))
def test_payload_round_trips_in_any_split(pieces: list[bytes]) -> None:
    reader, read = TelnetReader(), b""
    travelling = escaped(b"".join(pieces))
    for k in range(0, len(travelling), 3):
        for event in reader.receive(travelling[k : k + 3]):
            assert isinstance(event, Payload)
            read += event.data
    assert read == b"".join(pieces)


SAID = (
    b"one\xff\xfftwo"
    + negotiation(Verb.DONT, 44)
    + b"\xff\xf1three\xff\xf9"
    + subnegotiation(44, b"\x01\xff\xf0\x00")
    + subnegotiation(24, b"")
    + b"\xff\xff"
)
MEANT = [
    Payload(b"one\xfftwo"),
    Negotiation(Verb.DONT, 44),
    Payload(b"three"),
    Subnegotiation(44, b"\x01\xff\xf0\x00"),
    Subnegotiation(24, b""),
    Payload(b"\xff"),
]


@given(st.sets(st.integers(0, len(SAID)), max_size=8))
def test_any_split_gives_the_same_events(cuts: set[int]) -> None:
    reader, events, at = TelnetReader(), [], 0
    for cut in (*sorted(cuts), len(SAID)):
        events += reader.receive(SAID[at:cut])
        at = cut
    assert joined(events) == MEANT


@pytest.mark.parametrize(
    ("garbage", "says"),
    [
        (b"\xff\x05", "05h, which is no command"),
        (b"\xff\xfa\xff\xf0", "names no option"),
        (b"\xff\xfa\x2c" + bytes(300) + b"\xff\xff\xff\xf0", "longer than 256 bytes"),
        (b"\xff\xfa\x2c\x01\xff\xf1", "has no end"),
        (b"\xff\xfa\x2c\x01\xff\x05", "has no end"),
    ],
)
def test_garbage_is_told_and_what_follows_is_read(garbage: bytes, says: str) -> None:
    (bad, good) = TelnetReader().receive(garbage + b"good")
    assert isinstance(bad, Garbled)
    assert says in bad.text
    assert good == Payload(b"good")


def test_a_command_ends_a_subnegotiation_whose_end_was_lost() -> None:
    events = TelnetReader().receive(b"\xff\xfa\x2c\x01" + negotiation(Verb.DO, 44) + b"\xff\xfa\x2c\x02")
    assert [type(event) for event in events] == [Garbled, Negotiation]
    reader = TelnetReader()
    events = reader.receive(b"\xff\xfa\x2c\x01" + subnegotiation(44, b"\x02\x08"))
    assert events[1:] == [Subnegotiation(44, b"\x02\x08")]


@given(st.binary(max_size=300))
@settings(max_examples=200, deadline=None)
def test_arbitrary_bytes_raise_nothing(data: bytes) -> None:
    for endpoint in (ComPortClient(EVEN, 0.0), ComPortServer(EVEN)):
        endpoint.receive(data, 0.0)
        drained(endpoint)
        assert len(endpoint.data_to_send(0.0)) < 20 * len(data) + 200


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "no code"),
        (b"\x0d", "no com port command 13"),
        (b"\x01\x00", "SET_BAUDRATE came with 1 bytes, not 4"),
        (b"\x08\x00", "FLOWCONTROL_SUSPEND came with 1 bytes, not 0"),
        (b"\x65\x00\x00\x00\x00", "no com port command 101"),
    ],
)
def test_a_command_that_is_none_is_the_other_sides_fault(data: bytes, says: str) -> None:
    with pytest.raises(RemoteProtocolError, match=says):
        decode_command(data, server=False)


@pytest.mark.parametrize(
    ("command", "value", "says"),
    [
        (Command.SET_PARITY, 256, "cannot carry 256"),
        (Command.SET_BAUDRATE, -1, "cannot carry -1"),
        (Command.SET_BAUDRATE, b"\x00", "needs a value of 4 bytes"),
    ],
)
def test_a_value_that_does_not_fit_is_our_fault(command: Command, value: int | bytes, says: str) -> None:
    with pytest.raises(LocalProtocolError, match=says):
        encode_command(command, value)


# --- client and server


def settle(client: ComPortClient, server: ComPortServer) -> None:
    """Carry what both say until neither has more to say; two that answer each other for ever fail."""
    for _ in range(20):
        to_server, to_client = client.data_to_send(0.0), server.data_to_send(0.0)
        if not to_server and not to_client:
            return
        server.receive(to_server, 0.0)
        client.receive(to_client, 0.0)
    raise AssertionError("they do not come to an end")


def connected(settings: PortSettings = EVEN) -> tuple[ComPortClient, ComPortServer]:
    client, server = ComPortClient(settings, 0.0), ComPortServer(PortSettings(300))
    settle(client, server)
    return client, server


@given(st.integers(1, 2**32 - 1), st.sampled_from((ComParity.NONE, ComParity.ODD, ComParity.EVEN)))
@settings(max_examples=30)
def test_a_client_sets_the_port_and_is_ready(baudrate: int, parity: ComParity) -> None:
    wanted = PortSettings(baudrate, parity, StopSize.TWO)
    client, server = connected(wanted)
    assert drained(client) == [PortReady()]
    assert client.next_deadline() is None
    assert server.settings == wanted
    assert all(isinstance(event, SettingsChanged) for event in drained(server))
    assert server.next_deadline() is None
    server.handle_deadline(1.0)


def test_payload_passes_both_ways_whatever_it_is() -> None:
    client, server = connected()
    drained(client), drained(server)
    client.send(bytes(range(256)) + b"\xff")
    server.send(b"\xff\xfa" + bytes(range(256)))
    settle(client, server)
    assert joined(drained(server)) == [SerialData(bytes(range(256)) + b"\xff")]
    assert joined(drained(client)) == [SerialData(b"\xff\xfa" + bytes(range(256)))]


def test_what_a_port_cannot_do_is_one_clear_line() -> None:
    for wanted, says in (
        (
            PortSettings(9600, ComParity.MARK),
            "SET_PARITY with 1, not 4; allow 9600 baud, 8 data bits, parity mark",
        ),
        (
            PortSettings(9600, stop_size=StopSize.ONE_AND_A_HALF),
            "SET_STOPSIZE with 1, not 3; allow .* 1.5 stop",
        ),
        (PortSettings(9600, data_size=7), "SET_DATASIZE with 8, not 7"),
    ):
        client, server = connected(wanted)
        (failed,) = drained(client)
        assert isinstance(failed, PortFailed)
        assert re.search(says, failed.text)
        assert server.settings.data_size == 8
        with pytest.raises(LocalProtocolError, match="not ready"):
            client.send(b"x")


def test_a_port_that_is_set_otherwise_later_has_failed() -> None:
    client, _ = connected()
    drained(client)
    client.receive(encode_command(Command.SET_BAUDRATE, 9600, server=True), 1.0)
    client.receive(encode_command(Command.SET_CONTROL, 1, server=True), 1.0)
    assert drained(client) == []
    client.receive(encode_command(Command.SET_BAUDRATE, 300, server=True), 1.0)
    client.receive(encode_command(Command.SET_BAUDRATE, 300, server=True), 1.0)
    (failed,) = drained(client)
    assert isinstance(failed, PortFailed)
    assert "SET_BAUDRATE with 300, not 9600" in failed.text


def test_a_server_that_is_silent_or_does_not_confirm_is_given_up() -> None:
    client = ComPortClient(EVEN, 5.0, patience_s=2.0)
    assert client.next_deadline() == 7.0
    client.handle_deadline(6.9)
    assert drained(client) == []
    client.handle_deadline(7.0)
    assert drained(client) == [
        PortFailed("the server does not answer in Telnet; a raw port is reached as tcp://")
    ]
    client.handle_deadline(8.0)
    assert drained(client) == []

    client = ComPortClient(EVEN, 5.0, patience_s=2.0)
    client.receive(negotiation(Verb.DO, Option.COM_PORT), 5.1)
    for command, value in ((Command.SET_BAUDRATE, 9600), (Command.SET_DATASIZE, 8), (Command.SET_PARITY, 3)):
        client.receive(encode_command(command, value, server=True), 5.2)
    client.handle_deadline(7.0)
    (failed,) = drained(client)
    assert failed == PortFailed(
        "the server does not confirm SET_STOPSIZE; look at its own settings for this port"
    )


def test_a_server_without_the_option_is_given_up_at_once() -> None:
    client = ComPortClient(EVEN, 0.0)
    client.receive(negotiation(Verb.DONT, Option.COM_PORT), 0.1)
    assert drained(client) == [
        PortFailed("the server has no com port control; a raw port is reached as tcp://")
    ]
    # later bytes from it change nothing
    client.receive(negotiation(Verb.DONT, Option.COM_PORT), 0.2)
    client.receive(negotiation(Verb.DO, Option.COM_PORT), 0.2)
    client.receive(encode_command(Command.SET_PARITY, 1, server=True), 0.2)
    assert drained(client) == []


def test_line_errors_are_told_to_a_client_that_wants_them() -> None:
    client, server = connected()
    drained(client)
    server.notify(LineState.FRAMING | LineState.BREAK)
    settle(client, server)
    assert drained(client) == [LineStateChanged(LineState.FRAMING | LineState.BREAK)]
    client.receive(encode_command(Command.NOTIFY_LINESTATE, 0x61, server=True), 0.0)  # no errors
    assert drained(client) == []
    silent = ComPortServer(EVEN)
    silent.notify(LineState.PARITY)
    assert silent.data_to_send(0.0) == b""


def test_a_break_is_begun_and_ended_once() -> None:
    client, server = connected()
    drained(server)
    for on in (True, True, False):
        client.set_break(on)
    settle(client, server)
    assert drained(server) == [BreakSet(True), BreakSet(False)]
    with pytest.raises(LocalProtocolError, match="not ready"):
        ComPortClient(EVEN, 0.0).set_break(True)


@pytest.mark.parametrize(
    ("command", "value", "answer"),
    [
        (Command.SET_BAUDRATE, 0, 300),
        (Command.SET_PARITY, 0, ComParity.NONE),
        (Command.SET_STOPSIZE, 0, StopSize.ONE),
        (Command.SET_CONTROL, 0, 1),  # flow control is asked for, or wanted: there is none
        (Command.SET_CONTROL, 3, 1),
        (Command.SET_CONTROL, 4, 6),
        (Command.SET_CONTROL, 7, 8),
        (Command.SET_CONTROL, 9, 9),
        (Command.SET_CONTROL, 11, 11),
        (Command.SET_CONTROL, 13, 14),
        (Command.SET_CONTROL, 16, 14),
        (Command.NOTIFY_LINESTATE, 0, 0),
        (Command.NOTIFY_MODEMSTATE, 0, 0xB0),
        (Command.SET_MODEMSTATE_MASK, 255, 255),
        (Command.PURGE_DATA, 3, 3),
    ],
)
def test_a_server_answers_every_command(command: Command, value: int, answer: int) -> None:
    server = ComPortServer(PortSettings(300))
    server.receive(encode_command(command, value), 0.0)
    assert server.data_to_send(0.0) == encode_command(command, answer, server=True)
    assert drained(server) == []


def test_a_switch_is_remembered() -> None:
    server = ComPortServer(EVEN)
    for value in (9, 7):
        server.receive(encode_command(Command.SET_CONTROL, value), 0.0)
    assert server.data_to_send(0.0) == 2 * encode_command(Command.SET_CONTROL, 9, server=True)


def test_a_server_says_who_it_is_and_refuses_what_it_does_not_know() -> None:
    server = ComPortServer(EVEN)
    assert server.data_to_send(0.0) == b""
    server.receive(encode_command(Command.SIGNATURE), 0.0)
    assert server.data_to_send(0.0) == b"\xff\xfa\x2c\x64hil-bridge\xff\xf0"
    server.receive(negotiation(Verb.DO, 1), 0.0)
    server.receive(negotiation(Verb.WILL, 24), 0.0)
    assert server.data_to_send(0.0) == negotiation(Verb.WONT, 1) + negotiation(Verb.DONT, 24)
    for _ in range(2):  # the second time nothing changes
        server.receive(negotiation(Verb.DO, Option.BINARY), 0.0)
    assert server.data_to_send(0.0) == negotiation(Verb.WILL, Option.BINARY)
    for _ in range(2):
        server.receive(negotiation(Verb.DONT, Option.BINARY), 0.0)
    assert server.data_to_send(0.0) == negotiation(Verb.WONT, Option.BINARY)
    server.receive(subnegotiation(24, b"xterm") + subnegotiation(44, b"\x63"), 0.0)
    assert drained(server) == [
        Malformed("option 24 is not in use"),
        Malformed("there is no com port command 99"),
    ]
    server.receive(b"\xff\x01", 0.0)
    assert drained(server) == [Malformed("FFh was followed by 01h, which is no command")]


def test_who_asks_for_silence_gets_it_and_nothing_is_lost() -> None:
    client, server = connected()
    drained(client)
    server.receive(encode_command(Command.FLOWCONTROL_SUSPEND), 0.0)
    server.send(b"later")
    server.receive(encode_command(Command.SET_PARITY, 0), 0.0)
    assert server.data_to_send(0.0) == b""
    server.receive(encode_command(Command.FLOWCONTROL_RESUME), 0.0)
    settle(client, server)
    assert drained(client) == [SerialData(b"later")]


@pytest.mark.full
def test_silence_is_bounded() -> None:
    _, server = connected()
    server.receive(encode_command(Command.FLOWCONTROL_SUSPEND), 0.0)
    for _ in range(200):
        server.receive(encode_command(Command.SIGNATURE) * 200, 0.0)
    server.send(bytes(60_000))
    with pytest.raises(LocalProtocolError, match="more than 65536 bytes wait"):
        server.send(bytes(60_000))
    server.receive(encode_command(Command.FLOWCONTROL_RESUME), 0.0)
    assert len(server.data_to_send(0.0)) <= 2 * 65536
