"""Packets of RTDE: golden bytes in both directions, recipes, rotation vectors, and invalid bytes."""

import contextlib
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.rtde import packets
from protocol.devices.rtde.dashboard import LINE_MAX, Lines, find_refusal
from protocol.devices.rtde.data_packet import EXPECTED
from protocol.devices.rtde.describe import describe
from protocol.devices.rtde.fields import CODES, INPUTS, NOT_FOUND, OUTPUTS, Recipe, type_of
from protocol.devices.rtde.packets import Kind, Level, Packet, Reader, Text, Types, Version
from protocol.devices.rtde.program import INPUT_NAMES, force_program_text, program_text
from protocol.devices.rtde.rotation import pose_of, six_of
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.geometry import Pose, rotation_vector, turn_by

SIX = (0.4, -0.1, 0.3, 0.0, 3.0, 0.5)
NAMES = ("timestamp", "actual_TCP_pose", "runtime_state", "safety_status_bits")
TYPES = ("DOUBLE", "VECTOR6D", "UINT32", "UINT32")
POSE_HEX = (
    "3f d9 99 99 99 99 99 9a bf b9 99 99 99 99 99 9a 3f d3 33 33 33 33 33 33 00 00 00 00 00 00 00 00 "
    "40 08 00 00 00 00 00 00 3f e0 00 00 00 00 00 00 "
)
TUNING_HEX = "3f 60 62 4d d2 f1 a9 fc 3f b9 99 99 99 99 99 9a 40 72 c0 00 00 00 00 00 "
FORCE = (0.0, 0.0, -12.5, 0.0, 0.25, 0.0)
UR_SERVO = ("input_int_register_0", *(f"input_double_register_{n}" for n in range(11)))


def listed(text: str) -> str:
    return text.encode().hex(" ")


# Each was produced or decoded by a client that others wrote: Universal Robots' Python client, or ur_rtde 1.6.5.
GOLDEN = [
    ("00 05 56 00 02", packets.version_request()),
    ("00 04 56 01", packets.accepted(Kind.VERSION, True)),
    ("00 03 76", packets.encode(Kind.CONTROLLER_VERSION)),
    (
        "00 13 76 00 00 00 05 00 00 00 0c 00 00 00 00 00 00 00 00",
        packets.controller_version(Version(5, 12, 0, 0)),
    ),
    ("00 45 4f 40 7f 40 00 00 00 00 00 " + listed(",".join(NAMES)), packets.outputs_request(NAMES, 500.0)),
    ("00 21 4f 01 " + listed(",".join(TYPES)), packets.types_answer(Kind.OUTPUTS, Types(1, TYPES))),
    (
        "00 14 4f 00 44 4f 55 42 4c 45 2c 4e 4f 54 5f 46 4f 55 4e 44",
        packets.types_answer(Kind.OUTPUTS, Types(0, ("DOUBLE", "NOT_FOUND"))),
    ),
    (
        "00 18 49 69 6e 70 75 74 5f 69 6e 74 5f 72 65 67 69 73 74 65 72 5f 32 34",
        packets.inputs_request(("input_int_register_24",)),
    ),
    ("00 09 49 01 49 4e 54 33 32", packets.types_answer(Kind.INPUTS, Types(1, ("INT32",)))),
    ("00 0a 49 00 49 4e 5f 55 53 45", packets.types_answer(Kind.INPUTS, Types(0, ("IN_USE",)))),
    ("00 18 49 " + listed("external_force_torque"), packets.inputs_request(("external_force_torque",))),
    ("00 0c 49 02 " + listed("VECTOR6D"), packets.types_answer(Kind.INPUTS, Types(2, ("VECTOR6D",)))),
    ("00 03 53", packets.encode(Kind.START)),
    ("00 04 53 01", packets.accepted(Kind.START, True)),
    ("00 04 53 00", packets.accepted(Kind.START, False)),
    ("00 03 50", packets.encode(Kind.PAUSE)),
    ("00 04 50 01", packets.accepted(Kind.PAUSE, True)),
    (
        "00 44 55 01 40 59 01 a9 fb e7 6c 8b " + POSE_HEX + "00 00 00 01 00 00 00 01",
        Recipe(1, NAMES, TYPES).pack(100.026, *SIX, 1, 1),
    ),
    (
        "00 54 55 01 " + POSE_HEX + TUNING_HEX + "00 00 00 01 00 00 00 07",
        Recipe(1, INPUT_NAMES, EXPECTED[INPUT_NAMES]).pack(*SIX, 0.002, 0.1, 300.0, 1, 7),
    ),
    (
        "00 34 55 02 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 c0 29 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
        "3f d0 00 00 00 00 00 00 00 00 00 00 00 00 00 00",
        Recipe(2, ("external_force_torque",), ("VECTOR6D",)).pack(*FORCE),
    ),
    (
        "00 60 55 02 00 00 00 18 " + POSE_HEX + "00 " * 16 + TUNING_HEX,
        Recipe(2, UR_SERVO, ("INT32", *("DOUBLE",) * 11)).pack(24, *SIX, 0.0, 0.0, 0.002, 0.1, 300.0),
    ),
    ("00 08 55 04 00 00 00 ff", Recipe(4, ("input_int_register_0",), ("INT32",)).pack(255)),
    ("00 0e 4d 05 68 65 6c 6c 6f 03 43 4f 4e 02", packets.text(Text("hello", "CON", Level.WARNING))),
]


