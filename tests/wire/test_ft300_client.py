"""Client of an FT 300: its requests, its stream, lost responses, and silence."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.ft300 import STOP, Ft300Client, Ft300ClientProfile, encode_message
from protocol.devices.ft300.messages import READ, encode_exception, encode_read, encode_words, encode_write
from protocol.endpoint import LocalProtocolError
from protocol.wrench import SensorFailed, SensorReady, SensorStopped, WrenchFrame, Zeroed

T0 = 1000.25
VERSION, SERIAL = encode_words(READ, [0x4654, 0x5301, 0x0203]), encode_words(READ, [0x4654, 0x5300, 7, 1])
ASK_VERSION, ASK_SERIAL, START = encode_read(500, 3), encode_read(510, 4), encode_write(410, 0x0200)
STARTED = bytes.fromhex("0910019A00012152")
MESSAGE = encode_message((1, -2, 3, -4, 5, -6))
OTHER = encode_message((1, -2, 4, -4, 5, -6))


def events(client: Ft300Client) -> list[Any]:
    items = []
    while (event := client.next_event()) is not None:
        items.append(event)
    return items


def expect(client: Ft300Client, now: float, sent: bytes) -> None:
    if (due := client.next_deadline()) is not None and due <= now:
        client.handle_deadline(now)
    assert client.data_to_send(now) == sent


def request_all(client: Ft300Client) -> None:
    """Requests before the first sample."""
    assert client.data_to_send(T0) == STOP
    client.receive(MESSAGE[3:] + MESSAGE, T0 + 0.05)  # of the stream that ends
    expect(client, T0 + 0.11, ASK_VERSION)
    client.receive(MESSAGE[9:] + VERSION[:3], T0 + 0.12)
    client.receive(VERSION[3:], T0 + 0.13)
    expect(client, T0 + 0.13, ASK_SERIAL)
    client.receive(SERIAL, T0 + 0.15)


def streaming(**settings: Any) -> Ft300Client:
    client = Ft300Client(Ft300ClientProfile(**settings), T0)
    request_all(client)
    expect(client, T0 + 0.15, START)
    client.receive(STARTED + MESSAGE, T0 + 0.2)
    ready, frame = events(client)
    assert isinstance(ready, SensorReady)
    assert ready.facts.model == "FT 300, firmware FTS-1.2.3, number FTS-65543"
    assert ready.facts.period == 0.01
    assert frame == WrenchFrame((1, -2, 3, -4, 5, -6), 1, 1, T0 + 0.2)
    return client


def test_client_identifies_the_sensor_and_streams() -> None:
    client = streaming()
    client.receive(MESSAGE[:7], T0 + 0.21)
    client.receive(MESSAGE[7:], T0 + 0.22)
    assert [(event.sequence, event.at) for event in events(client)] == [(2, T0 + 0.22)]
    assert client.statistics.malformed == 0


def test_stream_with_lost_announcement_is_accepted() -> None:
    client = Ft300Client(Ft300ClientProfile(), T0)
    request_all(client)
    expect(client, T0 + 0.15, START)
    client.receive(MESSAGE + OTHER, T0 + 0.3)
    assert [type(event) for event in events(client)] == [SensorReady, WrenchFrame, WrenchFrame]


def test_client_repeated_message_is_reported_once() -> None:
    client = streaming()
    client.receive(OTHER * 2 + MESSAGE, T0 + 0.21)
    client.receive(MESSAGE, T0 + 0.212)
    client.receive(MESSAGE, T0 + 0.222)  # in its own time: a sensor may stand still
    assert [event.at - T0 for event in events(client)] == pytest.approx([0.21, 0.21, 0.222])
    assert client.statistics.repeated == 2


def test_client_bytes_between_messages_count_by_their_length() -> None:
    client = streaming()
    client.receive(MESSAGE[:1] + OTHER, T0 + 0.21)  # a byte that comes twice takes the place of nothing
    assert (client.statistics.malformed, client.statistics.lost) == (1, 0)
    client.receive(MESSAGE[:5] + b"\0" + MESSAGE[6:] + OTHER[1:] + MESSAGE, T0 + 0.25)
    assert client.statistics.lost == 2


def test_unanswered_requests_are_repeated_after_a_stop() -> None:
    client = Ft300Client(Ft300ClientProfile(tries=3), T0)
    sent, now = [client.data_to_send(T0)], T0
    for _ in range(8):
        due = client.next_deadline()
        if due is None:
            break
        now = due
        client.handle_deadline(now)
        sent.append(client.data_to_send(now))
    assert sent == [STOP, ASK_VERSION, STOP, ASK_VERSION, STOP, ASK_VERSION, b""]
    (failed,) = events(client)
    assert isinstance(failed, SensorFailed)
    assert "after 3 requests" in failed.text
    with pytest.raises(LocalProtocolError):
        client.zero()


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (encode_exception(READ, 2), "unknown register (2)"),
        (encode_words(READ, [0x4754, 0x5301, 0x0203]), "not an FT 300"),
    ],
)
def test_invalid_response_ends_the_session(answer: bytes, message: str) -> None:
    client = Ft300Client(Ft300ClientProfile(), T0)
    client.data_to_send(T0)
    expect(client, T0 + 0.11, ASK_VERSION)
    client.receive(answer, T0 + 0.2)
    (failed,) = events(client)
    assert message in failed.text
    client.receive(VERSION, T0 + 0.3)
    assert client.data_to_send(T0 + 0.3) == b""


def test_silence_ends_the_session() -> None:
    client = streaming()
    client.handle_deadline(T0 + 0.5)
    assert events(client) == []
    client.handle_deadline(T0 + 1.3)
    (failed,) = events(client)
    assert "no message received for 1 s" in failed.text


def test_axis_from_its_rating_on_is_not_trusted() -> None:
    client = streaming()
    client.receive(encode_message((30000, 29999, -32768, 29999, -30000, 0)), T0 + 0.3)
    (frame,) = events(client)
    assert frame.saturated == 0b010101


def test_zero_is_the_hosts() -> None:
    client = streaming(zero_s=0.02)
    client.zero()
    client.receive(b"".join(encode_message((k, 0, 0, 0, 0, 0)) for k in (10, 12, 20)), T0 + 0.3)
    reports = events(client)
    assert [type(event) for event in reports] == [WrenchFrame, WrenchFrame, Zeroed, WrenchFrame]
    assert reports[-1].values[0] == 9.0


def test_damaged_messages_are_counted_and_skipped() -> None:
    client = streaming()
    client.receive(MESSAGE[:5] + b"\0" + MESSAGE[6:] + MESSAGE, T0 + 0.3)
    assert len(events(client)) == 1
    assert client.statistics.malformed == 1


def test_stop_is_repeated_while_the_stream_continues() -> None:
    client = streaming()
    client.stop()
    client.stop()
    expect(client, T0 + 0.3, STOP)
    client.handle_deadline(T0 + 0.3)
    client.receive(MESSAGE, T0 + 0.35)
    expect(client, T0 + 0.41, STOP)
    expect(client, T0 + 0.52, b"")
    assert events(client) == [SensorStopped()]
    idle = Ft300Client(Ft300ClientProfile(), T0)
    idle.stop()
    assert events(idle) == [SensorStopped()]


# --- question by question


def test_modbus_client_polls_continuously() -> None:
    client = Ft300Client(Ft300ClientProfile(mode="modbus"), T0)
    request_all(client)
    ask = encode_read(180, 6)
    expect(client, T0 + 0.15, ask)
    client.receive(encode_words(READ, [1, 0xFFFE, 3, 4, 5, 6]), T0 + 0.17)
    ready, frame = events(client)
    assert ready.facts.period is None
    assert (frame.values, frame.sequence) == ((1, -2, 3, 4, 5, 6), 1)
    expect(client, T0 + 0.17, ask)
    expect(client, T0 + 0.6, ask)  # the answer was lost
    client.receive(encode_words(READ, [1, 0xFFFE, 3, 4, 5, 6]), T0 + 0.62)
    assert events(client)[0].sequence == 2
    for k in range(8):
        client.handle_deadline(T0 + 2.0 + k)
    assert isinstance(events(client)[-1], SensorFailed)


@given(st.lists(st.binary(max_size=60), max_size=10), st.sampled_from(["stream", "modbus"]))
def test_no_bytes_raise(data: list[bytes], mode: Any) -> None:
    client = Ft300Client(Ft300ClientProfile(mode=mode), T0)
    for k, piece in enumerate(data):
        client.receive(piece, T0 + 0.05 * k)
        if (due := client.next_deadline()) is not None:
            client.handle_deadline(due)
        client.data_to_send(T0)
        events(client)


def test_invalid_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="mode must be"):
        Ft300ClientProfile(mode="other")  # type: ignore[arg-type]
