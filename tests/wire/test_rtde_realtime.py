"""Packets of the real-time interface: published lengths and offsets, hostile bytes, and descriptions of both
interfaces.

Source of lengths and offsets: Universal Robots' manual, RealTime 5.9 and 5.10, whose columns count doubles behind the
time as 1, and ROS's ur_modern_driver.
"""

import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.rtde import primary, realtime
from protocol.devices.rtde.describe import describe
from protocol.devices.rtde.primary import BODIES, Message, MessageKind, PacketType
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from tools.client_transcripts import DEVICE, read

LENGTHS = {
    (3, 1, 0): 1044,
    (3, 2, 0): 1060,
    (3, 4, 0): 1060,
    (3, 5, 0): 1108,
    (3, 9, 1): 1108,
    (3, 10, 0): 1116,
    (3, 13, 0): 1116,
    (3, 14, 3): 1140,
    (3, 15, 8): 1140,
    (5, 0, 0): 1108,
    (5, 3, 0): 1108,
    (5, 4, 0): 1116,
    (5, 8, 0): 1116,
    (5, 9, 4): 1140,
    (5, 10, 0): 1220,
    (5, 24, 0): 1220,
}
COLUMNS = {
    "timestamp": 1,
    "target_q_0": 2,
    "target_current_0": 20,
    "actual_q_0": 32,
    "joint_control_output_0": 50,
    "actual_TCP_pose_0": 56,
    "actual_TCP_force_0": 68,
    "target_TCP_speed_5": 85,
    "actual_digital_input_bits": 86,
    "joint_temperatures_0": 87,
    "actual_execution_time": 93,
    "reserved0": 94,
    "robot_mode": 95,
    "joint_mode_0": 96,
    "safety_mode": 102,
    "payload_inertia_5": 152,
}


@pytest.mark.parametrize(("version", "length"), LENGTHS.items())
def test_each_version_has_its_published_length(version: tuple[int, int, int], length: int) -> None:
    layout = realtime.layout_of(version)
    assert layout.size == length
    assert realtime.LAYOUTS[length] == layout


