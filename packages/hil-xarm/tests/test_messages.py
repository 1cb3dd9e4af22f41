"""Frames and reports. Bytes: sessions of xarm-python-sdk 1.18.4, and its table of report sizes."""

import math
from contextlib import suppress
from typing import Any

import pytest
from hil_xarm.frames import (
    Frame,
    FrameReader,
    Function,
    Reply,
    Request,
    next_transaction,
    pack_floats,
    unpack_floats,
)
from hil_xarm.reports import LAYOUTS, NORMAL, NORMAL_OLD, PLAIN, REAL, RICH, RT, Layout, ReportReader
from hypothesis import given
from hypothesis import strategies as st

from protocol.endpoint import RemoteProtocolError

SERVO = bytes.fromhex(
    "000d000300251e0000c8430000c8c200004843db0f494000000000000000000000c8420000fa4400000000"
)
"""set_servo_cartesian([400, -100, 200, 180, 0, 0])"""


@pytest.mark.parametrize(
    ("request_", "data"),
    [
        (Request(1, 2, Function.VERSION), "0001 0002 0001 01"),
        (Request(5, 3, Function.ENABLE, b"\x08\x01"), "0005 0003 0003 0b 0801"),
        (Request(7, 3, Function.FORCE_ENABLE, b"\x01"), "0007 0003 0002 c9 01"),
        (Request(9, 3, Function.FORCE), "0009 0003 0001 c8"),
        (Request(10, 3, Function.SET_MODE, b"\x01\x00"), "000a 0003 0003 13 0100"),
    ],
)
def test_requests_in_golden_bytes(request_: Request, data: str) -> None:
    raw = bytes.fromhex(data)
    assert request_.encode() == raw
    assert [frame.as_request() for frame in FrameReader().feed(raw)] == [request_]


def test_servo_pose_in_golden_bytes() -> None:
    (frame,) = FrameReader().feed(SERVO)
    request = frame.as_request()
    assert request.function == Function.SERVO_POSE
    assert unpack_floats(request.data, 9) == pytest.approx((400, -100, 200, math.pi, 0, 0, 100, 2000, 0))
    assert pack_floats(*unpack_floats(request.data, 9)) == request.data


def test_transactions_start_again_at_1() -> None:
    assert [next_transaction(number) for number in (0, 1, 65534, 65535)] == [1, 2, 65535, 1]


@given(
    st.integers(0, 65535),
    st.sampled_from([2, 3]),
    st.integers(0, 255),
    st.integers(0, 255),
    st.binary(max_size=300),
)
def test_reply_round_trip(transaction: int, protocol: int, function: int, state: int, data: bytes) -> None:
    reply = Reply(transaction, protocol, function, state, data)
    (frame,) = FrameReader().feed(reply.encode())
    assert frame.as_reply() == reply


@given(st.lists(st.integers(1, 60), max_size=8))
def test_frames_are_read_however_they_are_split(cuts: list[int]) -> None:
    stream = SERVO + Request(1, 1, 0, b"\0").encode() + Reply(13, 3, 30, 0, b"\0\0").encode()
    reader, frames, rest = FrameReader(), [], stream
    for cut in cuts:
        frames += reader.feed(rest[:cut])
        rest = rest[cut:]
    frames += reader.feed(rest)
    assert [frame.protocol for frame in frames] == [3, 1, 3]
    assert b"".join(frame.body for frame in frames) == SERVO[6:] + b"\0\0" + b"\x1e\0\0\0"


@given(st.binary(max_size=80))
def test_arbitrary_bytes_are_read_or_refused(data: bytes) -> None:
    reader = FrameReader()
    with suppress(RemoteProtocolError):
        assert all(isinstance(frame, Frame) for frame in reader.feed(data))
    reports = ReportReader()
    with suppress(RemoteProtocolError):
        list(reports.feed(data))


def test_frames_are_read_after_garbage() -> None:
    reader = FrameReader()
    with pytest.raises(RemoteProtocolError, match="protocol 65535"):
        list(reader.feed(b"\xff" * 8))
    assert len(list(reader.feed(SERVO))) == 1


@pytest.mark.parametrize(
    ("layout", "size"), [(PLAIN, 87), (REAL, 135), (NORMAL_OLD, 133), (NORMAL, 145), (RICH, 587), (RT, 804)]
)
def test_reports_have_the_sizes_of_the_maker(layout: Layout, size: int) -> None:
    assert layout.size == size
    assert LAYOUTS[size] is layout
    assert layout.encode({})[:4] == size.to_bytes(4, "big")


@pytest.mark.parametrize(
    ("layout", "field", "offset"),
    [
        (REAL, "joints", 7),
        (REAL, "external", 87),
        (REAL, "raw", 111),
        (NORMAL, "error", 89),
        (RICH, "type", 145),
        (RICH, "world_offset", 288),
        (RICH, "external", 433),
        (RICH, "switches", 578),
        (RT, "joints", 116),
        (RT, "raw", 688),
    ],
)
def test_fields_are_where_the_client_of_the_maker_reads_them(layout: Layout, field: str, offset: int) -> None:
    (item,) = [item for item in layout.fields if item.name == field]
    data = layout.encode({field: (1,) * item.length})
    assert data[4:offset] == bytes(offset - 4)
    assert data[offset : offset + 4] != bytes(4)


@given(st.data())
def test_report_round_trip(data: st.DataObject) -> None:
    layout = data.draw(st.sampled_from(list(LAYOUTS.values())))
    values: dict[str, Any] = {}
    for field in layout.fields[1:]:
        number: st.SearchStrategy[Any] = (
            st.floats(-1e6, 1e6, width=32) if field.code == "f" else st.integers(0, 100)
        )
        values[field.name] = tuple(data.draw(st.lists(number, min_size=field.length, max_size=field.length)))
    assert layout.decode(layout.encode(values)) == {"size": (layout.size,), **values}


def test_reports_of_another_size_are_refused() -> None:
    reader = ReportReader()
    assert len(list(reader.feed(REAL.encode({}) * 2))) == 2
    with pytest.raises(RemoteProtocolError, match="size 145"):
        list(reader.feed(NORMAL.encode({})))


def test_report_that_was_cut_off_is_dropped() -> None:
    reader, complete = ReportReader(), REAL.encode({"raw": (1.0,) * 6})
    list(reader.feed(complete))
    assert list(reader.feed(complete[:60])) == []
    assert list(reader.feed(complete)) == [complete]
    assert reader.cut == 1
