"""RFC 2217: bytes from the standards, any split, garbage, and client and server together and alone."""

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
    """Return payload that arrived in pieces as one."""
    complete: list[Any] = []
    for event in events:
        if isinstance(event, Payload | SerialData) and complete and type(complete[-1]) is type(event):
            complete[-1] = type(event)(complete[-1].data + event.data)
        else:
            complete.append(event)
    return complete


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
    data = encode_command(Command.SIGNATURE, b"hil\xff", server=True)
    assert data == b"\xff\xfa\x2c\x64hil\xff\xff\xff\xf0"
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


ENCODED = (
    b"one\xff\xfftwo"
    + negotiation(Verb.DONT, 44)
    + b"\xff\xf1three\xff\xf9"
    + subnegotiation(44, b"\x01\xff\xf0\x00")
    + subnegotiation(24, b"")
    + b"\xff\xff"
)
EXPECTED_EVENTS = [
    Payload(b"one\xfftwo"),
    Negotiation(Verb.DONT, 44),
    Payload(b"three"),
    Subnegotiation(44, b"\x01\xff\xf0\x00"),
    Subnegotiation(24, b""),
    Payload(b"\xff"),
]


@given(st.sets(st.integers(0, len(ENCODED)), max_size=8))
def test_any_split_gives_the_same_events(cuts: set[int]) -> None:
    reader, events, at = TelnetReader(), [], 0
    for cut in (*sorted(cuts), len(ENCODED)):
        events += reader.receive(ENCODED[at:cut])
        at = cut
    assert joined(events) == EXPECTED_EVENTS


@pytest.mark.parametrize(
    ("garbage", "message"),
    [
        (b"\xff\x05", "05h, which is not a command"),
        (b"\xff\xfa\xff\xf0", "without an option"),
        (b"\xff\xfa\x2c" + bytes(300) + b"\xff\xff\xff\xf0", "longer than 256 bytes"),
        (b"\xff\xfa\x2c\x01\xff\xf1", "is not terminated"),
        (b"\xff\xfa\x2c\x01\xff\x05", "is not terminated"),
    ],
)
def test_garbage_is_reported_and_reading_continues(garbage: bytes, message: str) -> None:
    (bad, good) = TelnetReader().receive(garbage + b"good")
    assert isinstance(bad, Garbled)
    assert message in bad.text
    assert good == Payload(b"good")


def test_command_ends_an_unterminated_subnegotiation() -> None:
    events = TelnetReader().receive(b"\xff\xfa\x2c\x01" + negotiation(Verb.DO, 44) + b"\xff\xfa\x2c\x02")
    assert [type(event) for event in events] == [Garbled, Negotiation]
    reader = TelnetReader()
    events = reader.receive(b"\xff\xfa\x2c\x01" + subnegotiation(44, b"\x02\x08"))
    assert events[1:] == [Subnegotiation(44, b"\x02\x08")]


@given(st.binary(max_size=300))
@settings(max_examples=200, deadline=None)
def test_arbitrary_bytes_never_raise(data: bytes) -> None:
    for endpoint in (ComPortClient(EVEN, 0.0), ComPortServer(EVEN)):
        endpoint.receive(data, 0.0)
        drained(endpoint)
        assert len(endpoint.data_to_send(0.0)) < 20 * len(data) + 200


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "without a code"),
        (b"\x0d", "unknown com port command 13"),
        (b"\x01\x00", "SET_BAUDRATE received with 1 bytes instead of 4"),
        (b"\x08\x00", "FLOWCONTROL_SUSPEND received with 1 bytes instead of 0"),
        (b"\x65\x00\x00\x00\x00", "unknown com port command 101"),
    ],
)
def test_invalid_command_is_a_remote_error(data: bytes, message: str) -> None:
    with pytest.raises(RemoteProtocolError, match=message):
        decode_command(data, server=False)


