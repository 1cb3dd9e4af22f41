"""Datagrams of Externally Guided Motion: the specification's examples byte for byte, and arbitrary bytes."""

import math
from contextlib import suppress

import pytest
from google.protobuf import descriptor_pool
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.egm import (
    Answer,
    Guidance,
    Motors,
    PathCorrection,
    Place,
    PoseMm,
    Rapid,
    RobotMessage,
    RobotWare,
    SensorMessage,
    decode_answer,
    decode_robot,
    describe,
    encode_answer,
    encode_robot,
)
from protocol.devices.egm.messages import LARGEST_BYTES
from protocol.devices.egm.schema import message_class
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.geometry import angle_between, product, turn_by

# Golden datagrams: specification of EGM, section 10. They were made by hand, and both public clients read them.
R1 = bytes.fromhex(
    "0a07080010e80718021288010a3609000000000000000009000000000000000009000000000000000009000000000000"
    "0000090000000000003e4009000000000000000012430a1b090000000000c08240110000000000000000190000000000"
    "407f40122409000000000000000011000000000000000019000000000000f03f21000000000000000022090880e2cfaa"
    "0610a01f1a88010a36090000000000000000090000000000000000090000000000000000090000000000000000090000"
    "000000003e4009000000000000000012430a1b090000000000c08240110000000000000000190000000000407f401224"
    "09000000000000000011000000000000000019000000000000f03f21000000000000000022090880e2cfaa0610a01f22"
    "0208012a0208023000420208024a360900000000000000000900000000000000000900000000000029c0090000000000"
    "00000009000000000000d03f090000000000000000510000000000000000"
)
R2 = bytes.fromhex(
    "0a0808fa0110d80f18021288010a36090000000000000000090000000000000000090000000000000000090000000000"
    "000000090000000000003e4009000000000000000012430a1b090000000000c082401100000000000000001900000000"
    "00407f40122409000000000000000011000000000000000019000000000000f03f21000000000000000022090880e2cf"
    "aa0610a01f1a88010a360900000000000000000900000000000000000900000000000000000900000000000000000900"
    "00000000003e4009000000000000000012430a1b090000000000c08240110000000000000000190000000000407f4012"
    "2409000000000000000011000000000000000019000000000000f03f21000000000000000022090880e2cfaa0610a01f"
    "220208012a0208033000420208024a3808011100000000000000001100000000000000001100000000000029c0110000"
    "00000000000011000000000000d03f1100000000000000005100000000004045405801620208006a020800"
)
S1 = bytes.fromhex(
    "0a06080010001803124512430a1b090000000000c08240110000000000000000190000000000207f4012240900000000"
    "0000000011000000000000000019000000000000f03f210000000000000000"
)
S2 = bytes.fromhex(
    "0a07080110dc0f1803124512430a1b090000000000c08240110000000000000000190000000000187f40122409000000"
    "000000000011000000000000000019000000000000f03f2100000000000000001a381236090000000000000000090000"
    "0000000000000900000000000004c0090000000000000000090000000000000000090000000000000000"
)
S3 = bytes.fromhex(
    "0a07080210e00f180312380a360900000000000000000900000000000000000900000000000000000900000000000000"
    "00090000000000003e400900000000000000001a380a3609000000000000000009000000000000000009000000000000"
    "0000090000000000000000090000000000000000090000000000000000"
)
S4 = bytes.fromhex("0a06080710001804121f0a1b09000000000000000011000000000000f43f19000000000000e0bf1030")
S5 = bytes.fromhex(
    "0a07080310e40f1803124512430a1b090000000000c08240110000000000000000190000000000187f40122409000000"
    "000000000011000000000000000019000000000000f03f210000000000000000220b080111000000000000f03f"
)
C1 = bytes.fromhex(
    "0a0408001803124512430a1b090000000000c08240110000000000000000190000000000207f40122409000000000000"
    "000011000000000000000019000000000000f03f210000000000000000"
)

