"""The latency of a run, hop by hop, and a site's latency back in the emulated cell."""

import dataclasses
import itertools
import json
import math
import random
import re
import tomllib
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from msgspec import structs

from emulators.quantiles import draw
from hil_bridge.cli import cli
from hil_bridge.cli.latency import site_settings
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import Silence
from hil_bridge.devices.facts import Devices, Hop, Owner, RobotHops, Sensor
from hil_bridge.devices.robots.s3.hops import robot_hops
from hil_bridge.devices.robots.s3.link import S3Link
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.errors import ConfigError
from hil_bridge.record import CycleRecord, Recording, SensorRecord, TruthRecord, read
from hil_bridge.record.analysis.hops import JITTER, MIDDLE, SENSOR
from hil_bridge.record.analysis.latency import (
    earliest_arrivals,
    latency_budget,
    latency_of,
    timestamps,
)
from hil_bridge.record.analysis.site_latency import MOST_QUANTILES
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.truth import GroundTruth
from hil_bridge.settings.configuration import Config, dump, read_config
from hil_bridge.settings.kinds import settings_of
from hil_bridge.show.report import write_report
from hil_bridge.show.report.latency_bar import by_owner, latency_bar
from hil_bridge.show.report.page import page
from hil_bridge.transports import connect_bytes, listen_bytes
from protocol.devices.jr3 import facts_of
from protocol.devices.s3.adlp import LinkProfile
from tests.paper_cell import PaperCellProfile, s3_jr3_cell

CHARACTER = 11 / 9600
MOVE_ANSWER = (8 + 5 + 4) * CHARACTER
STATUS_ANSWER = (8 + 24 + 5 + 4) * CHARACTER
"""Time of 8 bytes header, 24 bytes status, 5 around a telegram, and ENQ, ACK, ACK, EOT; specification, section 5."""
ODD_STATUS = (3.0, 3.5, 4.0, 20.0, 55.0)
ODD_MOVE = (30.0, 31.0, 60.0, 61.0, 90.0)
ODD_DELAY = (0.0, 0.5, 1.0, 1.5, 8.0)


def cycle(number: int, at: float, **changes: Any) -> CycleRecord:
    """One whose hops are known: status line 20 ms, its turnaround 10, then 2, 3, 4, 5, 6, 70 and 12 ms."""
    status_at = at + 0.030 + STATUS_ANSWER
    transmitted_at = status_at + 0.082
    values: dict[str, Any] = {
        "cycle": number,
        "phase": "track",
        "started_at": at,
        "status_transmitted_at": at + 0.020,
        "status_at": status_at,
        "sensor_at": status_at - 0.005,
        "decoded_at": status_at - 0.003,
        "proposed_at": status_at + 0.003,
        "controlled_at": status_at + 0.007,
        "sent_at": status_at + 0.012,
        "transmitted_at": transmitted_at,
        "answered_at": transmitted_at + 0.012 + MOVE_ANSWER,
        "sensor_sequence": 100 + number,
        "force": 10.0,
        "force_reference": 10.0,
        "wrench": (0.0,) * 6,
        "position": (0.0,) * 3,
        "quaternion": (1.0, 0.0, 0.0, 0.0),
        "depth": 0.0,
        "depth_commanded": 0.0,
        "travel_commanded": 0.0,
        "correction": 0.0,
    }
    return CycleRecord(**(values | changes))


def truth(of: CycleRecord, motion: float = 0.030, sample: float = 0.001) -> TruthRecord:
    """Sampled `sample` before the frame came, in motion `motion` after the last character of the order."""
    return TruthRecord(
        of.cycle,
        of.answered_at,
        of.sensor_at - sample,
        of.transmitted_at + motion,
        (0.0,) * 3,
        (0.0,) * 3,
        (0.0,) * 6,
    )