def test_fields_are_at_their_published_columns() -> None:
    at = {field.name: field.offset // 8 + 1 for field in realtime.LAYOUTS[1220].layout.fields}
    assert {name: at[name] for name in COLUMNS} == COLUMNS


def test_bits_are_integers_and_all_others_doubles() -> None:
    layout = realtime.layout_of((5, 12, 0))
    count = len(layout.layout.fields)
    packet = layout.encode([5 if field.format == "Q" else 1.5 for field in layout.layout.fields])
    assert struct.unpack_from(">I", packet) == (len(packet),) == (1220,)
    assert struct.unpack_from(">Q", packet, 4 + 8 * 85) == (5,), "bits 0 and 2"
    values = realtime.decode(packet)
    assert (len(values), values["actual_digital_output_bits"], values["payload"]) == (count, 5, 1.5)
    with pytest.raises(LocalProtocolError):
        layout.encode([0.0] * (count - 1))


@pytest.mark.parametrize("packet", [b"", bytes(1220), struct.pack(">I", 1108) + bytes(1112), bytes(3)])
def test_another_length_is_refused(packet: bytes) -> None:
    with pytest.raises(RemoteProtocolError, match="not a packet of the real-time interface"):
        realtime.decode(packet)


# --- in words


def fields_of(item: dict[str, Any]) -> dict[str, Any]:
    return {field["name"]: field["value"] for field in item["fields"]}


def test_real_time_state_is_described() -> None:
    layout = realtime.layout_of((5, 4, 0))
    row = {field.name: 0.0 for field in layout.layout.fields}
    row |= {"timestamp": 12.5, "robot_mode": 7.0, "safety_status": 3.0, "runtime_state": 2.0}
    row |= {"actual_digital_input_bits": 0, "actual_digital_output_bits": 5}
    packet = layout.encode(list(row.values()))
    first, second = describe(packet * 2)
    assert (first["op"], first["size"], second["offset"]) == ("real-time state", 1116, 1116)
    items = fields_of(first)
    assert (items["timestamp"], items["robot_mode"], items["safety_status"]) == (
        12.5,
        "running",
        "protective stop",
    )
    assert (items["runtime_state"], items["actual_digital_output_bits"]) == ("playing", 5)
    assert {field["unit"] for field in first["fields"] if field["name"].startswith("actual_q_")} == {"rad"}


def test_input_of_the_vendor_library_is_described() -> None:
    folder = Path(__file__).with_name("transcripts") / "drivers"
    transcript = read(folder / "rtde-ur-client-library-primary.txt")
    items = describe(b"".join(transcript.made_by(DEVICE, "primary")))
    assert {item["kind"] for item in items} == {"packet"}
    assert [item for item in items if item["problems"]] == []
    state = fields_of(next(item for item in items if item["op"] == "robot state"))
    assert (state["robot mode: robot_mode"], state["masterboard: safety_mode"]) == ("running", "normal")
    assert state["configuration: robot_type"] == 2
    by_name = {item["op"]: fields_of(item) for item in items}
    assert (by_name["version message"]["project"], by_name["version message"]["minor"]) == ("URControl", 12)
    assert by_name["text message"]["text"] == "hello 7"
    assert by_name["error code message"]["level"] == "warning"
    assert by_name["runtime exception message"]["line"] == 2
    assert by_name["key message"]["title"] == "PROGRAM_XXX_STOPPED"
    assert by_name["safety mode message"]["safety_mode"] == "normal"


def test_packet_between_others_is_recognised() -> None:
    message = primary.encode_message(Message(0, 255, MessageKind.TEXT, b"hi"))
    items = describe(b"play\n" + message + b"\xff\xfe" + message[:7])
    assert [item["kind"] for item in items] == ["text", "packet", "noise"]
    assert fields_of(items[1])["text"] == "hi"


@pytest.mark.parametrize(
    ("packet", "problem"),
    [
        (primary.encode(PacketType.MESSAGE, b"short"), "shorter than its head"),
        (primary.encode_message(Message(0, 255, 99, b"")), "unknown message kind 99"),
        (
            primary.encode_message(Message(0, 255, MessageKind.KEY, bytes(8) + b"\x09cut")),
            "title of a message is truncated",
        ),
        (primary.encode_message(Message(0, 255, MessageKind.ERROR_CODE, b"")), "needs 20 bytes"),
        (primary.encode(PacketType.STATE, primary.encode(42, b"xy")), "part of type 42 and 2 bytes"),
        (primary.encode(PacketType.STATE, primary.encode(0, b"xy")), "robot mode needs 42 bytes"),
        (primary.encode(PacketType.STATE, b"\0\0\0\xffx"), "a packet of 255 bytes"),
    ],
)
def test_bad_packet_is_a_problem_and_no_error(packet: bytes, problem: str) -> None:
    (item,) = describe(packet)
    assert item["kind"] == "packet"
    assert problem in item["problems"][0]


@pytest.mark.parametrize("kind", BODIES)
def test_every_body_is_read_as_it_was_written(kind: MessageKind) -> None:
    form = BODIES[kind]
    count = len(form.before.fields) + len(form.behind.fields)
    body = primary.encode_body(kind, *range(count), title="a title" if form.title else "", text="täxt")
    result = primary.read_body(Message(0, 255, kind, body))
    assert result is not None
    assert [int(value) for _, value in result.fields] in (list(range(count)), [0, *[1] * (count - 1)])
    assert result.texts == (*(((form.title, "a title"),) if form.title else ()), (form.text, "täxt"))


@given(st.binary(max_size=300), st.sampled_from([16, 20, 64]))
def test_arbitrary_bytes_are_described(data: bytes, kind: int) -> None:
    packet = primary.encode(kind, data)
    assert sum(item["size"] for item in describe(packet)) == len(packet)
