"""Latency of a run, hop by hop; earliest arrivals of its frames, and time stamps of an order."""

import itertools
import json
import math
import random
import re
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.facts import Hop, Owner, RobotHops
from hil_bridge.devices.robots.s3.hops import robot_hops
from hil_bridge.devices.robots.s3.link import S3Link
from hil_bridge.record import Recording, SensorRecord, TruthRecord
from hil_bridge.record.analysis.hops import JITTER, MIDDLE, SENSOR
from hil_bridge.record.analysis.latency import STAMPS, earliest_arrivals, latency_budget, latency_of
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.record.device_facts import devices_of
from hil_bridge.settings.configuration import Config, dump
from hil_bridge.show.report import write_report
from hil_bridge.show.report.latency_bar import by_owner, latency_bar
from hil_bridge.show.report.page import page
from hil_bridge.transports import connect_bytes, listen_bytes
from protocol.devices.s3.adlp import LinkProfile
from tests.record.stamped_cycles import CHARACTER, CYCLES, MOVE_ANSWER, STATUS_ANSWER, cycle, recording, truth

TRUTHS = tuple(truth(of) for of in CYCLES)
HOP_MS = {
    "decoding": 2,
    "waiting": 3,
    "controller": 3,
    "supervisor": 4,
    "hand_over": 5,
    "line": 70,
    "turnaround": 12,
}


def medians(result: Any) -> dict[str, float]:
    return {part.hop.name: part.times.p50_s * 1e3 for part in result.chain}


# --- the hops


def test_latency_table_has_every_hop() -> None:
    robot = robot_hops(LinkProfile())
    hops = {SENSOR, JITTER, *MIDDLE, *robot.to_answer, *robot.beside, *itertools.chain(*robot.to_motion)}
    assert len({hop.name for hop in hops}) == len(hops)
    assert {hop.owner for hop in hops} == set(Owner)
    known = {*STAMPS, *TruthRecord.__struct_fields__}
    derived = {"earliest_at", *(moment.name for moment in robot.moments)}
    assert {name for hop in hops for name in (hop.begin, hop.end)} <= known | derived


def test_latency_chain_with_truth_ends_at_motion() -> None:
    result = latency_of(recording(CYCLES, truths=TRUTHS))
    assert result is not None
    assert medians(result) == pytest.approx({"sensor": 1, **HOP_MS, "interpolation": 18})
    assert [part.hop.name for part in result.beside] == [
        "status_line",
        "status_turnaround",
        "status_answer",
        "answer",
    ]
    medians_s = [part.times.p50_s for part in result.beside]
    assert medians_s == pytest.approx([0.020, 0.010, STATUS_ANSWER, MOVE_ANSWER])
    assert result.total.p50_s * 1e3 == pytest.approx(1 + sum(HOP_MS.values()) + 18)
    assert result.sentence == (
        "sample to motion 118 ms p50, 118 ms p99; largest: line time of the move (70 ms, 59 %)"
    )
    assert [(constant.words, round(constant.seconds * 1e3)) for constant in result.constants] == [
        ("the sensor's filter", 16),
        ("the servo's response", 50),
    ]


@pytest.mark.parametrize("truths", [(), TRUTHS])
def test_latency_hops_are_contiguous(truths: tuple[TruthRecord, ...]) -> None:
    result = latency_of(recording(CYCLES, truths=truths))
    assert result is not None
    assert all(a.hop.end == b.hop.begin for a, b in itertools.pairwise(result.chain))


def test_latency_chain_without_truth_ends_at_response() -> None:
    """Frames arrive at least 4 ms after their time, every fourth one 2 ms later; the 4 ms are unknown."""
    frames = tuple(SensorRecord(of.sample.sensor_at, of.sample.sensor_sequence, (0,) * 6) for of in CYCLES)
    late = tuple(structs.replace(f, at=f.at + 0.002 * (f.sequence % 4 == 3)) for f in frames)
    cycles = tuple(
        structs.replace(c, sample=structs.replace(c.sample, sensor_at=f.at))
        for c, f in zip(CYCLES, late, strict=True)
    )
    result = latency_of(recording(cycles, sensors=late))
    assert result is not None
    assert result.name == "sample's earliest arrival to answer"
    jitter = result.chain[0]
    assert (jitter.hop.name, jitter.hop.words) == (
        "sensor_jitter",
        "sensor frame's delay above the smallest one",
    )
    assert jitter.times.p50_s == pytest.approx(0.0, abs=1e-9)
    assert jitter.times.p90_s == pytest.approx(0.002)
    assert result.chain[-1].hop.name == "answer"
    assert result.chain[-1].times.p50_s == pytest.approx(MOVE_ANSWER)
    assert [constant.words for constant in result.constants] == [
        "the sensor's filter",
        "the wait for the robot's interpolator",
        "the servo's transport delay",
        "the servo's response",
    ]


