"""Emulated sensor: its commands, its packets, and its faults."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hil_schunk.messages import (
    FILTERS,
    HARDWARE,
    INVALID,
    MECHANICAL,
    READY,
    USER,
    Command,
    Parameter,
    encode_read,
)
from hil_schunk.profile import FtsProfile
from hil_schunk.sensor import FtsSensor
from schunk_bench import EPOCH, HOST, LOAD, Bench

from emulators.sensing import SteppedWrench
from protocol.marks import SettingError


def test_stream_has_rate_counters_and_receiver() -> None:
    bench = Bench()
    connection = bench.connect()
    assert bench.datagrams(0.1) == []
    assert bench.command(connection, Command.START) == 0
    datagrams = bench.datagrams(0.3)
    assert {one.side for one in datagrams} == {HOST}
    assert len(datagrams) == 300
    again = Bench()
    again.command(again.connect(), Command.START)
    packets = again.packets(0.3)
    assert [packet.counter for packet in packets] == list(range(300))
    assert [packet.packet_id for packet in packets] == [number % 256 for number in range(300)]
    assert {packet.status for packet in packets} == {READY}
    assert packets[7].wrench == pytest.approx(LOAD, abs=0.006)
    assert again.sensor.sampled_at(7) == pytest.approx(EPOCH + 0.008)


def test_counter_wraps() -> None:
    bench = Bench()
    bench.sensor._counter = 65533  # after a minute
    bench.command(bench.connect(), Command.START)
    assert [packet.counter for packet in bench.packets(0.004)] == [65534, 65535, 0, 1]
    assert bench.sensor.sampled_at(1) == pytest.approx(EPOCH + 0.0035)


def test_stop_and_close_end_the_stream() -> None:
    bench = Bench()
    connection = bench.connect()
    for end in (lambda: bench.command(connection, Command.STOP), lambda: connection.close(bench.now)):
        bench.command(connection, Command.START)
        assert len(bench.packets(0.05)) == 50
        end()
        assert bench.packets(0.05) == []


def test_stream_outlives_connection_on_request() -> None:
    bench = Bench(stops_with_connection=False)
    connection = bench.connect()
    bench.command(connection, Command.START)
    connection.close(bench.now)
    assert len(bench.packets(0.05)) == 50


def test_newest_client_receives_the_stream() -> None:
    bench = Bench(clients=2)
    first, second = bench.connect(), bench.connect(("192.0.2.8", 54843))
    assert bench.sensor.connect("third", bench.now) is None
    bench.command(first, Command.START)
    bench.command(second, Command.START)
    assert {one.side for one in bench.datagrams(0.02)} == {("192.0.2.8", 54843)}
    first.close(bench.now)  # it no longer owns the stream
    assert len(bench.datagrams(0.02)) == 20


@pytest.mark.parametrize(
    ("payload", "answer"),
    [
        ("42", "42 01"),
        ("31 04", "31 00"),
        ("31 05", "31 03"),
        ("30 03", "30 00"),
        ("30 04", "30 03"),
        ("30", "30 03"),
        ("10", "10 00"),
        ("f0 0100 00", "f0 00 0100 00 465453"),
        ("f0 0210 01", "f0 00 0210 01 656d756c61746564"),
        ("f0 5000 00", "f0 00 5000 00 00"),
        ("f0 9999 ff", "f0 03 9999 ff"),
        ("f1 5000 00 01", "f1 03 5000 00"),
        ("f0 01", "f0 03"),
    ],
)
def test_commands_are_answered(payload: str, answer: str) -> None:
    bench = Bench()
    assert bench.ask(bench.connect(), bytes.fromhex(payload)) == bytes.fromhex(answer)


def test_answers_are_counted_for_each_connection() -> None:
    bench = Bench()
    for connection in (bench.connect(), bench.connect()):
        connection.receive(bytes.fromhex("ffff0000010040ffff0000010041"), bench.now)
        assert connection.data_to_send(bench.now) == bytes.fromhex("ffff010002004000ffff020002004100")


def test_unmodelled_commands_and_parameters_are_reported() -> None:
    bench = Bench()
    for payload in ("11", "f0 9999 ff"):
        bench.ask(bench.connect(), bytes.fromhex(payload))
    assert [thing.thing for thing in bench.sensor.unmodelled.things] == [
        "command 11",
        "read of parameter 9999.FF",
    ]


@pytest.mark.parametrize("number", range(len(FILTERS)))
def test_filter_is_running_mean(number: int) -> None:
    """A step appears after it as a ramp of as many samples as the mean has."""
    bench = Bench()
    connection = bench.connect()
    bench.command(connection, Command.SELECT_FILTER, number)
    bench.command(connection, Command.START)
    bench.packets(0.05)
    bench.push((0.0,) * 6)
    forces = [packet.wrench[0] for packet in bench.packets(0.03)]
    length = FILTERS[number]
    ramp = [10.0 * max(0.0, 1.0 - (place + 1) / length) for place in range(30)]
    assert np.allclose(forces, ramp, atol=0.006)


def test_tare_is_undone() -> None:
    bench = Bench()
    connection = bench.connect()
    bench.command(connection, Command.START)
    for command, expected in ((Command.TARE, (0.0,) * 6), (Command.UNDO_TARE, LOAD)):
        bench.packets(0.01)
        bench.command(connection, command)
        assert bench.packets(0.01)[-1].wrench == pytest.approx(expected, abs=0.006)


def test_tool_setting_moves_the_reference_of_moments() -> None:
    """A force of 30 N along z at a point 100 mm along x has a moment of +3 N·m about y of the sensor."""
    points = ((0.0,) * 3, (100.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3)
    bench = Bench((0.0, 0.0, 30.0, 0.0, -3.0, 0.0), tool_points_mm=points)
    connection = bench.connect()
    bench.command(connection, Command.SELECT_TOOL, 1)
    bench.command(connection, Command.START)
    assert bench.packets(0.01)[-1].wrench == pytest.approx((0.0, 0.0, 30.0, 0.0, 0.0, 0.0), abs=0.006)


@pytest.mark.parametrize(
    ("settings", "load", "status"),
    [
        ({}, (599.0, 0.0, 0.0, 0.0, 0.0, 0.0), READY),
        ({}, (601.0, 0.0, 0.0, 0.0, 0.0, 0.0), MECHANICAL),
        ({"overload_clears_ready": False}, (0.0, 0.0, 0.0, 0.0, 0.0, -25.0), READY | MECHANICAL),
        ({"tool_limits_n": (50.0, 0.0, 0.0, 0.0)}, (40.0, 40.0, 0.0, 0.0, 0.0, 0.0), READY | USER),
        ({"tool_limits_nm": (5.0, 0.0, 0.0, 0.0)}, (60.0, 0.0, 0.0, 0.0, 0.0, 5.1), READY | USER),
    ],
)
def test_overload_is_in_the_status(
    settings: dict[str, Any], load: tuple[float, float, float, float, float, float], status: int
) -> None:
    bench = Bench(**settings)
    bench.command(bench.connect(), Command.START)
    bench.packets(0.01)
    bench.push(load)
    packets = bench.packets(0.01)
    assert packets[-1].status == status
    assert packets[-1].wrench[0] <= 600.0
    bench.push((0.0,) * 6)
    assert bench.packets(0.01)[-1].status == READY


def test_reset_closes_nothing_and_boots() -> None:
    bench = Bench(boot_s=1.0, warm_up_s=0.5)
    connection = bench.connect()
    bench.command(connection, Command.TARE)
    bench.command(connection, Command.START)
    assert bench.command(connection, Command.RESET) == 0
    assert bench.packets(0.5) == []
    assert bench.sensor.connect(HOST, bench.now) is None
    assert bench.ask(connection, bytes.fromhex("40")) == b""
    assert not connection.closing
    bench.packets(0.6)
    assert bench.ask(connection, bytes.fromhex("40")) == b""
    assert connection.closing  # the sensor does not know this connection
    connection.close(bench.now)
    bench.command(bench.connect(), Command.START)
    packets = bench.packets(0.5)
    assert packets[0].counter == 0
    assert packets[0].status == INVALID
    assert packets[-1].status == READY
    assert packets[-1].wrench == pytest.approx(LOAD, abs=0.006)  # the tare is lost


def test_faults_of_the_sensor_change_packets() -> None:
    bench = Bench()
    connection = bench.connect()
    bench.command(connection, Command.START)
    bench.inject("sensor", "unplugged", for_s=0.1)
    bench.push((0.0,) * 6)
    assert {(packet.status, packet.wrench[0]) for packet in bench.packets(0.05)} == {
        (HARDWARE | INVALID, 0.0)
    }
    bench.packets(0.1)
    bench.inject("sensor", "status", bit=0, for_s=0.1)
    assert {packet.status for packet in bench.packets(0.05)} == {0}
    bench.packets(0.1)
    bench.inject("sensor", "frozen-counter", for_s=0.05)
    assert len({packet.counter for packet in bench.packets(0.05)}) == 1
    bench.inject("sensor", "slow", factor=10.0)
    assert len(bench.packets(0.5)) == 50
    bench.inject("sensor", "taken")
    assert bench.packets(0.1) == []


def test_unplugged_sensor_repeats_its_values() -> None:
    bench = Bench()
    bench.command(bench.connect(), Command.START)
    bench.packets(0.01)
    bench.inject("sensor", "unplugged", for_s=0.1)
    bench.push((0.0,) * 6)
    assert {round(packet.wrench[0], 3) for packet in bench.packets(0.05)} == {10.0}


def test_answers_follow_faults() -> None:
    bench = Bench()
    connection = bench.connect()
    bench.inject("sensor", "short-answers", for_s=0.1)
    connection.receive(bytes.fromhex("ffff0000010040"), bench.now)
    assert connection.data_to_send(bench.now) == bytes.fromhex("ffff0100")
    bench.packets(0.2)
    bench.inject("sensor", "refusing", error=3, for_s=0.1)
    assert bench.command(connection, Command.STOP) == 3
    bench.packets(0.2)
    bench.inject("sensor-wire", "mute", for_s=0.1)
    assert bench.ask(connection, b"\x12") == b""
    assert bench.packets(0.05) == []
    bench.packets(0.1)
    assert bench.ask(connection, b"\x12") == bytes.fromhex("1200")
    assert bench.packets(0.05)[-1].wrench == pytest.approx((0.0,) * 6, abs=0.006)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"tool_limits_n": (1.0,)}, "tool_limits_n must have 4 entries, got 1"),
        ({"ratings_n": (1.0,)}, "ratings_n must be three values, got 1"),
        ({"resolution_n": 0.0}, "resolution_n must be more than 0"),
    ],
)
def test_invalid_setting_is_named(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        FtsProfile(**settings)


def test_session_of_the_makers_library_is_repeated_to_the_byte() -> None:
    """The library read name, number and one packet, selected a filter and a tool, tared, and tried the unknown
    command 42.
    """
    lines = Path(__file__).with_name("schunk-library.txt").read_text().splitlines()
    head, steps = dict(line.split(": ", 1) for line in lines[:5]), [line.split() for line in lines[5:]]
    load = json.loads(head["load"])
    source = SteppedWrench(load)
    began = 1000.0
    sensor = FtsSensor(FtsProfile(**json.loads(head["settings"])), source, began, 1)
    connection, answers = None, b""
    packets: list[bytes] = []
    for time, who, wire, text in steps:
        now = began + float(time) / 1e3
        if text == "opens":
            connection = sensor.connect(HOST, now)
            continue
        assert connection is not None
        if who == "client" and text == "closes":
            connection.close(now)
        elif who == "client":
            connection.receive(bytes.fromhex(text), now)
            answers = connection.data_to_send(now)
        elif wire == "data":
            if not packets:
                sensor.endpoint.handle_deadline(now)
                packets = [*sensor.endpoint.data_to_send(now)]
            assert packets.pop(0).hex() == text
        else:
            assert answers.hex() == text
    assert not packets
    assert sensor.endpoint.next_deadline() is None


def test_parameter_of_the_firmware_is_text() -> None:
    bench = Bench(firmware="1.2ä")
    answer = bench.ask(bench.connect(), encode_read(Parameter(0x1002, 1)))
    assert answer[5:].decode("utf-8") == "1.2ä"