BACK = (0.0, 0.0, 1.0, 0.0)
JOINTS = (0.0, 0.0, 0.0, 0.0, 30.0, 0.0)
FORCE = (0.0, 0.0, -12.5, 0.0, 0.25, 0.0)
PLACE = Place(JOINTS, PoseMm((600.0, 0.0, 500.0), BACK), (), 1_700_000_000_004_000)
AT_498, AT_497 = PoseMm((600.0, 0.0, 498.0), BACK), PoseMm((600.0, 0.0, 497.5), BACK)
FIRST = RobotMessage(
    0, 1000, PLACE, PLACE, Motors.ON, Guidance.STOPPED, Rapid.RUNNING, False, FORCE, None, 0.0
)
GUIDING = RobotMessage(
    250,
    2008,
    PLACE,
    PLACE,
    Motors.ON,
    Guidance.RUNNING,
    Rapid.RUNNING,
    False,
    FORCE,
    True,
    42.5,
    1,
    False,
    False,
)
ANSWERS: list[tuple[Answer, bytes]] = [
    (SensorMessage(0, 0, AT_498), S1),
    (SensorMessage(1, 2012, AT_497, speed=(0.0, 0.0, -2.5, 0.0, 0.0, 0.0)), S2),
    (SensorMessage(2, 2016, joints_deg=JOINTS, joint_speed_deg_s=(0.0,) * 6), S3),
    (PathCorrection(7, 0, (0.0, 1.25, -0.5), 48), S4),
    (SensorMessage(3, 2020, AT_497, digital=True, dnum=(1.0,)), S5),
    (SensorMessage(0, None, AT_498), C1),
]


@pytest.mark.parametrize(
    ("message", "data", "version"),
    [(FIRST, R1, RobotWare.RW6_10), (GUIDING, R2, RobotWare.RW7)],
    ids=["RobotWare 6.10", "RobotWare 7"],
)
def test_robots_golden_datagram_reads_and_writes_byte_for_byte(
    message: RobotMessage, data: bytes, version: RobotWare
) -> None:
    assert encode_robot(message, version) == data
    assert decode_robot(data) == message


@pytest.mark.parametrize(("message", "data"), ANSWERS, ids=["S1", "S2", "S3", "S4", "S5", "C1"])
def test_golden_answer_reads_and_writes_byte_for_byte(message: Answer, data: bytes) -> None:
    assert encode_answer(message) == data
    assert decode_answer(data) == message


def test_oldest_robot_reports_neither_time_nor_utilisation() -> None:
    read = decode_robot(encode_robot(FIRST, RobotWare.RW6_06))
    without = PLACE._replace(time_us=None)
    assert read == FIRST._replace(feedback=without, planned=without, utilization_percent=None)


def test_force_is_decoded_in_both_schemas_for_any_version() -> None:
    for version in RobotWare:
        assert decode_robot(encode_robot(FIRST, version)).force == FORCE


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (S1[:-1], "damaged or truncated"),
        (bytes.fromhex("0a06080010001803123c123a0a12090000000000c0824011000000000000000012240900000000000000"
                       "00110000000000000000190000000000" "00f03f210000000000000000"), "missing"),
        (R2, "damaged or truncated"),
        (b"", "message type 0"),
        (S1.replace(bytes.fromhex("1803"), bytes.fromhex("1802")), "message type 2"),
        (b"x" * (LARGEST_BYTES + 1), "more than 1500"),
        (bytes.fromhex("0a0408001804"), "the correction is missing"),
    ],
)  # fmt: skip
def test_unusable_answer_is_refused_with_its_reason(data: bytes, reason: str) -> None:
    with pytest.raises(RemoteProtocolError, match=reason):
        decode_answer(data)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_invalid_number_is_neither_sent_nor_accepted(bad: float) -> None:
    pose = PoseMm((bad, 0.0, 0.0), BACK)
    for message in (
        SensorMessage(0, pose=pose),
        SensorMessage(0, speed=(bad,) * 6),
        PathCorrection(0, 0, (bad, 0.0, 0.0), 0),
    ):
        with pytest.raises(LocalProtocolError, match="finite"):
            encode_answer(message)
    for data in (S1, S4):
        index = data.index(b"\x09") + 1
        damaged = data[:index] + (b"\x00" * 6 + b"\xf8\x7f") + data[index + 8 :]
        with pytest.raises(RemoteProtocolError, match="contains a number that is not finite"):
            decode_answer(damaged)


