"""Packets of Stream Motion. Sizes and bytes: fanuc_libs/stream_motion of FANUC-CORPORATION/fanuc_driver (versions 3 and
4), golden packets of airo-ugent/airo-fanuc (version 3), a dissector and valstad-shipworks/fanuc_ucl (versions
1 and 2).
"""

import contextlib
import struct

import pytest
from hil_fanuc.packets import (
    CARTESIAN,
    JOINTS,
    NO_SENSOR,
    Capability,
    Command,
    CommandPosition,
    ForceSensor,
    GpioLine,
    GpioRequest,
    GpioResult,
    Kind,
    Report,
    Signal,
    Threshold,
    ThresholdRequest,
    decode_to_client,
    decode_to_robot,
    encode_to_client,
    encode_to_robot,
)
from hypothesis import given
from hypothesis import strategies as st

from protocol.endpoint import RemoteProtocolError

NINE = (10.0, -20.0, 30.0, -40.0, 50.0, -60.0, 0.0, 0.0, 0.0)
POSE = (40.0, 41.0, 42.0, 43.0, 44.0, 45.0, 46.0, 47.0, 48.0)
REPORT = Report(3, 7777, 5, 424.242, POSE, NINE, NINE, 7, 2, 1.0)

TO_ROBOT = [
    (Signal(Kind.START, 3), "000000c800000003"),
    (Signal(Kind.STOP, 3), "0000000200000003"),
    (Signal(Kind.START_V1, 1), "0000000000000001"),
    (Capability(Kind.GET_CAPABILITY, 3), "0000000700000003000000010000000000000000" + 8 * "00"),
    (ForceSensor(3, 1, 1), "000000cd000000030000000100000001"),
    (ThresholdRequest(3, 9, 2), "00000003000000030000000900000002"),
    (Command(3, 42, NINE), "000000c9000000030000002a0001ffff4024000000000000c034"),
    (Command(3, 42, NINE, is_last=True), "000000c9000000030000002a0101ffff4024000000000000c034"),
    (Command(3, 42, NINE, moves=False), "000000c9000000030000002a0000ffff4024000000000000c034"),
    (
        Command(1, 42, NINE, 1),
        "00000001000000010000002a" + 6 * "00" + "01" + 7 * "00" + "ffff" + "41200000c1a00000",
    ),
    (
        Command(2, 42, NINE, 1),
        "00000005000000020000002a" + 6 * "00" + "01" + 7 * "00" + "ffff" + 4 * "00" + "4024000000000000",
    ),
]


@pytest.mark.parametrize(("packet", "begin"), TO_ROBOT)
def test_packet_to_robot_has_these_bytes(packet, begin) -> None:
    data = encode_to_robot(packet)
    assert data.hex().startswith(begin)
    assert decode_to_robot(data) == packet


SIZES = [
    (Signal(Kind.START, 3), 8),
    (Command(1, 1, NINE), 64),
    (Command(2, 1, NINE), 104),
    (Command(3, 1, NINE), 344),
    (Command(4, 1, NINE), 344),
    (GpioRequest(3, ()), 520),
    (Capability(Kind.SET_CAPABILITY, 3), 28),
]


@pytest.mark.parametrize(("packet", "size"), SIZES)
def test_packet_to_robot_has_this_size(packet, size: int) -> None:
    assert len(encode_to_robot(packet)) == size


@pytest.mark.parametrize(
    ("packet", "size"),
    [
        (REPORT, 388),
        (REPORT._replace(version=4, wrench=(1.0, 2.0, 3.0, 0.5, 0.25, 0.125), sensor=1), 416),
        (Threshold(3, 1, 0, 2000, 8, (120.0,) * 20, (60.0,) * 20), 184),
        (Capability(Kind.GET_CAPABILITY, 3, 1, 8, 0, 3, 0), 28),
        (GpioResult(2, 1), 12),
        (Signal(Kind.VERSION, 3), 8),
        (CommandPosition(2, 1.5, POSE, NINE), 84),
    ],
)
def test_packet_to_client_round_trip(packet, size: int) -> None:
    data = encode_to_client(packet)
    assert len(data) == size
    assert decode_to_client(data) == packet


def test_report_of_version_3_has_these_bytes() -> None:
    data = encode_to_client(REPORT)
    assert data[:24].hex() == "000000ca0000000300001e61050702000006793242200000"
    assert data[128:132].hex() == "3f800000"


def test_report_of_version_1_has_no_robot_status() -> None:
    data = encode_to_client(REPORT._replace(version=1, time_s=424.243))
    assert len(data) == 132
    assert decode_to_client(data) == Report(1, 7777, 5, 424.242, POSE, NINE, NINE, sensor=NO_SENSOR)


def test_data_style_is_at_bytes_14_and_15() -> None:
    assert encode_to_robot(Command(3, 1, NINE, CARTESIAN))[14:16] == b"\0\0"
    assert encode_to_robot(Command(3, 1, NINE, JOINTS))[14:16] == b"\xff\xff"
    assert encode_to_robot(Command(1, 1, NINE, JOINTS))[18:19] == b"\x01"


def test_gpio_lines_follow_the_header() -> None:
    line = GpioLine(1, 0, 5, 32)
    data = encode_to_robot(GpioRequest(3, (line,)))
    assert struct.unpack(">6I", data[:24]) == (203, 3, 1, 0, 5, 32)
    decoded = decode_to_robot(data)
    assert isinstance(decoded, GpioRequest)
    assert decoded.lines == (line, *(GpioLine(),) * 31)


@given(st.binary(max_size=600))
def test_any_bytes_are_a_packet_or_refused(data: bytes) -> None:
    for decode in (decode_to_robot, decode_to_client):
        with contextlib.suppress(RemoteProtocolError):
            decode(data)


@pytest.mark.parametrize("data", [b"", b"\0" * 7, bytes(9), bytes.fromhex("000000c9") + bytes(339)])
def test_packet_of_a_wrong_size_is_refused(data: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        decode_to_robot(data)