@pytest.mark.parametrize(
    ("command", "value", "message"),
    [
        (Command.SET_PARITY, 256, "cannot carry 256"),
        (Command.SET_BAUDRATE, -1, "cannot carry -1"),
        (Command.SET_BAUDRATE, b"\x00", "needs a value of 4 bytes"),
    ],
)
def test_oversized_value_is_a_local_error(command: Command, value: int | bytes, message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        encode_command(command, value)


# --- client and server


def settle(client: ComPortClient, server: ComPortServer) -> None:
    """Carry data until both sides are silent; two that answer each other endlessly fail."""
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
def test_client_sets_the_port_and_is_ready(baudrate: int, parity: ComParity) -> None:
    port_settings = PortSettings(baudrate, parity, StopSize.TWO)
    client, server = connected(port_settings)
    assert drained(client) == [PortReady()]
    assert client.next_deadline() is None
    assert server.settings == port_settings
    assert all(isinstance(event, SettingsChanged) for event in drained(server))
    assert server.next_deadline() is None
    server.handle_deadline(1.0)


def test_payload_passes_unchanged_in_both_directions() -> None:
    client, server = connected()
    drained(client), drained(server)
    client.send(bytes(range(256)) + b"\xff")
    server.send(b"\xff\xfa" + bytes(range(256)))
    settle(client, server)
    assert joined(drained(server)) == [SerialData(bytes(range(256)) + b"\xff")]
    assert joined(drained(client)) == [SerialData(b"\xff\xfa" + bytes(range(256)))]


def test_unsupported_port_setting_is_one_clear_line() -> None:
    for port_settings, message in (
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
        client, server = connected(port_settings)
        (failed,) = drained(client)
        assert isinstance(failed, PortFailed)
        assert re.search(message, failed.text)
        assert server.settings.data_size == 8
        with pytest.raises(LocalProtocolError, match="not ready"):
            client.send(b"x")


def test_port_changed_later_has_failed() -> None:
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


def test_silent_or_unconfirming_server_times_out() -> None:
    client = ComPortClient(EVEN, 5.0, patience_s=2.0)
    assert client.next_deadline() == 7.0
    client.handle_deadline(6.9)
    assert drained(client) == []
    client.handle_deadline(7.0)
    assert drained(client) == [PortFailed("the server does not respond in Telnet; use tcp:// for a raw port")]
    client.handle_deadline(8.0)
    assert drained(client) == []

    client = ComPortClient(EVEN, 5.0, patience_s=2.0)
    client.receive(negotiation(Verb.DO, Option.COM_PORT), 5.1)
    for command, value in ((Command.SET_BAUDRATE, 9600), (Command.SET_DATASIZE, 8), (Command.SET_PARITY, 3)):
        client.receive(encode_command(command, value, server=True), 5.2)
    client.handle_deadline(7.0)
    (failed,) = drained(client)
    assert failed == PortFailed("the server does not confirm SET_STOPSIZE; check its settings for this port")


def test_server_without_the_option_fails_at_once() -> None:
    client = ComPortClient(EVEN, 0.0)
    client.receive(negotiation(Verb.DONT, Option.COM_PORT), 0.1)
    assert drained(client) == [
        PortFailed("the server does not support com port control; use tcp:// for a raw port")
    ]
    # later bytes from it change nothing
    client.receive(negotiation(Verb.DONT, Option.COM_PORT), 0.2)
    client.receive(negotiation(Verb.DO, Option.COM_PORT), 0.2)
    client.receive(encode_command(Command.SET_PARITY, 1, server=True), 0.2)
    assert drained(client) == []


def test_line_errors_are_reported_to_a_subscribed_client() -> None:
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


def test_break_is_begun_and_ended_once() -> None:
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
def test_server_answers_every_command(command: Command, value: int, answer: int) -> None:
    server = ComPortServer(PortSettings(300))
    server.receive(encode_command(command, value), 0.0)
    assert server.data_to_send(0.0) == encode_command(command, answer, server=True)
    assert drained(server) == []


def test_switch_is_remembered() -> None:
    server = ComPortServer(EVEN)
    for value in (9, 7):
        server.receive(encode_command(Command.SET_CONTROL, value), 0.0)
    assert server.data_to_send(0.0) == 2 * encode_command(Command.SET_CONTROL, 9, server=True)


def test_server_identifies_itself_and_refuses_unknown_commands() -> None:
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
        Malformed("unknown com port command 99"),
    ]
    server.receive(b"\xff\x01", 0.0)
    assert drained(server) == [Malformed("FFh was followed by 01h, which is not a command")]


def test_suspended_transmission_loses_nothing() -> None:
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
    with pytest.raises(LocalProtocolError, match="more than 65536 bytes are queued"):
        server.send(bytes(60_000))
    server.receive(encode_command(Command.FLOWCONTROL_RESUME), 0.0)
    assert len(server.data_to_send(0.0)) <= 2 * 65536
