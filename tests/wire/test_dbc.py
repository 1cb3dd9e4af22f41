"""DBC files of the devices on CAN, read by cantools: it decodes the frames of our encoders to the same values."""

import math
import struct
from typing import Any

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.can.dbc import CanMessage, database
from protocol.can.frame import CanFrame
from protocol.devices.ati_can import can_messages as board_messages
from protocol.devices.ati_can.messages import encode_counts, encode_row, encode_sample
from protocol.devices.jr3 import can_gateway as gateway
from protocol.devices.jr3.can_gateway import can_messages as gateway_messages
from protocol.fields import Field, Layout
from protocol.marks import Mark

BASE, NODE = 0x31, 5
BOARD, GATEWAY = board_messages([BASE << 4]), gateway_messages([0x080, 0x600 | NODE])
MESSAGES = [*(("board", one) for one in BOARD), *(("gateway", one) for one in GATEWAY)]
WORDS = st.integers(-32768, 32767)
SIX = st.tuples(WORDS, WORDS, WORDS, WORDS, WORDS, WORDS)


def load(name: str, messages: Any) -> Any:
    return cantools.database.load_string(database(name, messages).decode("cp1252"), "dbc")


DATABASES = {"board": load("ati-can", BOARD), "gateway": load("jr3", GATEWAY)}


def decoded(device: str, *frames: CanFrame) -> dict[str, float]:
    parts = [DATABASES[device].decode_message(one.identifier, one.data) for one in frames]
    return {name: value for part in parts for name, value in part.items()}


@given(st.integers(0, 65535), SIX)
def test_board_sample_decodes_to_status_and_gages(status: int, gages: tuple[int, ...]) -> None:
    assert decoded("board", *encode_sample(BASE, status, gages)) == {
        "status": status,
        **{f"sg{k}": gage for k, gage in enumerate(gages)},
    }


@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=6, max_size=6))
def test_row_of_the_matrix(row: list[float]) -> None:
    assert decoded("board", *encode_row(BASE, row)) == {f"sg{k}": value for k, value in enumerate(row)}


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_counts_for_a_unit(force: int, torque: int) -> None:
    assert decoded("board", encode_counts(BASE, force, torque)) == {"per_force": force, "per_torque": torque}


@given(SIX, st.integers(0, 65535))
def test_gateway_values_scale_with_the_full_scale(counts: tuple[int, ...], counter: int) -> None:
    values = decoded("gateway", *gateway.encode_sample(NODE, counts, counter))
    assert values.pop("counter") == counter
    assert list(values) == ["fx", "fy", "fz", "mx", "my", "mz"]
    assert list(values.values()) == pytest.approx([count / 16384 for count in counts], rel=1e-12)
    units = {signal.unit for signal in DATABASES["gateway"].get_message_by_name("FORCES").signals[:3]}
    assert units == {"of full scale"}


@given(st.integers(0, 65535), st.integers(0, 2**32 - 1))
def test_gateway_command_is_in_hertz_and_seconds(cutoff: int, period: int) -> None:
    frame = gateway.encode_command(gateway.Command(gateway.Op.START_ASYNC, NODE, cutoff, period))
    assert decoded("gateway", frame) == {
        "cutoff": pytest.approx(cutoff / 100),
        "period": pytest.approx(period * 1e-6),
    }


@given(st.sampled_from(MESSAGES), st.data())
def test_every_message_decodes_by_its_table(of: tuple[str, CanMessage], data: st.DataObject) -> None:
    device, message = of
    raw = data.draw(st.binary(min_size=message.layout.size, max_size=message.layout.size))
    read = DATABASES[device].decode_message(message.identifier, raw)
    signals = {
        signal.name: signal
        for signal in DATABASES[device].get_message_by_frame_id(message.identifier).signals
    }
    for item in message.layout.describe(raw):
        name = str(item["name"]).replace(" ", "_")
        value = item["value"]
        assert read[name] == pytest.approx(value, rel=1e-12, nan_ok=True)
        assert (signals[name].unit or "") == item["unit"]


def test_acknowledge_of_both_lengths_decodes_strictly() -> None:
    """cantools refuses a frame that is shorter than its message, and reads a longer one as far as the message goes."""
    for scales in (None, (115, 111, 185)):
        frame = gateway.encode_acknowledge(NODE, gateway.Acknowledge(1, scales))
        assert decoded("gateway", frame) == {"state": 1}


def test_board_serial_number_and_slot_have_messages() -> None:
    read = decoded("board", CanFrame(BASE << 4 | 5, b"FT4472\0\0"))
    assert bytes(int(value) for value in read.values()) == b"FT4472\0\0"
    assert decoded("board", CanFrame(BASE << 4 | 6, b"\x03")) == {"slot": 3}


def test_both_orders_of_bytes_signs_and_kinds_of_numbers() -> None:
    for order in "<>":
        layout = Layout(
            "all",
            22,
            order,
            tuple(
                Field(f"v{at}", at, kind, Mark.CHOSEN)
                for at, kind in ((0, "b"), (1, "B"), (2, "h"), (4, "H"), (6, "i"), (10, "I"), (14, "d"))
            ),
        )
        raw = struct.pack(f"{order}bBhHiId", -2, 254, -300, 65000, -70000, 4_000_000_000, math.pi)
        database = load("any", [CanMessage(1, "all", layout, True)])
        assert database.messages[0].senders == ["any"]
        values = database.messages[0].decode(raw)
        assert list(values.values()) == [-2, 254, -300, 65000, -70000, 4_000_000_000, math.pi]
