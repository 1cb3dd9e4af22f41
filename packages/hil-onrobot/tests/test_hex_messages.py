"""Requests, records and messages over TCP. Source of the bytes: the maker's examples and the public driver."""

from contextlib import suppress

import pytest
from hil_onrobot.describe import describe
from hil_onrobot.messages import (
    RECORD,
    Calibration,
    Command,
    Request,
    decode_calibration,
    decode_reading,
    decode_request,
    encode_calibration,
    encode_reading,
    encode_request,
)
from hypothesis import given
from hypothesis import strategies as st

from protocol.endpoint import RemoteProtocolError

CALIBRATION = Calibration(10_000, 100_000, (74, 74, 74, 37, 37, 24))


@pytest.mark.parametrize(
    ("command", "value", "data"),
    [
        (Command.STOP, 0, "1234 0000 00000000"),
        (Command.START, 10, "1234 0002 0000000a"),
        (Command.BIAS, 0xFF, "1234 0042 000000ff"),
        (Command.SET_FILTER, 4, "1234 0081 00000004"),
        (Command.SET_RATE, 10, "1234 0082 0000000a"),
    ],
)
def test_requests_in_golden_bytes(command: Command, value: int, data: str) -> None:
    assert encode_request(command, value) == bytes.fromhex(data)
    assert decode_request(bytes.fromhex(data)) == Request(command, value)


@pytest.mark.parametrize(("data", "value"), [("12340082000a000a", 10), ("1234008100040004", 4)])
def test_doubled_value_of_the_driver_is_its_low_half(data: str, value: int) -> None:
    assert decode_request(bytes.fromhex(data)).value == value


def test_record_in_golden_bytes() -> None:
    """First record that the public driver received: 1.5098 N, …, 0.49935 N·m."""
    data = bytes.fromhex("00000001000000340000000000003afaffff9d4e000186ee000026defffff6200000c30f")
    row = (1, 52, 0, 15098, -25266, 100078, 9950, -2528, 49935)
    assert RECORD.struct.unpack(data) == row
    assert RECORD.struct.pack(*row) == data


def test_messages_over_tcp_in_golden_bytes() -> None:
    data = encode_calibration(CALIBRATION)
    assert data == bytes.fromhex("1234 02 03 00002710 000186a0 004a 004a 004a 0025 0025 0018")
    assert decode_calibration(data) == CALIBRATION
    reading = encode_reading(0x10001, (74_000, -148_000, 0, 37_000, 0, -1e9), CALIBRATION)
    assert reading == bytes.fromhex("1234 0001 03e8 f830 0000 03e8 0000 8001")
    status, wrench = decode_reading(reading, CALIBRATION)
    assert status == 1
    assert wrench == pytest.approx((7.4, -14.8, 0.0, 0.37, 0.0, -7.86408))


@pytest.mark.parametrize("head", ["1234 01 03 00002710 000186a0", "1234 02 03 00000000 000186a0", ""])
def test_calibration_in_other_units_is_refused(head: str) -> None:
    with pytest.raises(RemoteProtocolError):
        decode_calibration(bytes.fromhex(head + "0001" * 6))


@given(st.binary(max_size=40))
def test_arbitrary_bytes_raise_remote_protocol_error_only(data: bytes) -> None:
    with suppress(RemoteProtocolError):
        decode_request(data)
    with suppress(RemoteProtocolError):
        decode_calibration(data)
    with suppress(RemoteProtocolError):
        decode_reading(data, CALIBRATION)
    (item,) = describe(data)
    assert item["fields"] or item["problems"]


def test_descriptions_name_command_and_doubled_value() -> None:
    (doubled,), (unknown,) = (
        describe(bytes.fromhex(data)) for data in ("12340082000a000a", "1234004300000000")
    )
    assert doubled["op"] == "set rate"
    assert doubled["fields"][0]["value"] == 10
    assert doubled["fields"][0]["meaning"] == "the device uses the low half"
    assert unknown["problems"] == ["0043 is not a known command"]
    (record,) = describe(RECORD.struct.pack(1, 52, 0, 15098, 0, 0, 0, 0, 49935))
    values = {field["name"]: field["value"] for field in record["fields"]}
    assert (values["fx"], values["mz"], values["sample"]) == (1.5098, 0.49935, 52)