def recording(cycles: tuple[CycleRecord, ...], baudrate: int = 9600, **more: Any) -> Recording:
    robot = Setup(read_config({"robot": {"s3": {"link": {"baudrate": baudrate}}}})).facts
    devices = Devices(robot, Sensor("jr3", facts_of((115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01, 0.0159)))
    metadata, end = {"config": dump(read_config({}))}, {"line_floor_s": json.dumps(robot.line_floor_s)}
    return Recording(cycles, metadata=metadata, end=end, devices=devices.as_metadata(), **more)


CYCLES = tuple(cycle(k, 50.0 + 0.3 * k) for k in range(40))
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


def medians(found: Any) -> dict[str, float]:
    return {part.hop.name: part.times.p50_s * 1e3 for part in found.chain}


# --- the hops


def test_every_hop_is_a_row_of_one_table() -> None:
    robot = robot_hops(LinkProfile())
    hops = {SENSOR, JITTER, *MIDDLE, *robot.to_answer, *robot.beside, *itertools.chain(*robot.to_motion)}
    assert len({hop.name for hop in hops}) == len(hops)
    assert {hop.owner for hop in hops} == set(Owner)
    known = {field.name for kind in (CycleRecord, TruthRecord) for field in structs.fields(kind)}
    derived = {"earliest_at", *(moment.name for moment in robot.moments)}
    assert {name for hop in hops for name in (hop.begin, hop.end)} <= known | derived


def test_with_the_truth_the_chain_goes_from_sample_to_motion() -> None:
    found = latency_of(recording(CYCLES, truths=TRUTHS))
    assert found is not None
    assert medians(found) == pytest.approx({"sensor": 1, **HOP_MS, "interpolation": 18})
    assert [part.hop.name for part in found.beside] == [
        "status_line",
        "status_turnaround",
        "status_answer",
        "answer",
    ]
    beside = [part.times.p50_s for part in found.beside]
    assert beside == pytest.approx([0.020, 0.010, STATUS_ANSWER, MOVE_ANSWER])
    assert found.total.p50_s * 1e3 == pytest.approx(1 + sum(HOP_MS.values()) + 18)
    assert found.sentence == (
        "sample to motion 118 ms p50, 118 ms p99; largest: line time of the move (70 ms, 59 %)"
    )
    assert [(constant.words, round(constant.seconds * 1e3)) for constant in found.constants] == [
        ("the sensor's filter", 16),
        ("the servo's response", 50),
    ]


@pytest.mark.parametrize("truths", [(), TRUTHS])
def test_each_hop_begins_where_the_one_before_it_ends(truths: tuple[TruthRecord, ...]) -> None:
    found = latency_of(recording(CYCLES, truths=truths))
    assert found is not None
    assert all(a.hop.end == b.hop.begin for a, b in itertools.pairwise(found.chain))


def test_without_the_truth_the_chain_ends_with_the_answer() -> None:
    """Frames arrive 4 ms after their time at least, every fourth one 2 ms later: the 4 ms are not known."""
    frames = tuple(SensorRecord(of.sensor_at, of.sensor_sequence, (0,) * 6) for of in CYCLES)
    late = tuple(structs.replace(f, at=f.at + 0.002 * (f.sequence % 4 == 3)) for f in frames)
    cycles = tuple(structs.replace(c, sensor_at=f.at) for c, f in zip(CYCLES, late, strict=True))
    found = latency_of(recording(cycles, sensors=late))
    assert found is not None
    assert found.name == "sample's earliest arrival to answer"
    jitter = found.chain[0]
    assert (jitter.hop.name, jitter.hop.words) == (
        "sensor_jitter",
        "sensor frame's delay above the smallest one",
    )
    assert jitter.times.p50_s == pytest.approx(0.0, abs=1e-9)
    assert jitter.times.p90_s == pytest.approx(0.002)
    assert found.chain[-1].hop.name == "answer"
    assert found.chain[-1].times.p50_s == pytest.approx(MOVE_ANSWER)
    assert [constant.words for constant in found.constants] == [
        "the sensor's filter",
        "the wait for the robot's interpolator",
        "the servo's transport delay",
        "the servo's response",
    ]


def test_without_frames_the_chain_begins_with_the_arrival() -> None:
    found = latency_of(recording(CYCLES))
    assert found is not None
    assert found.name == "sample's arrival to answer"
    assert medians(found) == pytest.approx({**HOP_MS, "answer": MOVE_ANSWER * 1e3})


def test_an_answer_that_waits_for_the_motion_is_no_turnaround() -> None:
    truths = tuple(truth(of, motion=0.005) for of in CYCLES)
    found = latency_of(recording(CYCLES, truths=truths))
    assert found is not None
    assert found.chain[-1].hop.name == "robot"
    assert medians(found)["robot"] == pytest.approx(5)


def test_percentiles_are_those_of_the_cycles() -> None:
    cycles = tuple(cycle(k, 50.0 + k, transmitted_at=50.0 + k + 0.120 + k * 1e-3) for k in range(101))
    found = latency_of(recording(cycles))
    assert found is not None
    line = next(part for part in found.chain if part.hop.name == "line")
    first = cycles[0].transmitted_at - cycles[0].sent_at
    shown = line.times.as_ms()
    wanted = {name: (first + k * 1e-3) * 1e3 for name, k in (("p50_ms", 50), ("p90_ms", 90), ("p99_ms", 99))}
    assert shown == pytest.approx({**wanted, "max_ms": (first + 0.1) * 1e3}, abs=1e-5)


def test_the_line_is_taken_as_it_was_and_not_as_configured() -> None:
    """A URL set 19200 baud: the facts of the robot say so."""
    for told, share in ((recording(CYCLES), 1.0), (recording(CYCLES, 19200), 0.5)):
        hops = devices_of(told).robot.hops
        assert hops is not None
        earlier = {moment.name: moment.earlier_s for moment in hops.moments}
        wanted = {"status_replied_at": STATUS_ANSWER * share, "replied_at": MOVE_ANSWER * share}
        assert earlier == pytest.approx(wanted)


def test_a_recording_divides_a_cycle_as_the_robot_does() -> None:
    assert devices_of(recording(CYCLES)).robot.hops == robot_hops(LinkProfile())


def test_hops_of_another_robot_are_told_as_they_are() -> None:
    """One that says when it took the order, and nothing of a motion."""
    taken = Hop("taken", "sent_at", "answered_at", Owner.ROBOT, "robot's answer")
    found = latency_budget(CYCLES, RobotHops((taken,)))
    assert found is not None
    assert found.name == "sample's arrival to answer"
    assert [part.hop.name for part in found.chain] == [*(hop.name for hop in MIDDLE), "taken"]
    assert found.beside == ()


@pytest.mark.parametrize("name", ["phase", "explanation", "of no cycle", "__class__"])
def test_a_hop_between_moments_that_are_none_has_no_time(name: str) -> None:
    """A recording's facts are not trusted."""
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
def test_what_was_not_stamped_has_no_latency(broken: Recording) -> None:
    assert latency_of(broken) is None
    summary = summarise(broken)
    assert (summary.latency, summary.latency_largest, summary.latency_sentence) == ({}, "", "")


def test_the_summary_tells_it() -> None:
    told = json.loads(summarise(recording(CYCLES, truths=TRUTHS)).as_json())
    assert told["latency"]["line"] == {"p50_ms": 70.0, "p90_ms": 70.0, "p99_ms": 70.0, "max_ms": 70.0}
    assert told["latency"]["total"]["p50_ms"] == pytest.approx(118)
    assert told["latency_largest"] == "line time of the move (70 ms, 59 %)"


def test_the_report_shows_it(tmp_path: Path) -> None:
    recorded = recording(CYCLES, truths=TRUTHS)
    text = write_report(recorded, summarise(recorded), tmp_path).read_text()
    assert "Half of the cycles took 118 ms or less from sample to motion, 99 % at most 118 ms." in text
    assert "The largest part: line time of the move (70 ms, 59 %)." in text
    assert "<td>line</td><td>line</td><td>70.00</td>" in text
    assert "<td>the servo&#x27;s response</td><td>50.0</td>" in text
    assert "<h2>Latency</h2>" not in page(Recording(CYCLES), summarise(Recording(CYCLES)))


@pytest.mark.parametrize("outlier_s", [0.0, 5.0])
def test_the_figure_is_a_function_of_the_record(outlier_s: float) -> None:
    truths = (*TRUTHS[:-1], truth(CYCLES[-1], motion=0.03 + outlier_s))
    found = latency_of(recording(CYCLES, truths=truths))
    assert found is not None
    drawn = latency_bar(found)
    assert drawn == latency_bar(found)
    widths = [float(width) for width in re.findall(r'<rect [^>]*width="([\d.]+)" height="44.0"', drawn)]
    medians = [part.times.p50_s for part in found.chain]
    assert max(widths) / sum(widths) == pytest.approx(max(medians) / sum(medians), abs=0.03)
    sums = {owner.value: round(seconds * 1e3, 6) for owner, seconds in by_owner(found).items()}
    assert sums == {"bus": 1, "software": 14, "device": 3, "line": 70, "robot": 30}


# --- the lower envelope


def test_the_envelope_finds_offset_and_rate_below_the_jitter() -> None:
    source = random.Random(2)
    period, offset = 128.7e-6, 1000.0  # not quite the nominal rate
    jitter = [source.expovariate(300.0) for _ in range(3000)]
    frames = [
        SensorRecord(offset + 78 * k * period + jitter[k], 78 * k, (0,) * 6) for k in range(len(jitter))
    ]
    source.shuffle(frames)
    earliest = earliest_arrivals(frames)
    away = [earliest[f.sequence] - (offset + f.sequence * period) for f in frames]
    assert max(map(abs, away)) < 60e-6
    assert min(f.at - earliest[f.sequence] for f in frames) > -1e-9, "nothing arrives before its earliest"


def test_too_few_frames_have_no_envelope() -> None:
    one = SensorRecord(1.0, 5, (0,) * 6)
    assert earliest_arrivals([]) == {}
    assert earliest_arrivals([one]) == {}
    assert earliest_arrivals([one, one]) == {}
    assert earliest_arrivals([one, SensorRecord(math.nan, 6, (0,) * 6)]) == {}


# --- runs


def run(path: Path, **sections: Any) -> Recording:
    sections.setdefault("run", {"duration_s": 20.0})
    assert execute(read_config(sections), True, Outputs(record=path), view=False) == 0
    return read(path)


def turnarounds_ms(recorded: Recording) -> dict[str, Any]:
    hops = devices_of(recorded).robot.hops
    assert hops is not None
    moment = timestamps(recorded.cycles, hops)
    return {
        "status": (moment("status_replied_at") - moment("status_transmitted_at")) * 1e3,
        "move": (moment("replied_at") - moment("transmitted_at")) * 1e3,
    }


def test_an_emulated_run_measures_what_its_profile_says(tmp_path: Path) -> None:
    recorded = run(tmp_path / "run.mcap", run={"duration_s": 5.0})
    found = latency_of(recorded)
    assert found is not None
    assert found.name == "sample to motion"
    for values in turnarounds_ms(recorded).values():
        assert 8.0 - 1e-6 <= values.min() <= values.max() <= 16.0 + 1e-6
    line = next(part for part in found.chain if part.hop.name == "line")
    # ENQ, ACK, block of 52 and 5, ACK, EOT
    assert line.times.p50_s == pytest.approx(61 * CHARACTER)
    interpolation = next(part for part in found.chain if part.hop.name == "interpolation")
    assert 0.020 <= interpolation.times.p50_s <= interpolation.times.max_s <= 0.040 + 1e-6
    assert len(recorded.truths) == len(recorded.cycles)
    assert [t.cycle for t in recorded.truths] == [c.cycle for c in recorded.cycles]


@pytest.mark.parametrize(("sensor", "within_s"), [("jr3", 1e-3), ("jr3-uart", 2e-3), ("jr3-board", 1e-3)])
def test_the_truth_of_a_cycle_is_what_its_devices_tell(tmp_path: Path, sensor: str, within_s: float) -> None:
    recorded = run(tmp_path / "run.mcap", run={"duration_s": 5.0}, sensor={"emulated": sensor})
    for cycle_, truth_ in zip(recorded.cycles, recorded.truths, strict=True):
        assert truth_.sampled_at <= cycle_.sensor_at <= truth_.sampled_at + within_s
        assert cycle_.transmitted_at < truth_.motion_at < cycle_.transmitted_at + 0.06
        assert np.abs(np.subtract(truth_.position, cycle_.position)).max() < 2e-3
    steady = list(zip(recorded.cycles, recorded.truths, strict=True))[-20:-10]
    assert all(t.force[2] == pytest.approx(c.force, abs=1.0) for c, t in steady if c.phase == "track")


def test_the_sample_time_of_a_real_sensor_is_unknown() -> None:
    told: list[TruthRecord] = []
    cell = s3_jr3_cell(PaperCellProfile(), 0.0, 1)
    truths = GroundTruth(cell, False, told.append)
    truths.cycle(CYCLES[0])
    truths.close()
    assert math.isnan(told[0].sampled_at)


@pytest.mark.parametrize(("sensor", "gateway"), [("jr3", "gateway"), ("jr3-uart", "uart")])
def test_a_sites_latency_comes_back_from_its_emulation(tmp_path: Path, sensor: str, gateway: str) -> None:
    """Run with an odd distribution, measure, emulate, run, measure: the same quantiles."""
    cell = {
        "s3": {"robot": {"status_turnaround_ms": ODD_STATUS, "move_turnaround_ms": ODD_MOVE}},
        "jr3": {gateway: {"delay_ms": ODD_DELAY}},
    }
    site = run(tmp_path / "site.mcap", cell=cell, sensor={"emulated": sensor})
    settings = tomllib.loads(site_settings(site, LinkProfile(), sensor))
    measured = settings["cell"]
    assert settings.get("sensor") == (None if sensor == "jr3" else {"emulated": sensor})
    assert "robot" not in settings, "the line is the usual one"
    again = run(tmp_path / "again.mcap", **settings, run={"duration_s": 40.0, "seed": 5})
    emulated = tomllib.loads(site_settings(again, LinkProfile(), sensor))["cell"]
    for kind, section, name, odd, apart_ms in (
        ("s3", "robot", "status_turnaround_ms", ODD_STATUS, 8.0),
        ("s3", "robot", "move_turnaround_ms", ODD_MOVE, 8.0),
        ("jr3", gateway, "delay_ms", ODD_DELAY, 0.4),
    ):
        first, second = (evenly(cell[kind][section][name]) for cell in (measured, emulated))
        assert np.abs(first[::5] - odd).max() < apart_ms, name
        assert np.abs(first - second).max() < apart_ms, name
        assert np.abs(first - second).mean() < 0.3 * apart_ms, name


def evenly(quantiles: list[float]) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """The distribution with these quantiles at 21 even places."""
    return np.interp(np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, len(quantiles)), quantiles)