@pytest.mark.parametrize(("golden", "made"), GOLDEN)
def test_golden_packets_are_made_byte_for_byte(golden: str, made: bytes) -> None:
    assert made.hex(" ") == golden.strip()


def read_one(text: str) -> Packet:
    reader = Reader()
    reader.feed(bytes.fromhex(text))
    packet = reader.next_packet()
    assert packet is not None
    assert reader.waiting == 0
    return packet


def test_golden_packets_are_read() -> None:
    payloads = [read_one(golden).payload for golden, _ in GOLDEN]
    assert packets.read_version_request(payloads[0]) == 2
    assert packets.read_accepted(payloads[1])
    assert packets.read_controller_version(payloads[3]) == Version(5, 12, 0, 0)
    assert packets.read_outputs_request(payloads[4]) == (500.0, NAMES)
    assert packets.read_types(payloads[5]) == Types(1, TYPES)
    assert packets.read_types(payloads[6]) == Types(0, ("DOUBLE", "NOT_FOUND"))
    assert packets.split_names(payloads[7]) == ("input_int_register_24",)
    assert not packets.read_accepted(payloads[14])
    values = Recipe(1, NAMES, TYPES).values(Recipe(1, NAMES, TYPES).unpack(payloads[17]))
    assert values == dict(zip(NAMES, (100.026, SIX, 1, 1), strict=True))
    assert Recipe(2, ("external_force_torque",), ("VECTOR6D",)).unpack(payloads[19]) == FORCE
    assert packets.read_text(payloads[22]) == Text("hello", "CON", Level.WARNING)


def test_trailing_comma_of_a_list_adds_no_name() -> None:
    packet = read_one("00 19 49 69 6e 70 75 74 5f 69 6e 74 5f 72 65 67 69 73 74 65 72 5f 32 33 2c")
    assert packets.split_names(packet.payload) == ("input_int_register_23",)
    assert packets.split_names(b"") == ()


@given(st.lists(st.tuples(st.sampled_from(list(Kind)), st.binary(max_size=40)), max_size=8), st.data())
def test_any_split_of_the_bytes_gives_the_same_packets(
    sent: list[tuple[Kind, bytes]], data: st.DataObject
) -> None:
    raw = b"".join(packets.encode(kind, payload) for kind, payload in sent)
    reader, got = Reader(), []
    while raw:
        count = data.draw(st.integers(1, len(raw)))
        reader.feed(raw[:count])
        raw = raw[count:]
        while (packet := reader.next_packet()) is not None:
            got.append((packet.kind, packet.payload))
    assert got == sent


@pytest.mark.parametrize("size", [0, 1, 2])
def test_size_below_the_headers_is_refused(size: int) -> None:
    reader = Reader()
    reader.feed(struct.pack(">HB", size, Kind.DATA))
    with pytest.raises(RemoteProtocolError, match="less than its header"):
        reader.next_packet()


