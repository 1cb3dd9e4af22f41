"""Texts of an FT 300 behind its URCap, and their client: golden bytes, any split, and arbitrary bytes."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.ft300 import Ft300ClientProfile, UrcapClient, describe_texts, encode_text
from protocol.devices.ft300.urcap import TEXT_LIMIT, TextReader, split_texts
from protocol.wrench import SensorFailed, SensorReady, SensorStopped, WrenchFrame, Zeroed

T0 = 1000.25
TEXT = b"( 12.340000 , -2.500000 , -98.099998 , 0.150000 , -0.025000 , 0.007000 )"
VALUES = (12.34, -2.5, -98.099998, 0.15, -0.025, 0.007)
CAPTURED = (
    b"( 0.040000 , 0.100000 , 4.880000 , 0.006000 , 0.000000 , 0.001000 )"
    b"( -0.080000 , 0.060000 , 4.950000 , -0.005000 , 0.012000 , 0.001000 )"
    b"( 0.150000 , -0.350000 , 4.890000 , -0.001000 , -0.004000 , 0.002000 )"
)
"""Sent by the vendor's server, compiled and connected to the emulated sensor's serial line."""


def text(force: float = 1.0) -> bytes:
    return encode_text((force, 2.0, 3.0, 0.1, 0.2, 0.3))


def events(client: UrcapClient) -> list[Any]:
    items = []
    while (event := client.next_event()) is not None:
        items.append(event)
    return items


def streaming(period: float = 0.0104, **settings: Any) -> tuple[UrcapClient, float]:
    """Return a client that has measured the period, and the time of the newest text."""
    client, now = UrcapClient(Ft300ClientProfile(urcap_measured=20, **settings), T0), T0
    for k in range(20):
        assert events(client) == []
        now = T0 + 0.1 + period * k
        client.receive(text(k), now)
    ready, frame = events(client)
    assert isinstance(ready, SensorReady)
    assert ready.facts.period == pytest.approx(period)
    assert (ready.facts.full_scales, ready.facts.range) == ((300.0,) * 3 + (30.0,) * 3, None)
    assert (ready.facts.scales, ready.facts.tares) == ((1.0,) * 6, "host")
    assert frame == WrenchFrame((19.0, 2.0, 3.0, 0.1, 0.2, 0.3), 20, 20, now)
    return client, now


# --- texts


def test_text_is_the_golden_bytes_both_ways() -> None:
    assert encode_text(VALUES) == TEXT
    assert TextReader().feed(TEXT) == [VALUES]


def test_reader_accepts_texts_without_a_line_end() -> None:
    items = TextReader().feed(CAPTURED)
    assert [values[2] for values in items] == [4.88, 4.95, 4.89]
    assert b"".join(split_texts(CAPTURED)) == CAPTURED
    assert len(split_texts(CAPTURED + b"( 1")) == 4


def test_reader_accepts_other_blanks_and_line_ends() -> None:
    reader = TextReader()
    assert reader.feed(b"(1,2,3,4,5,6)\r\n( 1.0, 2.0 ,3.0,4 , 5,6)\n") == [(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)] * 2
    assert reader.noises == 0


@pytest.mark.parametrize(
    "noise",
    [
        b"( 1.0 , 2.0 , 3.0 , 4.0 , 5.0 )",
        b"( 1.0 , 2.0 , 3.0 , 4.0 , 5.0 , 6.0 , 7.0 )",
        b"( nan , 2.0 , 3.0 , 4.0 , 5.0 , 6.0 )",
        b"( 1.0 , -inf , 3.0 , 4.0 , 5.0 , 6.0 )",
        b"( 1e300 , 2.0 , 3.0 , 4.0 , 5.0 , 6.0 )",
        b"( 656.0 , 2.0 , 3.0 , 4.0 , 5.0 , 6.0 )",
        b"( 1.0 , 2.0 , 3.0 , 4.0 , 5.0 , -66.0 )",
        b"( 1.0 , 2.0 , 3.0 , 4.0 , 5.0 , " + b"0" * TEXT_LIMIT + b"6.0 )",
        "( ١.0 , 2.0 , 3.0 , 4.0 , 5.0 , 6.0 )".encode(),
        b"1.0 , 2.0 , 3.0 , 4.0 , 5.0 , 6.0 )",
        b"\x00\xff" * 40,
    ],
)
def test_reader_skips_invalid_text(noise: bytes) -> None:
    reader = TextReader()
    assert reader.feed(TEXT + noise + TEXT) == [VALUES, VALUES]
    assert reader.noises == 1
    assert describe_texts(noise)[0]["problems"]


def test_reader_counts_a_cut_text_as_missed() -> None:
    reader = TextReader()
    reader.feed(TEXT + TEXT[: len(TEXT) // 2] + TEXT)
    assert (reader.noises, reader.missed) == (1, 1)
    reader.feed(TEXT[20:] + TEXT[3:] + TEXT)
    assert (reader.noises, reader.missed) == (2, 3)
    reader.feed(b"(" + TEXT)
    assert (reader.noises, reader.missed) == (3, 3)


def test_reader_keeps_no_more_than_a_text() -> None:
    reader = TextReader()
    for _ in range(1000):
        reader.feed(b"( 1.0 , 2.0 " + b"1" * 100)
        assert len(reader._waiting) <= TEXT_LIMIT


@given(
    st.lists(st.one_of(st.just(TEXT), st.binary(max_size=40), st.just(TEXT[:30]), st.just(b"(" * 5))),
    st.lists(st.integers(0, 400), max_size=20),
)
def test_any_split_of_the_bytes_gives_the_same_texts(pieces: list[bytes], cuts: list[int]) -> None:
    raw, reader = b"".join(pieces), TextReader()
    places = [0, *sorted(cuts), len(raw)]
    items = [values for a, b in pairwise(places) for values in reader.feed(raw[a:b])]
    assert items == TextReader().feed(raw)


def test_texts_are_described_field_by_field() -> None:
    noise, item, rest = describe_texts(b"abc" + TEXT + b" \r\n( 1.0 ,")
    assert (noise["kind"], item["kind"], rest["kind"]) == ("noise", "text", "noise")
    assert item["offset"] == 3
    fields: Any = item["fields"]
    assert [(field["name"], field["value"], field["unit"]) for field in fields][2] == ("fz", -98.099998, "N")


# --- client


def test_client_sends_nothing_and_measures_the_period_first() -> None:
    client, now = streaming()
    client.receive(TEXT[:30], now + 0.0104)
    assert events(client) == []
    client.receive(TEXT[30:], now + 0.0110)
    assert events(client) == [WrenchFrame(VALUES, 21, 21, now + 0.0110)]
    assert client.data_to_send(now) == b""
    assert client.statistics.malformed == 0


def test_client_measures_again_after_buffered_texts() -> None:
    client = UrcapClient(Ft300ClientProfile(urcap_measured=20), T0)
    client.receive(b"".join(text(k) for k in range(30)), T0 + 0.1)
    assert events(client) == []
    for k in range(30):
        client.receive(text(k), T0 + 0.2 + 0.01 * k)
    assert events(client)[0].facts.period == pytest.approx(0.01, rel=0.3)


def test_client_repeated_text_is_reported_once() -> None:
    client, now = streaming()
    client.receive(TEXT * 2, now + 0.01)
    client.receive(TEXT, now + 0.02)  # the URCap repeats a value where no new one has come
    assert [event.at - now for event in events(client)] == pytest.approx([0.01, 0.02])
    assert client.statistics.repeated == 1


def test_client_counts_damaged_and_cut_texts() -> None:
    client, now = streaming()
    client.receive(TEXT[:-5] + b"#" + TEXT, now + 0.02)
    assert (client.statistics.malformed, client.statistics.lost) == (1, 1)
    assert [event.values for event in events(client)] == [VALUES]


def test_client_joining_inside_a_text_counts_none_lost() -> None:
    client = UrcapClient(Ft300ClientProfile(), T0)
    client.receive(TEXT[20:] + TEXT, T0)
    assert client.statistics.lost == 0


def test_axis_from_its_rating_on_is_saturated() -> None:
    client, now = streaming()
    client.receive(encode_text((300.0, 299.99, -310.0, 29.99, -30.0, 0.0)), now + 0.01)
    (frame,) = events(client)
    assert frame.saturated == 0b010101


def test_zero_is_the_hosts() -> None:
    client, now = streaming(zero_s=0.02)
    client.zero()
    for k, force in enumerate((10.0, 12.0, 20.0)):
        client.receive(text(force), now + 0.01 * (k + 1))
    reports = events(client)
    assert [type(event) for event in reports] == [WrenchFrame, WrenchFrame, Zeroed, WrenchFrame]
    assert reports[-1].values[0] == 9.0


def test_silent_urcap_fails_with_a_remedy() -> None:
    client = UrcapClient(Ft300ClientProfile(), T0)
    client.handle_deadline(T0 + 1.9)
    assert events(client) == []
    client.handle_deadline(T0 + 2.0)
    (failed,) = events(client)
    assert isinstance(failed, SensorFailed)
    assert "sent nothing for 2 s" in failed.text
    assert "it serves one at a time" in failed.remedy
    client.receive(TEXT, T0 + 2.1)
    assert events(client) == []
    assert client.next_deadline() is None


def test_stream_that_falls_silent_fails() -> None:
    client, now = streaming()
    assert client.next_deadline() == pytest.approx(now + 1.0)
    client.handle_deadline(now + 1.0)
    (failed,) = events(client)
    assert "no text received for 1 s" in failed.text


def test_stop_ends_the_session_at_once() -> None:
    client, _ = streaming()
    client.stop()
    client.stop()
    assert events(client) == [SensorStopped()]


@given(st.lists(st.one_of(st.binary(max_size=60), st.just(TEXT), st.just(TEXT[:9])), max_size=30))
def test_no_bytes_raise(data: list[bytes]) -> None:
    client = UrcapClient(Ft300ClientProfile(urcap_measured=10, silence_s=50.0), T0)
    for k, piece in enumerate(data):
        client.receive(piece, T0 + 3.0 * k)
        describe_texts(piece)
        client.handle_deadline(T0 + 3.0 * k)
        events(client)
