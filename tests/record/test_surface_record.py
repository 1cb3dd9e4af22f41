"""The record of a run on the emulated surface."""

import dataclasses
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from msgspec.structs import replace

from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.contact_force import find_across
from hil_bridge.errors import ConfigError
from hil_bridge.record import EventKind, EventRecord, Recorder, Recording, TruthRecord, Writing, read
from hil_bridge.record.removed_map import (
    BYTES_LIMIT,
    CELLS_LIMIT,
    REMOVED_NAME,
    RemovedMap,
    from_json,
    pack_map,
)
from hil_bridge.record.topics import TRUTH
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import load_config, read_config
from hil_bridge.show.charts.map_painter import paint_map
from hil_bridge.show.charts.maps import removed_map
from hil_bridge.show.charts.surface import tilt_deg, touches
from hil_bridge.show.report.surface_section import surface_section
from tests.near_surface import WHOLE
from tests.recordings import Recordings

pytestmark = pytest.mark.sweep


def settings(**sections: Any) -> dict[str, Any]:
    """A run of two seconds of tracking."""
    return {"run": {"duration_s": 2.0}, **sections}


def test_the_truth_tells_orientation_and_normal(recordings: Recordings) -> None:
    surface = {"kind": "sphere", "radius_mm": 300.0, "height_mm": 575.0, "origin_y_mm": -100.0}
    deep = {"approach_depth_limit_mm": 30.0}
    truths = recordings(settings(cell={"surface": surface}, task=deep)).truths
    assert len(truths) > 10
    for truth in truths:
        x, y, z = truth.position
        away = np.array([x - 0.9, y + 0.1, z - 0.275])
        assert truth.normal == pytest.approx(away / np.linalg.norm(away))
        assert truth.quaternion == (0.0, 1.0, 0.0, 0.0)