def test_oversized_values_are_local_errors() -> None:
    with pytest.raises(LocalProtocolError, match="too long for its size field"):
        packets.encode(Kind.DATA, bytes(65533))
    with pytest.raises(LocalProtocolError, match="recipe 4"):
        Recipe(4, ("input_int_register_0",), ("INT32",)).pack(2**31)


READS = [
    packets.read_version_request,
    packets.read_accepted,
    packets.read_controller_version,
    packets.read_outputs_request,
    packets.read_types,
    packets.read_text,
    Recipe(1, NAMES, TYPES).unpack,
]


@given(st.sampled_from(READS), st.binary(max_size=80))
def test_arbitrary_payloads_raise_only_remote_errors(read, payload: bytes) -> None:
    with contextlib.suppress(RemoteProtocolError):
        read(payload)


@given(st.binary(max_size=300))
def test_arbitrary_bytes_are_described_completely(raw: bytes) -> None:
    items = describe(raw)
    assert sum(item["size"] for item in items) == len(raw)
    assert [item["offset"] for item in items] == [
        sum(item["size"] for item in items[:number]) for number in range(len(items))
    ]


def test_capture_is_described() -> None:
    raw = b"".join(made for _, made in GOLDEN[:18]) + b"is in remote control\ntrue\n\x01\x02"
    items = describe(raw)
    assert [item["kind"] for item in items] == ["packet"] * 18 + ["noise"]
    data = {field["name"]: (field["value"], field["unit"]) for field in items[17]["fields"]}
    assert data["runtime_state"] == ("stopped", "")
    assert data["safety_status_bits"] == ("normal", "")
    assert data["actual_TCP_pose"] == (SIX, "m, rad")
    problems = {number: item["problems"] for number, item in enumerate(items[:18]) if item["problems"]}
    assert problems == {
        6: ["actual_TCP_pose: not found"],
        9: ["input_int_register_24: in use"],
        14: ["the controller refuses"],
    }
    (text,) = describe(b"PolyscopeVersion\n")
    assert (text["kind"], text["text"]) == ("text", "PolyscopeVersion\n")
    (unknown,) = describe(Recipe(9, NAMES, TYPES).pack(1.0, *SIX, 1, 1))
    assert "not in the capture" in unknown["problems"][0]
    requests, typed = describe(
        packets.inputs_request(("no_such",)) + packets.types_answer(Kind.INPUTS, Types(3, ("WORD",)))
    )
    assert requests["problems"] == ["unknown variable 'no_such'"]
    assert typed["problems"] == ["unknown type WORD"]
    (empty,) = describe(packets.encode(Kind.DATA))
    assert "without the number" in empty["problems"][0]
    (text_packet,) = describe(packets.text(Text("hello", "CON", 2)))
    assert [field["value"] for field in text_packet["fields"]] == ["hello", "CON", "warning"]
    (old,) = describe(packets.version_request(1))
    assert old["problems"] == ["only version 2 is supported"]


# --- variables


def test_every_variable_has_a_type_that_can_be_packed() -> None:
    for table in (INPUTS, OUTPUTS):
        assert {variable.type for variable in table.values()} <= set(CODES)


def test_variable_is_known_from_its_version_on() -> None:
    assert type_of(OUTPUTS, "payload_inertia", (5, 10, 0, 0)) == NOT_FOUND
    assert type_of(OUTPUTS, "payload_inertia", (5, 11, 0, 0)) == "VECTOR6D"
    assert type_of(OUTPUTS, "nonsense", (5, 12, 0, 0)) == NOT_FOUND
    assert type_of(OUTPUTS, "input_int_register_47", (5, 12, 0, 0)) == "INT32"