def test_rare_late_frames_stay_rare() -> None:
    """One straggler among a thousand frames is no more than that in the emulation drawn from them."""
    early = [SensorRecord(CYCLES[0].started_at + 0.01 * k, k, (k % 7, 0, 0, 0, 0, 0)) for k in range(1000)]
    late = structs.replace(early[500], at=early[500].at + 0.009)
    frames = tuple(late if frame is early[500] else frame for frame in early)
    site = dataclasses.replace(recording(CYCLES), sensors=frames)
    quantiles = tomllib.loads(site_settings(site, LinkProfile(), "jr3"))["cell"]["jr3"]["gateway"]["delay_ms"]
    assert len(quantiles) == MOST_QUANTILES
    assert quantiles[-1] == pytest.approx(9.0, abs=0.1)
    source = random.Random(1)
    drawn = [draw(quantiles, source) for _ in range(10_000)]
    assert 5 <= sum(delay > 1.0 for delay in drawn) <= 60


def test_a_short_run_has_no_distribution() -> None:
    with pytest.raises(ConfigError, match="20 stamped cycles, a distribution needs 21: record a longer run"):
        site_settings(recording(CYCLES[:20]), LinkProfile(), "jr3-board")
    with pytest.raises(ConfigError, match="0 stamped sensor frames"):
        site_settings(recording(CYCLES), LinkProfile(), "jr3")
    with pytest.raises(ConfigError, match="link's settings"):
        site_settings(Recording(CYCLES), LinkProfile(), "jr3-board")


