"""Data of the cell in three dimensions, and `hil-bridge view --save`."""

import json
import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner, Result

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.show.charts import cell
from hil_bridge.show.charts.cell import ROWS_MOST, cell_picture
from hil_bridge.show.report.markup import fold
from hil_bridge.show.report.page import cell_page
from tests.near_surface import CLOSE, EMERGENCY_STOP, merged
from tests.recordings import Recordings

RUN = merged(CLOSE, {"run": {"duration_s": 3.0}})
"""Settings of a run that reaches a steady force."""


def save(*arguments: str) -> Result:
    return CliRunner().invoke(cli, ["view", *arguments])


def test_cell_picture_has_poses_and_joints_of_run(recordings: Recordings) -> None:
    recording = recordings(RUN)
    picture = cell_picture(recording)
    cycle, truth = picture["rows"]["cycle"], picture["rows"]["truth"]
    assert len(cycle["x"]) <= ROWS_MOST
    places = np.array(
        [truth[f"position_{axis}"] for axis in "xyz" if isinstance(truth[f"position_{axis}"], list)]
    )
    assert places.shape[1] == len(truth["x"])
    newest = recording.truths[-1]
    assert truth["x"][-1] <= newest.at
    assert truth["joint_2"][-1] == pytest.approx(newest.joints_deg[1], abs=1e-3)
    assert isinstance(cycle["turn_w"], float), "a constant column is one value"
    last = [cycle for cycle in recording.cycles if cycle.phase == "track" and cycle.in_contact][-1]
    began = min(recording.cycles[0].started_at, recording.events[0].at)
    assert picture["at"] == pytest.approx(last.controlled_at - began, abs=1e-3)


@pytest.mark.parametrize(
    ("robot", "sensor", "held"),
    [
        ("s3", "jr3", r"held 10 N within ([\d.]+) N from 3 s after the touch, "),
        (
            "egm",
            "netft",
            r"held 10 N with a mean error of −?([\d.]+) N, [\d.]+ N peak to peak in the last 40 ",
        ),
    ],
)
def test_page_begins_with_how_the_force_was_held(
    recordings: Recordings, robot: str, sensor: str, held: str
) -> None:
    duration_s = 5.0 if robot == "s3" else 1.5
    cell = {"robot": {"emulated": robot}, "sensor": {"emulated": sensor}, "run": {"duration_s": duration_s}}
    recording = recordings(merged(CLOSE, cell))
    text = cell_page(recording, summarise(recording)).replace("\u00a0", " ")
    stated = re.search(f'<p class="point">Completed in [^<]*{held}', text)
    assert stated is not None
    tracked = [one for one in recording.cycles if one.phase == "track"]
    touch_at = next(one.controlled_at for one in tracked if one.force > 1.0)
    settled = [one.force - 10.0 for one in tracked if one.controlled_at > touch_at + 3.2]
    last = [one.force - 10.0 for one in tracked[-40:]]
    error = max(map(abs, settled)) if robot == "s3" else abs(sum(last) / 40)
    assert float(stated[1]) == pytest.approx(error, abs=0.02)


def test_cell_picture_of_long_run_keeps_dense_path(
    recordings: Recordings, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = recordings(RUN)
    monkeypatch.setattr(cell, "ROWS_MOST", 8)
    rows = cell_picture(recording)["rows"]
    assert len(rows["cycle"]["x"]) < 20
    assert len(rows["path"]["x"]) > 15
    assert rows["path"]["in_contact"] == 1.0
    places = np.array([rows["path"][f"position_{axis}"] for axis in "yz"])
    assert np.linalg.norm(np.diff(places, axis=1), axis=0).max() < 5.0


def test_lift_off_separates_strokes_of_path(recordings: Recordings, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recordings(RUN)
    touching = [number for number, cycle in enumerate(recording.cycles) if cycle.in_contact]
    middle = touching[len(touching) // 2]
    cycles = list(recording.cycles)
    cycles[middle] = msgspec.structs.replace(cycles[middle], in_contact=False)
    monkeypatch.setattr(cell, "ROWS_MOST", 8)
    contact = cell_picture(replace(recording, cycles=tuple(cycles)))["rows"]["path"]["in_contact"]
    assert contact.count(0.0) == 1


def test_cell_picture_without_configuration_has_only_tool(recordings: Recordings) -> None:
    recording = replace(recordings(RUN), metadata={})
    model = cell_picture(recording)["model"]
    assert (model.arm, model.piece) == (None, None)
    assert model.tool.length > 0.0


def test_view_saves_one_file_without_network(recordings: Recordings, tmp_path: Path) -> None:
    recording, page = recordings.path(RUN, faults=[EMERGENCY_STOP]), tmp_path / "cell.html"
    assert save(str(recording), "--save", str(page)).output == f"{page}\n"
    text = page.read_text()
    assert "connect-src" not in text
    assert "default-src 'none'" in text
    assert not re.search(r"(src|href)=", text)
    data = re.search(r'id="data-cell">(.*)</script>', text)
    assert data is not None
    assert len(json.loads(data[1])["model"]["arm"]["axes"]) == 6
    assert text.index('class="bar end alarm"') < text.index("data-cell=") < text.index("data-charts=")


def test_view_refuses_to_save_over_file_or_without_run(recordings: Recordings, tmp_path: Path) -> None:
    recording, page = recordings.path(RUN), tmp_path / "cell.html"
    page.write_text("mine")
    result = save(str(recording), "--save", str(page))
    assert isinstance(result.exception, ConfigError)
    assert "already exists" in str(result.exception)
    assert page.read_text() == "mine"
    result = save(str(tmp_path), "--save", str(tmp_path / "bag.html"))
    assert "--save needs the recording of a run (.mcap)" in str(result.exception)
    assert save(str(recording), "--save", str(page), "--overwrite").exit_code == 0


def test_fold_hides_section_below_its_heading() -> None:
    assert fold("<h2>Events</h2><p>one</p>") == (
        '<details class="fold"><summary><h2>Events</h2></summary>\n<p>one</p></details>\n'
    )
    assert fold("") == ""