def test_latency_chain_without_frames_begins_at_arrival() -> None:
    result = latency_of(recording(CYCLES))
    assert result is not None
    assert result.name == "sample's arrival to answer"
    assert medians(result) == pytest.approx({**HOP_MS, "answer": MOVE_ANSWER * 1e3})


def test_latency_response_after_motion_is_no_turnaround() -> None:
    truths = tuple(truth(of, motion=0.005) for of in CYCLES)
    result = latency_of(recording(CYCLES, truths=truths))
    assert result is not None
    assert result.chain[-1].hop.name == "robot"
    assert medians(result)["robot"] == pytest.approx(5)


def test_latency_percentiles_match_cycles() -> None:
    cycles = tuple(cycle(k, 50.0 + k, transmitted_at=50.0 + k + 0.120 + k * 1e-3) for k in range(101))
    result = latency_of(recording(cycles))
    assert result is not None
    line = next(part for part in result.chain if part.hop.name == "line")
    first = cycles[0].transmitted_at - cycles[0].sent_at
    output = line.times.as_ms()
    expected = {
        name: (first + k * 1e-3) * 1e3 for name, k in (("p50_ms", 50), ("p90_ms", 90), ("p99_ms", 99))
    }
    assert output == pytest.approx({**expected, "max_ms": (first + 0.1) * 1e3}, abs=1e-5)


def test_latency_uses_recorded_line_rate() -> None:
    """A URL sets 19200 baud, so the robot's facts contain it."""
    for measured, share in ((recording(CYCLES), 1.0), (recording(CYCLES, 19200), 0.5)):
        hops = devices_of(measured).robot.hops
        assert hops is not None
        earlier = {moment.name: moment.earlier_s for moment in hops.moments}
        expected = {"status_replied_at": STATUS_ANSWER * share, "replied_at": MOVE_ANSWER * share}
        assert earlier == pytest.approx(expected)


def test_latency_hops_follow_robot_facts() -> None:
    assert devices_of(recording(CYCLES)).robot.hops == robot_hops(LinkProfile())


def test_latency_hops_of_other_robot_are_unchanged() -> None:
    """A robot that reports when it accepted the order, but no motion."""
    accepted = Hop("taken", "sent_at", "answered_at", Owner.ROBOT, "robot's answer")
    result = latency_budget(CYCLES, RobotHops((accepted,)))
    assert result is not None
    assert result.name == "sample's arrival to answer"
    assert [part.hop.name for part in result.chain] == [*(hop.name for hop in MIDDLE), "taken"]
    assert result.beside == ()


@pytest.mark.parametrize("name", ["phase", "explanation", "of no cycle", "__class__"])
def test_latency_hop_with_unknown_moments_has_no_time(name: str) -> None:
    """The facts in a recording are not trusted."""
    assert latency_budget(CYCLES, RobotHops((Hop("odd", "sent_at", name, Owner.LINE, ""),))) is None


@pytest.mark.parametrize(
    "broken",
    [
        Recording(CYCLES),
        Recording(CYCLES, metadata={"config": "{"}),
        Recording(CYCLES, metadata={"config": '{"robot": []}'}),
        Recording(CYCLES, metadata={"config": '{"robot": {"link": {"foo": 1}}}'}),
        Recording(CYCLES, metadata={"config": dump(Config())}, end={"line_floor_s": "{"}),
        recording(tuple(structs.replace(c, decoded_at=math.nan) for c in CYCLES)),
    ],
)
def test_latency_without_time_stamps_is_none(broken: Recording) -> None:
    assert latency_of(broken) is None
    summary = summarise(broken)
    assert (summary.latency, summary.latency_largest, summary.latency_sentence) == ({}, "", "")


def test_summary_contains_latency() -> None:
    measured = json.loads(summarise(recording(CYCLES, truths=TRUTHS)).as_json())
    assert measured["latency"]["line"] == {"p50_ms": 70.0, "p90_ms": 70.0, "p99_ms": 70.0, "max_ms": 70.0}
    assert measured["latency"]["total"]["p50_ms"] == pytest.approx(118)
    assert measured["latency_largest"] == "line time of the move (70 ms, 59 %)"