def test_another_line_is_emulated_too() -> None:
    text = site_settings(recording(CYCLES), LinkProfile(baudrate=19200, dle_stuffing="double"), "jr3-board")
    assert text.count('baudrate = 19200\ndle_stuffing = "double"') == 2
    config = read_config(tomllib.loads(text))
    assert config.sensor.emulated == "jr3-board"
    own = settings_of(config, S3)
    assert own.emulated.link == own.client.link == LinkProfile(baudrate=19200, dle_stuffing="double")
    assert own.emulated.robot.move_turnaround_ms == pytest.approx([12.0] * len(CYCLES))
    assert own.emulated.robot.status_turnaround_ms == pytest.approx([10.0] * len(CYCLES))


def test_the_command_tells_and_writes_what_the_run_takes(tmp_path: Path) -> None:
    run(tmp_path / "run.mcap", run={"duration_s": 5.0})
    runner = CliRunner()
    site = tmp_path / "site.toml"
    result = runner.invoke(cli, ["latency", str(tmp_path / "run.mcap"), "-o", str(site)])
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].split() == ["hop", "whose", "p50", "p90", "p99", "max", "ms"]
    assert any(line.startswith("line  ") and "69.90" in line for line in lines)
    assert any(line.startswith("largest: line time of the move (70 ms") for line in lines)
    assert any(line.startswith("not stamped: the servo's response, 50.0 ms") for line in lines)
    assert lines[-1] == f"wrote {site}"
    kept = site.read_bytes()
    again = runner.invoke(cli, ["latency", str(tmp_path / "run.mcap"), "-o", str(site)])
    assert str(again.exception) == f"{site} is there already; name another file, or give --overwrite"
    assert site.read_bytes() == kept
    ran = runner.invoke(cli, ["run", str(site), "--virtual", "--duration", "1", "--no-view", "--no-record"])
    assert ran.exit_code == 0, ran.output
    assert "  latency        sample to motion" in ran.output


