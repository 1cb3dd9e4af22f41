"""Emulated cells with hidden settings, identified from the data that their client received."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.lab.identification.identifying import Identified, identify_run
from hil_bridge.lab.identification.profile import profile_text
from hil_bridge.record import Recording
from hil_bridge.settings.configuration import load_config
from tests.recordings import Recordings
from tools.identified_cells import CELLS, cell, rows_of, true_values

pytestmark = pytest.mark.sweep

S3, EGM = 0, 9
"""Cells that run quickly: an S3 with a JR3, and an EGM with an FT 300."""
SHARE = 0.9
"""Smallest share of values within their intervals. With 25 intervals of 95 %, fewer than 22 succeed once in thirty."""


@pytest.fixture(scope="module", params=[S3, EGM], ids=["s3-jr3", "egm-ft300"])
def number(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(scope="module")
def recording(recordings: Recordings, number: int) -> Recording:
    return recordings(cell(number))


@pytest.fixture(scope="module")
def identified(recording: Recording) -> Identified:
    return identify_run(recording)


@pytest.mark.full
def test_true_values_lie_within_intervals(identified: Identified, number: int) -> None:
    rows = rows_of(number, identified.values)
    observed = [row for row in rows if row.found is not None]
    assert sum(row.within for row in observed) >= SHARE * len(observed), [
        row for row in observed if not row.within
    ]
    keys = {row.key for row in observed}
    assert {"robot.servo", "surface.stiffness", "surface.friction", "line.sensor.lost"} <= keys


@pytest.mark.full
def test_intervals_are_narrow(identified: Identified, number: int) -> None:
    """An interval that contains everything would be useless."""
    for key, share in (("surface.stiffness", 0.5), ("surface.friction", 0.3), ("robot.servo", 0.5)):
        value = identified.values.find(key)
        assert value is not None
        assert 0.5 * (value.high - value.low) < share * value.value, key


def _as_of_a_real_cell(recording: Recording) -> Recording:
    """Return the recording without truth, settings of an emulated cell, and faults."""
    config = json.loads(recording.metadata["config"])
    for section in ("cell", "faults"):
        del config[section]
    robot = json.loads(recording.devices["robot"])
    robot |= {"servo": None, "emulated": False}
    return dataclasses.replace(
        recording,
        truths=(),
        removed=None,
        events=tuple(event for event in recording.events if event.fault is None),
        metadata={**recording.metadata, "config": json.dumps(config)},
        devices={**recording.devices, "robot": json.dumps(robot)},
    )


@pytest.mark.full
def test_recorded_truth_does_not_affect_identification(recording: Recording, identified: Identified) -> None:
    assert recording.truths
    blind = identify_run(_as_of_a_real_cell(recording))
    assert str(list(blind.values)) == str(list(identified.values))
    assert profile_text(blind, "site") == profile_text(identified, "site")


def test_profile_reproduces_recorded_latency(identified: Identified, number: int, tmp_path: Path) -> None:
    file = tmp_path / "profile.toml"
    file.write_text(profile_text(identified, "site.mcap"), encoding="utf-8")
    config: Any = load_config(file, {})
    assert (config.robot.emulated, config.sensor.emulated) == CELLS[number]
    assert config.cell.surface.stiffness_n_m == pytest.approx(
        cell(number)["cell"]["surface"]["stiffness_n_m"], rel=0.2
    )
    assert any(fault.on == "sensor-wire" and fault.fault == "lost" for fault in config.faults)
    if number == EGM:
        egm = config.cell.egm
        servo_s = (egm.ref_delay_cycles + egm.arm.servo_delay_cycles) * egm.cycle_ms * 1e-3
        servo_s += 2.0 * egm.arm.damping_ratio / egm.arm.natural_frequency_rad_s
        assert servo_s == pytest.approx(true_values(cell(number))["robot.servo"], abs=2e-3)
