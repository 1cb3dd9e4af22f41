"""Packets of the primary interface: sizes and values of frames from the vendor's simulator, and hostile bytes.

Source of the frames: `tests/test_primary_parser.cpp` of Universal Robots' C++ client library, recorded from URSim 5.
"""

import struct
from collections.abc import Callable
from typing import TypeVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.rtde import primary
from protocol.devices.rtde.primary import MessageKind, PacketType, Part, ReportLevel
from protocol.endpoint import RemoteProtocolError

Read = TypeVar("Read")
OBSERVED_SIZES = {
    Part.ROBOT_MODE: 47,
    Part.JOINTS: 251,
    Part.CARTESIAN: 101,
    Part.KINEMATICS: 225,
    Part.MASTERBOARD: 75,
    Part.TOOL: 37,
    Part.CONFIGURATION: 445,
    Part.FORCE_MODE: 61,
    Part.ADDITIONAL: 9,
}
ROBOT_MODE = bytes.fromhex(
    "0000002f0000000005f87d17400101010000000007003fef0a3d70a3d70a00000000000000003ff000000000000000"
)


def test_sub_packages_have_the_observed_sizes_and_order() -> None:
    assert {
        part: layout.size + primary.HEADER.size for part, layout in primary.PARTS.items()
    } == OBSERVED_SIZES
    assert list(primary.PARTS)[:4] == [Part.ROBOT_MODE, Part.JOINTS, Part.CARTESIAN, Part.KINEMATICS]


def test_observed_robot_mode_round_trips_byte_for_byte() -> None:
    ((kind, body),) = primary.split(ROBOT_MODE)
    values = primary.ROBOT_MODE.unpack(body)
    assert kind == Part.ROBOT_MODE
    assert values["timestamp"] == 25643784000
    assert (values["robot_mode"], values["powered"], values["emergency_stopped"], values["running"]) == (
        7,
        1,
        0,
        0,
    )
    assert (values["target_speed_fraction"], values["target_speed_fraction_limit"]) == (0.97, 1.0)
    assert primary.encode(kind, primary.ROBOT_MODE.pack(values)) == ROBOT_MODE


@pytest.mark.parametrize(
    ("kind", "body", "expected"),
    [
        (
            MessageKind.VERSION,
            primary.version_body((5, 24, 0, 0), "04-10-2025, 00:25:33"),
            b"\x09URControl\x05\x18" + bytes(8) + b"04-10-2025, 00:25:33",
        ),
        (
            MessageKind.KEY,
            primary.key_body("PROGRAM_XXX_STARTED", "textmsg"),
            bytes(8) + b"\x13PROGRAM_XXX_STARTEDtextmsg",
        ),
        (
            MessageKind.RUNTIME_EXCEPTION,
            primary.runtime_exception_body(3, 1, "compile_error_name_not_found:txtmsg:"),
            b"\0\0\0\3\0\0\0\1compile_error_name_not_found:txtmsg:",
        ),
        (MessageKind.SAFETY_MODE, primary.safety_mode_body(3), bytes(8) + b"\3" + bytes(8)),
        (
            MessageKind.ERROR_CODE,
            primary.error_body(210, 0, ReportLevel.WARNING),
            b"\0\0\0\xd2" + bytes(4) + b"\0\0\0\2" + bytes(8),
        ),
        (MessageKind.POPUP, primary.popup_body("Popup", "hello"), bytes(8) + b"\5Popuphello"),
    ],
)
def test_messages_are_written_as_they_are_read(kind: MessageKind, body: bytes, expected: bytes) -> None:
    assert body == expected
    packet = primary.encode_message(primary.Message(1_500_000, primary.NO_SOURCE, kind, body))
    ((packet_type, raw),) = primary.split(packet)
    assert packet_type == PacketType.MESSAGE
    assert struct.unpack_from(">IBQBB", packet) == (len(packet), 20, 1_500_000, 255, kind)
    assert primary.read_message(raw) == (1_500_000, 255, kind, body)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    packets = read(lambda: list(primary.split(data)))
    if packets is not None:
        assert sum(len(body) + primary.HEADER.size for _, body in packets) == len(data)
    message = read(lambda: primary.read_message(data))
    assert (message is None) is (len(data) < 10)
    assert message is None or message.body == data[10:]


def read(reading: Callable[[], Read]) -> Read | None:
    """Return the decoded value; None if it is refused."""
    try:
        return reading()
    except RemoteProtocolError:
        return None