@given(st.data())
def test_recipe_round_trip_keeps_its_values(data: st.DataObject) -> None:
    names = data.draw(st.lists(st.sampled_from(sorted(OUTPUTS)), min_size=1, max_size=12, unique=True))
    types = tuple(OUTPUTS[name].type for name in names)
    recipe = Recipe(data.draw(st.integers(1, 255)), tuple(names), types)
    draws = {
        "?": st.booleans(),
        "B": st.integers(0, 255),
        "I": st.integers(0, 2**32 - 1),
        "Q": st.integers(0, 2**64 - 1),
        "i": st.integers(-(2**31), 2**31 - 1),
        "d": st.floats(allow_nan=False),
    }
    numbers = tuple(
        data.draw(draws[code]) for count, code in map(CODES.__getitem__, types) for _ in range(count)
    )
    payload = recipe.pack(*numbers)[3:]
    assert recipe.size == len(payload)
    assert recipe.unpack(payload) == numbers
    assert list(recipe.values(numbers)) == names
    with pytest.raises(RemoteProtocolError, match="does not match recipe"):
        recipe.unpack(payload[:-1])


# --- rotation vectors


def test_rotation_vector_worked_out_by_hand() -> None:
    assert turn_by((0.0, 3.0, 0.5)) == pytest.approx((0.0500847, 0.0, 0.9851560, 0.1641927), abs=1e-7)
    assert rotation_vector(turn_by((0.0, 3.0, 0.5))) == pytest.approx((0.0, 3.0, 0.5))
    other = (0.0, -3.1976958, -0.5329493)
    assert rotation_vector(turn_by(other)) == pytest.approx((0.0, 3.0, 0.5), abs=1e-6)
    assert rotation_vector((1.0, 0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    assert turn_by((0.0, 0.0, 1e-12)) == (1.0, 0.0, 0.0, 5e-13)


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: math.hypot(*q) > 0.1))
def test_rotation_vector_round_trip_keeps_the_orientation(four: tuple[float, float, float, float]) -> None:
    w, x, y, z = (part / math.hypot(*four) for part in four)
    pose = Pose((0.1, -0.2, 0.3), (w, x, y, z))
    six = six_of(pose)
    assert math.hypot(*six[3:]) <= math.pi + 1e-9
    back = pose_of(six)
    assert back.position == pose.position
    assert abs(sum(a * b for a, b in zip(back.quaternion, pose.quaternion, strict=True))) == pytest.approx(
        1.0
    )


# --- text


def test_program_text_has_the_settings_and_valid_urscript_form() -> None:
    text = program_text(50, 10.0, 2.0, 0.1)
    lines = text.splitlines()
    assert lines[0] == "def hil_bridge():"
    assert lines[-1] == "end"
    assert all(line.startswith("  ") for line in lines[1:-1])
    assert '  rtde_set_watchdog("input_int_register_24", 10, "stop")' in lines
    assert "    if on and (cmd != 1 or age > 50):" in lines
    (leap,) = (line for line in lines if "norm(" in line)
    assert leap.count("> 0.1") == leap.count("n[") == leap.count("q[") == 6
    assert text.count("stopl(2)") == 3
    assert sum(line.split()[0] in ("if", "while", "def") for line in lines) == sum(
        line.strip() == "end" for line in lines
    )
    assert force_program_text(False) == (
        "def hil_ft():\n  ft_rtde_input_enable(True, 0, [0,0,0], [0,0,0])\nend\n"
    )


@pytest.mark.parametrize(
    ("question", "answer", "message"),
    [
        ("is in remote control", "true", ""),
        ("is in remote control", "could not understand: 'is in remote control'", ""),
        ("is in remote control", "false", "switch it to Remote Control"),
        ("robotmode", "Robotmode: RUNNING", ""),
        ("robotmode", "Robotmode: IDLE", "power it on and release its brakes"),
        ("safetystatus", "Safetystatus: NORMAL", ""),
        ("safetystatus", "Safetystatus: PROTECTIVE_STOP", "PROTECTIVE_STOP"),
    ],
)
def test_dashboard_responses_decide_about_a_program_start(question: str, answer: str, message: str) -> None:
    refusal = str(find_refusal(question, answer))
    assert message in refusal
    assert bool(refusal) == bool(message)


def test_any_split_gives_the_same_lines_in_bounded_memory() -> None:
    lines = Lines()
    assert lines.feed(b"robot") == []
    assert lines.feed(b"mode\r\nrunn") == ["robotmode"]
    assert lines.feed(b"ing\n\n") == ["running", ""]
    assert [len(line) for line in lines.feed(b"x" * 5000)] == [LINE_MAX]
