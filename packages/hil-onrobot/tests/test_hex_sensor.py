"""Emulated sensor: its requests, its records, its values over TCP, and its faults."""

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hex_bench import COUNTS, ELSEWHERE, EPOCH, HERE, LOAD, Bench
from hil_onrobot.messages import (
    BIAS_OFF,
    BIAS_ON,
    FILTERS_HZ,
    Command,
    decode_calibration,
    decode_reading,
)
from hil_onrobot.profile import HexProfile
from hil_onrobot.sensor import HexSensor

from emulators.sensing import SteppedWrench
from protocol.datagram import Datagram
from protocol.marks import SettingError


def test_stream_has_rate_numbers_and_receiver() -> None:
    bench = Bench()
    bench.send(Command.SET_RATE, 4)
    assert bench.datagrams(0.1) == []
    bench.send(Command.START)
    datagrams = bench.datagrams(0.1)
    assert {one.side for one in datagrams} == {HERE}
    assert len(datagrams) == 25
    records = bench.records(0.1)
    assert [record[0] for record in records] == list(range(26, 51))
    assert {b[1] - a[1] for a, b in itertools.pairwise(records)} == {4}
    assert {record[2] for record in records} == {0}
    assert records[0][3:] == COUNTS
    assert bench.sensor.sampled_at(26) == pytest.approx(EPOCH + 0.2005)
    assert bench.sensor.sampled_at(99) is None


def test_start_with_number_ends_by_itself_and_counts_from_one() -> None:
    bench = Bench()
    for _ in range(2):
        bench.send(Command.START, 0x00050005)  # as the public driver would send 5
        assert [record[0] for record in bench.records(0.1)] == [1, 2, 3, 4, 5]


def test_bias_is_switched_on_and_off() -> None:
    bench = Bench()
    bench.send(Command.START)
    for value, expected in ((BIAS_ON, (0,) * 6), (BIAS_OFF, COUNTS)):
        bench.records(0.01)
        bench.send(Command.BIAS, value)
        assert bench.records(0.01)[-1][3:] == expected


@pytest.mark.parametrize("number", range(len(FILTERS_HZ)))
def test_filter_has_one_pole(number: int) -> None:
    bench = Bench()
    bench.send(Command.SET_FILTER, number)
    bench.send(Command.START)
    bench.records(0.05)
    bench.push((0.0,) * 6)
    counts = [record[3] for record in bench.records(0.05)]
    share = math.exp(-2.0 * math.pi * FILTERS_HZ[number] / 1000.0) if number else 0.0
    assert np.allclose(counts, [COUNTS[0] * share ** (place + 1) for place in range(50)], atol=2.0)


def test_impossible_values_are_ignored() -> None:
    bench = Bench()
    bench.send(Command.SET_FILTER, 7)
    bench.send(Command.SET_RATE, 0)
    bench.send_bytes(bytes.fromhex("1234 0002 00000000 00"))
    bench.send_bytes(bytes.fromhex("1235 0002 00000000"))
    bench.send_bytes(bytes.fromhex("1234 0041 00000000"))
    assert bench.records(0.05) == []
    bench.send(Command.START)
    assert len(bench.records(0.05)) == 50
    assert [thing.thing for thing in bench.sensor.unmodelled.things] == ["command 0041"]


def test_second_client_takes_the_stream_over() -> None:
    bench = Bench()
    bench.send(Command.START)
    bench.records(0.01)
    bench.send(Command.START, side=ELSEWHERE)
    assert {one.side for one in bench.datagrams(0.01)} == {ELSEWHERE}
    bench.send(Command.STOP)
    assert bench.records(0.01) == []


def test_stop_of_a_stranger_may_be_ignored() -> None:
    bench = Bench(stranger_may_stop=False)
    bench.send(Command.START)
    bench.send(Command.STOP, side=ELSEWHERE)
    assert len(bench.records(0.01)) == 10


def test_sensor_may_serve_its_first_client_only() -> None:
    bench = Bench(first_client_only=True, boot_s=0.1)
    bench.send(Command.START)
    bench.send(Command.START, side=ELSEWHERE)
    assert {one.side for one in bench.datagrams(0.01)} == {HERE}
    bench.inject("sensor", "power-cycle")
    bench.datagrams(0.2)
    bench.send(Command.START, side=ELSEWHERE)
    assert {one.side for one in bench.datagrams(0.01)} == {ELSEWHERE}