def test_report_contains_latency(tmp_path: Path) -> None:
    recorded = recording(CYCLES, truths=TRUTHS)
    text = write_report(recorded, summarise(recorded), tmp_path).read_text()
    assert "Half of the cycles took 118 ms or less from sample to motion, 99 % at most 118 ms." in text
    assert "The largest part: line time of the move (70 ms, 59 %)." in text
    assert "<td>line</td><td>line</td><td>70.0</td>" in text
    assert "<td>the servo&#x27;s response</td><td>50.0</td>" in text
    assert "<h2>Latency</h2>" not in page(Recording(CYCLES), summarise(Recording(CYCLES)))


@pytest.mark.parametrize("outlier_s", [0.0, 5.0])
def test_latency_bar_is_deterministic(outlier_s: float) -> None:
    truths = (*TRUTHS[:-1], truth(CYCLES[-1], motion=0.03 + outlier_s))
    result = latency_of(recording(CYCLES, truths=truths))
    assert result is not None
    bar = latency_bar(result)
    assert bar == latency_bar(result)
    widths = [float(width) for width in re.findall(r'<rect [^>]*width="([\d.]+)" height="44.0"', bar)]
    medians = [part.times.p50_s for part in result.chain]
    assert max(widths) / sum(widths) == pytest.approx(max(medians) / sum(medians), abs=0.03)
    sums = {owner.value: round(seconds * 1e3, 6) for owner, seconds in by_owner(result).items()}
    assert sums == {"bus": 1, "software": 14, "device": 3, "line": 70, "robot": 30}


# --- the lower envelope


def test_envelope_finds_offset_and_rate_below_jitter() -> None:
    source = random.Random(2)
    period, offset = 128.7e-6, 1000.0  # not quite the nominal rate
    jitter = [source.expovariate(300.0) for _ in range(3000)]
    frames = [
        SensorRecord(offset + 78 * k * period + jitter[k], 78 * k, (0,) * 6) for k in range(len(jitter))
    ]
    source.shuffle(frames)
    earliest = earliest_arrivals(frames)
    residuals = [earliest[f.sequence] - (offset + f.sequence * period) for f in frames]
    assert max(map(abs, residuals)) < 60e-6
    assert min(f.at - earliest[f.sequence] for f in frames) > -1e-9, (
        "no frame arrives before its earliest time"
    )


def test_envelope_needs_enough_frames() -> None:
    one = SensorRecord(1.0, 5, (0,) * 6)
    assert earliest_arrivals([]) == {}
    assert earliest_arrivals([one]) == {}
    assert earliest_arrivals([one, one]) == {}
    assert earliest_arrivals([one, SensorRecord(math.nan, 6, (0,) * 6)]) == {}


# --- the stamps of an order


def test_order_times_span_first_bid_to_last_character() -> None:
    """The first bid is lost."""
    status = bytes.fromhex("10 02 00 20 00 00 13 02 00 00") + bytes(24)
    status += b"\x10\x03" + bytes([reduce(xor, status[2:], 3)])
    script = [b"", b"\x06", b"\x06", b"\x05", status, b"\x04"]
    sent: list[tuple[float, bytes]] = []
    measured: list[tuple[float, float]] = []

    async def main() -> None:
        clock = Clock.running()
        peer = (await listen_bytes("memory:robot", clock)).transport
        answers = iter(script)

        def send_answer(data: bytes) -> None:
            sent.append((clock.now(), data))
            for _ in range(2 if data == b"\x04" else 1):
                if answer := next(answers, b""):
                    peer.send(answer)
                    break

        peer.start(send_answer, lambda cause: None)
        robot = S3Link(await connect_bytes("memory:robot", clock), LinkProfile(), clock, NullLog())
        robot.start()
        try:
            assert math.isnan(robot.begun_at)
            await robot.read_status()
            measured.append((robot.begun_at, robot.transmitted_at))
        finally:
            await robot.aclose()
            await peer.aclose()

    run_virtual(main)
    bids = [at for at, data in sent if data == b"\x05"]
    end = next(at for at, data in sent if data == b"\x04")
    assert len(bids) == 2
    assert measured == [(pytest.approx(bids[0]), pytest.approx(end + CHARACTER))]
