"""Monitor of recordings: decoded traffic of any device, and undecodable bytes unchanged."""

from bisect import bisect_left
from dataclasses import replace
from itertools import accumulate, cycle, pairwise, takewhile
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.cli import cli
from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.errors import ConfigError
from hil_bridge.record import LinkLog, LinkRecord
from hil_bridge.site.traffic import (
    CONTEXT_BYTES,
    TOGETHER_BYTES,
    Piece,
    describe_traffic,
    item_text,
    pieces,
)
from protocol.can.text import parse_frame
from protocol.devices.ft300.messages import HEADER, crc16
from tests.near_surface import STREAMED, merged
from tests.recordings import Recordings

FAULTS = {"rtde": "emergency-stop", "egm": "motors-off"}
"""Faults that end a run early."""


def recorded(recordings: Recordings, robot: str, sensor: str) -> Path:
    devices = {"robot": {"emulated": robot}, "sensor": {"emulated": sensor}}
    ended = {"on": "robot", "fault": FAULTS[robot], "phase": "tare"}
    return recordings.path(merged(STREAMED, devices), faults=[ended], refused=True)


def monitor_result(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["monitor", *map(str, arguments)])


def test_traffic_of_rtde_and_net_ft_run_is_described(recordings: Recordings) -> None:
    """Its data are decoded by the recipe negotiated at the start, its text as text."""
    file = recorded(recordings, "rtde", "netft")
    result = monitor_result(file)
    assert result.exit_code == 0
    lines = result.output.splitlines()
    (boots,) = [line for line in lines if " ! " in line]
    assert "netft→PC" in boots
    assert "page; " in boots
    times = [float(line.split()[0]) for line in lines]
    assert times == sorted(times)
    assert any("PC→rtde" in line and "protocol version: version 2" in line for line in lines)
    assert any(
        "rtde→PC" in line and "data: timestamp" in line and "actual TCP pose" in line for line in lines
    )
    assert any("PC→netft" in line and "start: command 2" in line for line in lines)
    assert any("netft→PC" in line and "record: rdt sequence 1," in line for line in lines)
    sensor = monitor_result(file, "--device", "sensor", "--raw").output
    assert "rtde" not in sensor
    assert "{12 34 00 02 00 00 00 00}" in sensor


def test_traffic_shows_undecodable_frames_and_bytes(recordings: Recordings) -> None:
    lines = monitor_result(recorded(recordings, "egm", "ati-can")).output.splitlines()
    assert any("PC→ati-can" in line and line.endswith("serial") for line in lines)
    assert any("EgmSensor: header.seqno 0" in line for line in lines)
    rows = list(describe_traffic([Piece(1.0, "rx", b"\x01\xff")], SENSORS.kind("jr3-board"), "sensor"))
    assert [(row.direction, row.text, row.trouble) for row in rows] == [("jr3-board→PC", "01 FF", False)]
    (unknown,) = describe_traffic([Piece(1.0, "tx", b"\x01")], None, "robot")
    assert (unknown.direction, unknown.text) == ("PC→robot", "01")


def test_traffic_device_is_read_from_recording() -> None:
    error = monitor_result("tcp://127.0.0.1:1", "--device", "sensor").exception
    assert isinstance(error, ConfigError)
    assert "--device applies only to a recording" in str(error)


def test_traffic_message_in_parts_is_reassembled() -> None:
    message = HEADER + bytes(12)
    complete = message + crc16(message).to_bytes(2, "little")
    traffic = [Piece(1.0, "rx", complete), Piece(2.0, "rx", complete[:5]), Piece(2.1, "rx", complete[5:])]
    rows = list(describe_traffic(traffic, SENSORS.kind("ft300"), "sensor"))
    assert [row.at for row in rows] == [1.0, 2.1]
    assert not any(row.trouble for row in rows)


@pytest.mark.parametrize("sizes", [(6, 6, 4), (7,), (40, 3)])
def test_traffic_of_any_cuts_is_reassembled(sizes: tuple[int, ...]) -> None:
    """The stream begins inside a message, and is longer than the context of its wire."""
    message = HEADER + bytes(12)
    complete = message + crc16(message).to_bytes(2, "little")
    stream = complete[3:] + complete * (CONTEXT_BYTES // len(complete) + 100)
    cuts = [*takewhile(lambda cut: cut < len(stream), accumulate(cycle(sizes))), len(stream)]
    traffic = [Piece(cut, "rx", stream[begin:cut]) for begin, cut in pairwise((0, *cuts))]
    first, *rows = describe_traffic(traffic, SENSORS.kind("ft300"), "sensor")
    assert (first.data, first.trouble) == (complete[3:], True)
    ends = range(2 * len(complete) - 3, len(stream) + 1, len(complete))
    assert [row.at for row in rows] == [cuts[bisect_left(cuts, end)] for end in ends]
    assert {(row.data, row.trouble) for row in rows} == {(complete, False)}


def test_traffic_undecodable_pieces_are_kept_within_bound() -> None:
    traffic = iter([Piece(float(number), "rx", b"\0") for number in range(2 * TOGETHER_BYTES)])
    next(describe_traffic(traffic, SENSORS.kind("ft300"), "sensor"))
    assert next(traffic).at == TOGETHER_BYTES


def test_traffic_distinguishes_events_datagrams_frames() -> None:
    records: list[LinkRecord] = []
    log = LinkLog(lambda at, texts: records.append(LinkRecord(at, texts)))
    log.note(1.0, "connected")
    log.take(1.0, "rx", [b"\x01", b"\x02"])
    log.take(1.5, "tx", [parse_frame("200#01")])
    log.flush()
    result = list(pieces(records, "r"))
    assert result == [
        Piece(1.0, "--", b"", event="connected"),
        Piece(1.0, "rx", b"\x01"),
        Piece(1.0, "rx", b"\x02"),
        Piece(1.5, "tx", b"", frame="200#01"),
    ]
    assert [row.text for row in describe_traffic(result[:1], None, "robot")] == ["connected"]
    (error,) = describe_traffic(
        [Piece(1.0, "rx", b"", frame="004!0000000000000000")], SENSORS.kind("ati-can"), "sensor"
    )
    assert error.trouble


@pytest.mark.parametrize("text", ["nonsense", "0.1 rx zz", "0.1 up 00", "x rx 00"])
def test_traffic_invalid_pieces_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="record the run again"):
        list(pieces([LinkRecord(0.0, (text,))], "r"))


def test_traffic_item_of_any_shape_is_one_line() -> None:
    assert item_text({}) == "item"
    assert item_text({"kind": "noise", "bytes": "01", "problems": ["a", "b\nc"]}) == "noise: 01; a; b c"
    assert item_text({"op": "go", "fields": [{"name": "x", "value": [1.0, 2]}, 3]}) == "go: x 1 2"


@given(st.sampled_from([*ROBOTS.names[1:]]), st.lists(st.binary(min_size=1, max_size=60), max_size=8))
def test_traffic_of_any_recording_is_described(name: str, data: list[bytes]) -> None:
    traffic = [Piece(float(number), "rx", one) for number, one in enumerate(data)]
    rows = list(describe_traffic(traffic, ROBOTS.kind(name), "robot"))
    assert {row.at for row in rows} <= {piece.at for piece in traffic}
    silent = replace(ROBOTS.kind(name), describe=None)
    assert [row.text for row in describe_traffic(traffic, silent, "robot")] == [
        one.hex(" ").upper() for one in data
    ]