def test_path_correction_is_distinguished_by_its_type() -> None:
    """Its field numbers are those of an EgmSensor with one joint."""
    misread = message_class("EgmSensor")()
    misread.ParseFromString(S4)
    assert len(misread.planned.joints.joints) == 1
    assert isinstance(decode_answer(S4), PathCorrection)


def test_too_long_arrays_are_refused() -> None:
    for message in (SensorMessage(0, joints_deg=(0.0,) * 7), SensorMessage(0, dnum=(0.0,) * 41)):
        with pytest.raises(RemoteProtocolError, match="allowed: at most"):
            decode_answer(encode_answer(message))
    assert decode_answer(encode_answer(SensorMessage(0, dnum=(1.0,) * 40))) == SensorMessage(
        0, dnum=(1.0,) * 40
    )


def test_packed_numbers_and_unknown_fields_are_decoded() -> None:
    packed = bytes.fromhex("0a04080018031a3412320a30") + b"\0" * 48 + bytes.fromhex("7a0161")
    assert decode_answer(packed) == SensorMessage(0, None, speed=(0.0,) * 6)


def test_unencodable_value_is_refused_before_sending() -> None:
    with pytest.raises(LocalProtocolError, match="EgmRobot"):
        encode_robot(FIRST._replace(move_index=-1), RobotWare.RW7)
    with pytest.raises(LocalProtocolError, match="EgmSensor"):
        encode_answer(PathCorrection(0, 0, (0.0, 0.0, 0.0), -1))


def test_euler_angles_win_over_a_quaternion() -> None:
    parsed = message_class("EgmSensor")()
    parsed.ParseFromString(S1)
    euler = parsed.planned.cartesian.euler
    euler.x, euler.y, euler.z = 180.0, 0.0, 90.0
    read = decode_answer(parsed.SerializeToString())
    assert isinstance(read, SensorMessage)
    assert read.pose is not None
    assert read.pose.quaternion == pytest.approx((0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0))


@given(st.tuples(*[st.floats(-180.0, 180.0)] * 3))
def test_euler_angles_turn_about_x_then_y_then_z(angles: tuple[float, float, float]) -> None:
    x, y, z = (math.radians(angle) for angle in angles)
    quaternion = (1.0, 0.0, 0.0, 0.0)
    for by in ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)):
        quaternion = product(turn_by(by), quaternion)
    parsed = message_class("EgmSensor")()
    parsed.ParseFromString(S1)
    euler = parsed.planned.cartesian.euler
    euler.x, euler.y, euler.z = angles
    read = decode_answer(parsed.SerializeToString())
    assert isinstance(read, SensorMessage)
    assert read.pose is not None
    assert angle_between(quaternion, read.pose.quaternion) < 1e-6


def test_messages_do_not_use_the_shared_descriptor_pool() -> None:
    with pytest.raises(KeyError):
        descriptor_pool.Default().FindMessageTypeByName("abb.egm.EgmRobot")


# --- properties

numbers = st.floats(allow_nan=False, allow_infinity=False)
six = st.tuples(*[numbers] * 6)
poses = st.builds(PoseMm, st.tuples(*[numbers] * 3), st.tuples(*[numbers] * 4))
words = st.integers(0, 2**32 - 1)
places = st.builds(Place, six, poses, st.just(()) | six, st.none() | st.integers(0, 2**52))
messages = st.builds(
    RobotMessage,
    words,
    words,
    st.none() | places,
    st.none() | places,
    st.sampled_from(Motors),
    st.sampled_from(Guidance),
    st.sampled_from(Rapid),
    st.none() | st.booleans(),
    six,
    st.booleans(),
    st.none() | numbers,
    st.none() | words,
    st.none() | st.booleans(),
    st.none() | st.booleans(),
    st.just(()) | six,
)
answers = st.builds(
    SensorMessage,
    words,
    st.none() | words,
    st.none() | poses,
    st.just(()) | six,
    st.just(()) | six,
    st.just(()) | six,
    st.none() | st.booleans(),
    st.just(()) | six,
) | st.builds(PathCorrection, words, st.none() | words, st.tuples(*[numbers] * 3), words)