def test_power_cycle_restores_defaults_after_the_boot() -> None:
    bench = Bench(boot_s=0.5)
    bench.send(Command.SET_RATE, 5)
    bench.send(Command.BIAS, BIAS_ON)
    bench.send(Command.START)
    bench.records(0.1)
    bench.inject("sensor", "power-cycle")
    bench.send(Command.START)
    assert bench.records(0.4) == []
    bench.records(0.2)
    bench.send(Command.START)
    records = bench.records(0.01)
    assert records[0][:2] == (1, 600)
    assert len(records) == 10
    assert records[0][3:] == COUNTS


def test_overload_is_in_the_status() -> None:
    bench = Bench(saturated_status=8)
    bench.send(Command.START)
    bench.records(0.01)
    bench.push((250.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert bench.records(0.01)[-1][2:4] == (8, 2_400_000)
    bench.push((0.0,) * 6)
    statuses = [record[2] for record in bench.records(0.1)]
    assert statuses.count(8) == 32


def test_faults_change_records() -> None:
    bench = Bench()
    bench.send(Command.START)
    bench.records(0.01)
    bench.inject("sensor", "unplugged", for_s=0.05)
    bench.push((0.0,) * 6)
    assert {record[2:] for record in bench.records(0.03)} == {(2, *COUNTS)}
    bench.records(0.05)
    bench.inject("sensor", "status", bit=31, for_s=0.05)
    assert {record[2] for record in bench.records(0.03)} == {1 << 31}
    bench.records(0.05)
    bench.inject("sensor", "frozen-counter", for_s=0.05)
    assert len({record[1] for record in bench.records(0.03)}) == 1
    bench.records(0.05)
    bench.push(LOAD)
    bench.records(0.01)
    bench.inject("sensor", "biased")
    assert bench.records(0.01)[-1][3:] == (0,) * 6
    bench.inject("sensor", "slow", factor=10.0)
    assert len(bench.records(0.5)) == 50
    bench.inject("sensor", "taken")
    assert bench.records(0.1) == []


def test_values_over_tcp_have_their_scales() -> None:
    bench = Bench(tcp_clients=1)
    connection = bench.sensor.connect(bench.now)
    assert connection is not None
    assert bench.sensor.connect(bench.now) is None
    bench.now += 0.05
    requests = bytes((1, *bytes(19))) + bytes(20)
    connection.receive(requests[:25], bench.now)
    calibration = decode_calibration(connection.data_to_send(bench.now))
    assert calibration.factors == (74, 74, 74, 37, 37, 24)
    connection.receive(requests[25:], bench.now)
    status, wrench = decode_reading(connection.data_to_send(bench.now), calibration)
    assert status == 0
    assert wrench == pytest.approx(LOAD, abs=0.004)
    connection.receive(bytes((2, *bytes(19))), bench.now)
    assert connection.data_to_send(bench.now) == b""
    connection.close(bench.now)
    assert bench.sensor.connect(bench.now) is not None


def test_invalid_setting_is_named() -> None:
    with pytest.raises(SettingError, match="ratings_n must be three values, got 1"):
        HexProfile(ratings_n=(1.0,))


@pytest.mark.parametrize("name", ["hex-example.txt", "hex-driver.txt"])
def test_session_of_public_client_is_repeated_to_the_byte(name: str) -> None:
    """The maker's example reads ten records and switches the bias on. The driver sends every value twice."""
    lines = Path(__file__).with_name(name).read_text().splitlines()
    head, steps = dict(line.split(": ", 1) for line in lines[:5]), [line.split() for line in lines[5:]]
    load, began = json.loads(head["load"]), 1000.0
    source = SteppedWrench(load)
    sensor = HexSensor(HexProfile(**json.loads(head["settings"])), source, began, 1)
    for time, who, text in steps:
        now = began + float(time) / 1e3
        if who == "client":
            sensor.endpoint.receive([Datagram(bytes.fromhex(text), now, HERE)], now)
        else:
            sensor.endpoint.handle_deadline(now)
            assert [one.hex() for one in sensor.endpoint.data_to_send(now)] == [text]
    assert sensor.endpoint.next_deadline() is None
