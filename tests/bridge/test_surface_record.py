"""What the record of a run tells of the emulated surface."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.recording import Recording, TruthRecord, read
from hil_bridge.recording.topics import TRUTH
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import load_config, read_config


def recorded(folder: Path, **sections: Any) -> Recording:
    """A run of two seconds of tracking in virtual time, read back."""
    sections.setdefault("run", {}).setdefault("duration_s", 2.0)
    path = folder / "run.mcap"
    assert execute(read_config(sections), True, Outputs(record=path, overwrite=True), False) == 0
    return read(path)


def test_the_truth_tells_orientation_and_normal(tmp_path: Path) -> None:
    surface = {"kind": "sphere", "radius_mm": 300.0, "height_mm": 575.0, "origin_y_mm": -100.0}
    truths = recorded(tmp_path, cell={"surface": surface}).truths
    assert len(truths) > 10
    for truth in truths:
        x, y, z = truth.position
        away = np.array([x - 0.9, y + 0.1, z - 0.275])
        assert truth.normal == pytest.approx(away / np.linalg.norm(away))
        assert truth.quaternion == (0.0, 1.0, 0.0, 0.0)


def test_an_older_truth_has_no_normal() -> None:
    old = b'{"cycle":1,"at":2.0,"position":[0,0,0],"force":[0,0,0],"joints_deg":[0,0,0,0,0,0],"faults":[]}'
    truth = TRUTH.decode(old)
    assert isinstance(truth, TruthRecord)
    assert all(map(math.isnan, (*truth.quaternion, *truth.normal)))


def test_an_unknown_normal_is_read_back_as_unknown() -> None:
    truth = TruthRecord(1, 2.0, 1.9, 2.1, (0.0,) * 3, (0.0,) * 3, (0.0,) * 6, (), (1.0, 0.0, 0.0, 0.0))
    found = TRUTH.decode(TRUTH.encode(truth))
    assert isinstance(found, TruthRecord)
    assert found.quaternion == truth.quaternion
    assert all(map(math.isnan, found.normal))


def test_a_file_of_heights_is_looked_for_beside_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "heights.txt").write_text("0 0\n1 1\n")
    file = tmp_path / "run.toml"
    file.write_text('[cell.surface]\nkind = "height_map"\nheight_map_file = "heights.txt"\n')
    assert load_config(file, {}).cell.surface.height_map_file == str(tmp_path / "heights.txt")


def test_a_run_on_heights_that_are_not_there_is_refused_in_one_line(tmp_path: Path) -> None:
    config = read_config({"cell": {"surface": {"kind": "height_map", "height_map_file": "/nowhere/heights"}}})
    outputs = Outputs(record=tmp_path / "run.mcap")
    with pytest.raises(ConfigError, match=r"^cell: height_map_file: cannot read /nowhere/heights: No such"):
        execute(config, True, outputs, False)
    assert not (tmp_path / "run.mcap").exists()


def test_a_face_on_a_surface_with_memory_is_refused_in_one_line(tmp_path: Path) -> None:
    material = {"kind": "standard_linear_solid"}
    config = read_config({"cell": {"surface": {"material": material}, "tool": {"face_radius_mm": 5.0}}})
    with pytest.raises(ConfigError, match=r"^cell: tool.face_radius_mm must be 0 on a material with memory"):
        execute(config, True, Outputs(record=tmp_path / "run.mcap"), False)