def test_a_sample_tells_the_force_along_all_axes_of_the_frame(recordings: Recordings) -> None:
    """On a sphere whose top lies beside the tool's way, against the wrench and the reported orientation."""
    surface = {"kind": "sphere", "radius_mm": 300.0, "height_mm": 575.0, "origin_y_mm": -60.0}
    run = settings(
        cell={"surface": surface}, task={"approach_depth_limit_mm": 30.0}, frame={"travel": [1.0, 0.0, 0.0]}
    )
    frame = WorkFrame((0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    samples = [cycle.sample for cycle in recordings(run).cycles if cycle.sample]
    forces = [sample.force_across or 0.0 for sample in samples]
    assert forces == pytest.approx([find_across(frame, sample) for sample in samples], abs=1e-9)
    slopes = [
        across / sample.force for across, sample in zip(forces, samples, strict=True) if sample.force > 5.0
    ]
    assert np.median(slopes) == pytest.approx(40.0 / 300.0, rel=0.1), "40 mm beside the top"


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


WEARS = {"kind": "sphere", "height_mm": 590.0, "origin_y_mm": -80.0, "removal": {"um_per_n_cm2_m": 50.0}}


@pytest.mark.full
def test_the_map_of_what_was_removed_stands_in_the_record(recordings: Recordings) -> None:
    recording = recordings(settings(cell={"surface": WEARS, "tool": {"face_radius_mm": 8.0}}))
    found = recording.removed
    assert found is not None
    assert found.depths.max() > 0.05
    assert not found.depths[[0, -1]].any()
    assert not found.depths[:, [0, -1]].any()
    # The tool touched above the path from -100 mm on, which is 20 mm before the crest.
    touched = [truth.position for truth in recording.truths if truth.force[2] > 5.0]
    first = np.array(touched[0][:2])
    rows, columns = found.depths.shape
    middle = np.array(found.origin_m) + 0.5e-3 * (rows - 1) * np.array(found.direction)
    left = np.array([-found.direction[1], found.direction[0]])
    assert middle + 0.5e-3 * (columns - 1) * left == pytest.approx(first, abs=0.012)
    assert found.corner_m[0] == pytest.approx(found.origin_m[1] + 0.08)
    assert found.corner_m[1] == pytest.approx(0.9 - found.origin_m[0])


@pytest.mark.full
def test_two_runs_that_wear_are_the_same_to_the_last_byte(tmp_path: Path) -> None:
    records = []
    for name in ("one", "two"):
        config = read_config(settings(cell={"surface": WEARS, "tool": {"face_radius_mm": 8.0}}))
        path = tmp_path / f"{name}.mcap"
        assert execute(config, True, Outputs(record=path), False) == 0
        records.append(path.read_bytes())
    assert records[0] == records[1]


def test_where_nothing_was_removed_there_is_no_map(recordings: Recordings) -> None:
    assert recordings(WHOLE).removed is None


def depths(rows: int, columns: int) -> np.ndarray:
    found = np.zeros((rows, columns))
    found[3:-4, 5:-2] = np.random.default_rng(1).uniform(1e-6, 2e-6, (rows - 7, columns - 7))
    return found


def test_a_map_is_cut_to_what_is_gone_and_stays_where_it_is() -> None:
    found = pack_map((0.5, -0.2), (0.0, 1.0), (-0.1, -0.05), 0.002, depths(20, 30))
    assert found.depths.shape == (15, 25)
    # Rows follow each other along base y, columns along base -x.
    assert found.origin_m == pytest.approx((0.5 - 4 * 0.002, -0.2 + 2 * 0.002))
    assert found.corner_m == pytest.approx((-0.1 + 2 * 0.002, -0.05 + 4 * 0.002))
    np.testing.assert_allclose(found.depths[1:-1, 1:-1], depths(20, 30)[3:-4, 5:-2] * 1e6, atol=5e-4)
    assert from_json(found.as_json()) == found


def test_a_large_map_is_made_coarser() -> None:
    whole = depths(1001, 400)
    found = pack_map((0.0, 0.0), (1.0, 0.0), (0.0, 0.0), 0.001, whole)
    assert found.depths.size <= CELLS_LIMIT
    assert found.spacing_m == 0.004
    volume = found.depths.sum() * found.spacing_m**2
    assert volume == pytest.approx(whole.sum() * 1e6 * 0.001**2, rel=0.01)
    centre = (np.array(found.depths.shape) - 1) / 2 * found.spacing_m + found.origin_m
    assert centre == pytest.approx([0.4995, 0.201], abs=0.003)


GOOD = RemovedMap((0.0, 0.0), (0.0, 1.0), (0.0, 0.0), 0.001, ((0.0, 1.0), (2.0, 3.0)))


@pytest.mark.parametrize(
    "bad",
    [
        b"",
        b"\xff",
        b"[]",
        b"{}",
        b"[" * 100_000,
        replace(GOOD, spacing_m=0.0).as_json(),
        replace(GOOD, spacing_m=1e300).as_json(),
        replace(GOOD, depths_um=()).as_json(),
        replace(GOOD, depths_um=((), ())).as_json(),
        replace(GOOD, depths_um=((1.0,), (1.0, 2.0))).as_json(),
        replace(GOOD, depths_um=((-1.0,),)).as_json(),
        replace(GOOD, depths_um=((1e12,),)).as_json(),
        GOOD.as_json().replace(b"0.001", b"1e999"),
        GOOD.as_json().replace(b"3.0", b"null"),
        b" " * (BYTES_LIMIT + 1),
    ],
)
def test_a_map_that_is_none_is_refused(bad: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        from_json(bad)


@given(st.integers(0, len(GOOD.as_json()) - 1), st.binary(max_size=3))
@example(0, b"{")
def test_an_altered_attachment_is_a_map_or_refused(place: int, bytes_there: bytes) -> None:
    good = GOOD.as_json()
    try:
        found = from_json(good[:place] + bytes_there + good[place + 1 :])
    except ValueError:
        pass
    else:
        assert np.isfinite(found.depths).all()
        assert (found.depths >= 0.0).all()
        assert 0.0 < found.spacing_m < 1e3


def test_a_record_with_a_garbled_map_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorder = Recorder(path, lambda at: round(at * 1e9), {}, Writing(threaded=False))
    recorder.put(EventRecord(1.0, EventKind.PHASE, "tare"))
    recorder.attach(REMOVED_NAME, "application/json", b"{}")
    recorder.close()
    with pytest.raises(
        ConfigError, match=r"not a recording of this version: the attachment removed\.json"
    ) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def told(recording: Recording) -> str:
    page = surface_section(recording)
    return page.partition('<img alt="')[0]


def test_the_report_shows_the_map_and_the_angle(recordings: Recordings) -> None:
    recording = recordings(settings(cell={"surface": WEARS}))
    sentence = re.search(r"removed (\S+) mm³, at the deepest place (\S+) µm", told(recording))
    assert sentence is not None
    assert recording.removed is not None
    volume, deepest = map(float, sentence.groups())
    assert volume == pytest.approx(recording.removed.depths.sum() * 1e-3, rel=0.01)
    assert deepest == pytest.approx(recording.removed.depths.max(), rel=0.01)
    # The tool stays upright 20 mm beside the crest of a ball of 300 mm, and nears it.
    angle = re.search(r"stood (\S+)° RMS from the normal, at most (\S+)°", told(recording))
    assert angle is not None
    rms, most = map(float, angle.groups())
    assert most == pytest.approx(math.degrees(math.asin(20.0 / 300.0)), abs=0.1)
    assert 0.5 * most < rms < most
    assert surface_section(recording) == surface_section(recording)
    with_map, without = (
        surface_section(each) for each in (recording, dataclasses.replace(recording, removed=None))
    )
    assert "data:image/png;base64," in with_map
    wear = removed_map(recording)
    assert wear is not None
    assert wear.grid is not None
    assert list(map(tuple, wear.grid.rows)) == list(zip(*recording.removed.depths_um, strict=True))
    assert wear.scale.high == pytest.approx(recording.removed.depths.max())
    rows, columns = recording.removed.depths.shape
    spacing_mm = recording.removed.spacing_m * 1e3
    assert wear.x[1] - wear.x[0] == pytest.approx(rows * spacing_mm)
    assert wear.y[1] - wear.y[0] == pytest.approx(columns * spacing_mm)
    # where the tool touched, something is gone: the line lies on the map, at places with a depth
    (line,) = wear.traces
    places = [
        (x, y) for x, y in zip(line.x, line.y, strict=True) if x is not None and y is not None and x == x
    ]
    assert len(places) == sum(touches(truth) for truth in recording.truths)
    cells = [(int((x - wear.x[0]) / spacing_mm), int((y - wear.y[0]) / spacing_mm)) for x, y in places]
    assert all(recording.removed.depths[cell] > 0.0 for cell in cells[5:-5])
    figure = Figure()
    paint_map(ax := figure.add_subplot(), wear, 600.0)
    (drawn,) = ax.images
    assert np.array_equal(np.asarray(drawn.get_array()), recording.removed.depths.T)
    assert ax.get_title(loc="left") == wear.title
    assert "data:image" not in without
    assert "mm³" not in without


def test_a_record_without_normal_and_map_has_no_such_section(recordings: Recordings) -> None:
    recording = recordings(WHOLE)
    assert "0.00° RMS" in told(recording)
    bare = tuple(replace(truth, normal=(math.nan,) * 3) for truth in recording.truths)
    assert surface_section(dataclasses.replace(recording, truths=bare)) == ""
    assert surface_section(dataclasses.replace(recording, truths=())) == ""


def test_the_angle_is_that_between_the_axis_and_the_inward_normal() -> None:
    half = math.radians(25.0) / 2.0
    tilted = (math.sin(half), math.cos(half), 0.0, 0.0)
    truths = [
        TruthRecord(k, float(k), 0.0, 0.0, (0.0,) * 3, (0.0, 0.0, force), (0.0,) * 6, (), quaternion, normal)
        for k, (force, quaternion, normal) in enumerate(
            [
                (9.0, (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
                (9.0, tilted, (0.0, 0.0, 1.0)),
                (0.0, (0.0, 1.0, 0.0, 0.0), (0.0, 0.6, 0.8)),
                (9.0, tilted, (math.nan,) * 3),
            ]
        )
    ]
    expected = [0.0, 25.0, math.degrees(math.acos(0.8)), None]
    assert [tilt_deg(truth) for truth in truths] == [
        None if angle is None else pytest.approx(angle, abs=1e-9) for angle in expected
    ]
    assert [touches(truth) for truth in truths] == [True, True, False, True]
