"""Latency of emulated runs matches their profiles, and a site's latency is reproduced by the emulated cell."""

import dataclasses
import math
import random
import tomllib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from msgspec import structs

from emulators.quantiles import draw
from hil_bridge.cli import cli
from hil_bridge.cli.latency import site_settings
from hil_bridge.devices.emulator_fit import LateSettings
from hil_bridge.devices.robots.s3 import latency as s3
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.devices.sensors.jr3 import latency as jr3
from hil_bridge.errors import ConfigError
from hil_bridge.record import Recording, SensorRecord, TruthRecord, read
from hil_bridge.record.analysis.latency import latency_of, timestamps
from hil_bridge.record.analysis.site_latency import MOST_QUANTILES
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.runs.truth import GroundTruth
from hil_bridge.settings.configuration import read_config
from hil_bridge.settings.kinds import settings_of
from protocol.devices.s3.adlp import LinkProfile
from tests.paper_cell import PaperCellProfile, s3_jr3_cell
from tests.record.stamped_cycles import CHARACTER, CYCLES, recording

pytestmark = pytest.mark.full

ODD_STATUS = (3.0, 3.5, 4.0, 20.0, 55.0)
ODD_MOVE = (30.0, 31.0, 60.0, 61.0, 90.0)
ODD_DELAY = (0.0, 0.5, 1.0, 1.5, 8.0)


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


def test_emulated_run_latency_matches_profile(tmp_path: Path) -> None:
    recorded = run(tmp_path / "run.mcap", run={"duration_s": 5.0})
    result = latency_of(recorded)
    assert result is not None
    assert result.name == "sample to motion"
    for values in turnarounds_ms(recorded).values():
        assert 8.0 - 1e-6 <= values.min() <= values.max() <= 16.0 + 1e-6
    line = next(part for part in result.chain if part.hop.name == "line")
    # ENQ, ACK, block of 52 and 5, ACK, EOT
    assert line.times.p50_s == pytest.approx(61 * CHARACTER)
    interpolation = next(part for part in result.chain if part.hop.name == "interpolation")
    assert 0.020 <= interpolation.times.p50_s <= interpolation.times.max_s <= 0.040 + 1e-6
    assert len(recorded.truths) == len(recorded.cycles)
    assert [t.cycle for t in recorded.truths] == [c.cycle for c in recorded.cycles]


@pytest.mark.parametrize(("sensor", "within_s"), [("jr3", 1e-3), ("jr3-uart", 2e-3), ("jr3-board", 1e-3)])
def test_cycle_truth_matches_devices(tmp_path: Path, sensor: str, within_s: float) -> None:
    recorded = run(tmp_path / "run.mcap", run={"duration_s": 5.0}, sensor={"emulated": sensor})
    for cycle_, truth_ in zip(recorded.cycles, recorded.truths, strict=True):
        assert truth_.sampled_at <= cycle_.sample.sensor_at <= truth_.sampled_at + within_s
        assert cycle_.transmitted_at < truth_.motion_at < cycle_.transmitted_at + 0.06
        assert np.abs(np.subtract(truth_.position, cycle_.sample.position)).max() < 2e-3
    steady = list(zip(recorded.cycles, recorded.truths, strict=True))[-20:-10]
    assert all(t.force[2] == pytest.approx(c.force, abs=1.0) for c, t in steady if c.phase == "track")


def test_real_sensor_sample_time_is_unknown() -> None:
    reported: list[TruthRecord] = []
    cell = s3_jr3_cell(PaperCellProfile(), 0.0, 1)
    truths = GroundTruth(cell, False, reported.append)
    truths.cycle(CYCLES[0])
    truths.close()
    assert math.isnan(reported[0].sampled_at)


def write_cell(site: Recording, line: LinkProfile, sensor: str) -> str:
    """Return the configuration of a cell with an S3 on this line and a JR3 with the recorded latency."""
    text, _ = site_settings(
        site,
        lambda times: LateSettings(s3.NOTES, s3.late_settings(times, line)),
        partial(jr3.late_settings, sensor),
    )
    return text