# --- the stamps of an order


def test_an_order_is_stamped_from_first_bid_to_last_character() -> None:
    """The first bid is not heard."""
    status = bytes.fromhex("10 02 00 20 00 00 13 02 00 00") + bytes(24)
    status += b"\x10\x03" + bytes([reduce(xor, status[2:], 3)])
    script = [b"", b"\x06", b"\x06", b"\x05", status, b"\x04"]
    sent: list[tuple[float, bytes]] = []
    told: list[tuple[float, float]] = []

    async def main() -> None:
        clock = Clock.running()
        peer = (await listen_bytes("memory:robot", clock)).transport
        answers = iter(script)

        def heard(data: bytes) -> None:
            sent.append((clock.now(), data))
            for _ in range(2 if data == b"\x04" else 1):
                if answer := next(answers, b""):
                    peer.send(answer)
                    break

        peer.start(heard, lambda cause: None)
        robot = S3Link(await connect_bytes("memory:robot", clock), LinkProfile(), clock, Silence())
        robot.start()
        try:
            assert math.isnan(robot.begun_at)
            await robot.read_status()
            told.append((robot.begun_at, robot.transmitted_at))
        finally:
            await robot.aclose()
            await peer.aclose()

    run_virtual(main)
    bids = [at for at, data in sent if data == b"\x05"]
    end = next(at for at, data in sent if data == b"\x04")
    assert len(bids) == 2
    assert told == [(pytest.approx(bids[0]), pytest.approx(end + CHARACTER))]