@given(messages)
def test_robots_message_survives_the_wire(message: RobotMessage) -> None:
    assert decode_robot(encode_robot(message, RobotWare.RW7)) == message


@given(answers)
def test_answer_survives_the_wire(message: Answer) -> None:
    assert decode_answer(encode_answer(message)) == message


@given(st.binary(max_size=200) | st.sampled_from([R1, R2, S1, S2, S4]).flatmap(
    lambda data: st.builds(
        lambda at, byte: data[:at] + bytes([byte]) + data[at + 1 :],
        st.integers(0, len(data) - 1),
        st.integers(0, 255),
    )
))  # fmt: skip
def test_arbitrary_bytes_raise_only_remote_errors(data: bytes) -> None:
    for decode in (decode_robot, decode_answer):
        with suppress(RemoteProtocolError):
            decode(data)
    assert len(describe(data)) == 1


# --- in words


def test_robot_datagram_is_described() -> None:
    (item,) = describe(R2)
    assert (item["message"], item["direction"], item["size"]) == ("EgmRobot", "from robot", 379)
    assert item["problems"] == []
    fields = {field["name"]: field for field in item["fields"]}
    assert fields["header.mtype"]["value"] == "MSGTYPE_DATA"
    assert fields["feedBack.cartesian.pos.z"] == {
        "name": "feedBack.cartesian.pos.z",
        "value": 500.0,
        "unit": "mm",
    }
    assert fields["feedBack.joints.joints"]["unit"] == "°"
    assert fields["measuredForce.force"]["value"] == list(FORCE)
    assert fields["mciState.state"]["value"] == "MCI_RUNNING"


def test_force_of_an_older_robot_is_described() -> None:
    (item,) = describe(R1)
    assert {"name": "measuredForce.force", "value": list(FORCE), "unit": "N, N·m"} in item["fields"]


@pytest.mark.parametrize(
    ("data", "message", "field"),
    [
        (S2, "EgmSensor", ("speedRef.cartesians.value", "mm/s, °/s")),
        (S3, "EgmSensor", ("speedRef.joints.joints", "°/s")),
        (S4, "EgmSensorPathCorr", ("pathCorr.age", "ms")),
        (S5, "EgmSensor", ("RAPIDtoRobot.dnum", "")),
    ],
)
def test_answer_is_described(data: bytes, message: str, field: tuple[str, str]) -> None:
    (item,) = describe(data)
    assert (item["message"], item["direction"], item["problems"]) == (message, "to robot", [])
    assert field in [(one["name"], one["unit"]) for one in item["fields"]]


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        (FIRST._replace(planned=None), "planned holds no pose"),
        (FIRST._replace(feedback=PLACE._replace(joints_deg=JOINTS[:5])), "feedBack holds 5 joints"),
        (FIRST._replace(feedback=PLACE._replace(time_us=None)), "RobotWare before 6.07"),
        (FIRST._replace(dnum=(0.0,) * 41), "holds 41 numbers"),
    ],
)
def test_datagram_unusable_for_clients_has_problems(message: RobotMessage, problem: str) -> None:
    (item,) = describe(encode_robot(message, RobotWare.RW7))
    assert [problem in text for text in item["problems"]] == [True]


def test_ignored_answer_is_explained() -> None:
    (item,) = describe(encode_answer(SensorMessage(0, joints_deg=(0.0,) * 7)))
    assert item["problems"] == ["it is ignored: EgmSensor: 7 numbers; allowed: at most 6"]


@pytest.mark.parametrize("data", [b"", b"\xff", S1[:-1], b"\x08\x01"])
def test_other_bytes_are_noise(data: bytes) -> None:
    (item,) = describe(data)
    assert (item["kind"], item["size"]) == ("noise", len(data))