@pytest.mark.parametrize(("sensor", "gateway"), [("jr3", "gateway"), ("jr3-uart", "uart")])
def test_site_latency_is_reproduced_by_emulation(tmp_path: Path, sensor: str, gateway: str) -> None:
    """Run with an odd distribution, measure, emulate, run, measure: the same quantiles."""
    cell = {
        "s3": {"robot": {"status_turnaround_ms": ODD_STATUS, "move_turnaround_ms": ODD_MOVE}},
        "jr3": {gateway: {"delay_ms": ODD_DELAY}},
    }
    site = run(tmp_path / "site.mcap", cell=cell, sensor={"emulated": sensor})
    settings = tomllib.loads(write_cell(site, LinkProfile(), sensor))
    measured = settings["cell"]
    assert settings.get("sensor") == (None if sensor == "jr3" else {"emulated": sensor})
    assert "robot" not in settings, "the line has its default settings"
    again = run(tmp_path / "again.mcap", **settings, run={"duration_s": 40.0, "seed": 5})
    emulated = tomllib.loads(write_cell(again, LinkProfile(), sensor))["cell"]
    for kind, section, name, odd, apart_ms in (
        ("s3", "robot", "status_turnaround_ms", ODD_STATUS, 8.0),
        ("s3", "robot", "move_turnaround_ms", ODD_MOVE, 8.0),
        ("jr3", gateway, "delay_ms", ODD_DELAY, 0.4),
    ):
        first, second = (even_distribution(cell[kind][section][name]) for cell in (measured, emulated))
        assert np.abs(first[::5] - odd).max() < apart_ms, name
        assert np.abs(first - second).max() < apart_ms, name
        assert np.abs(first - second).mean() < 0.3 * apart_ms, name


def even_distribution(quantiles: list[float]) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """Return the distribution with these quantiles at 21 evenly spaced points."""
    return np.interp(np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, len(quantiles)), quantiles)


def test_site_latency_rare_late_frames_stay_rare() -> None:
    """One late frame among a thousand stays as rare in the emulation."""
    early = [SensorRecord(CYCLES[0].started_at + 0.01 * k, k, (k % 7, 0, 0, 0, 0, 0)) for k in range(1000)]
    late = structs.replace(early[500], at=early[500].at + 0.009)
    frames = tuple(late if frame is early[500] else frame for frame in early)
    site = dataclasses.replace(recording(CYCLES), sensors=frames)
    quantiles = tomllib.loads(write_cell(site, LinkProfile(), "jr3"))["cell"]["jr3"]["gateway"]["delay_ms"]
    assert len(quantiles) == MOST_QUANTILES
    assert quantiles[-1] == pytest.approx(9.0, abs=0.1)
    source = random.Random(1)
    drawn = [draw(quantiles, source) for _ in range(10_000)]
    assert 5 <= sum(delay > 1.0 for delay in drawn) <= 60


def test_site_latency_of_short_run_is_refused() -> None:
    with pytest.raises(
        ConfigError, match="20 time-stamped cycles; a distribution needs at least 21: record a longer run"
    ):
        write_cell(recording(CYCLES[:20]), LinkProfile(), "jr3-board")
    with pytest.raises(ConfigError, match="0 time-stamped sensor frames"):
        write_cell(recording(CYCLES), LinkProfile(), "jr3")
    with pytest.raises(ConfigError, match="settings of its link"):
        write_cell(Recording(CYCLES), LinkProfile(), "jr3-board")


def test_site_latency_other_line_settings_are_written() -> None:
    text = write_cell(recording(CYCLES), LinkProfile(baudrate=19200, dle_stuffing="double"), "jr3-board")
    assert text.count('baudrate = 19200\ndle_stuffing = "double"') == 2
    config = read_config(tomllib.loads(text))
    assert config.sensor.emulated == "jr3-board"
    own = settings_of(config, S3)
    assert own.emulated.link == own.client.link == LinkProfile(baudrate=19200, dle_stuffing="double")
    assert own.emulated.robot.move_turnaround_ms == pytest.approx([12.0] * len(CYCLES))
    assert own.emulated.robot.status_turnaround_ms == pytest.approx([10.0] * len(CYCLES))


def test_latency_command_writes_loadable_configuration(tmp_path: Path) -> None:
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
    assert str(again.exception) == f"{site} already exists; name another file, or give --overwrite"
    assert site.read_bytes() == kept
    ran = runner.invoke(cli, ["run", str(site), "--virtual", "--duration", "1", "--no-view", "--no-record"])
    assert ran.exit_code == 0, ran.output
    assert "  latency        sample to motion" in ran.output
