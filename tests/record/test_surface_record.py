"""Recording of a run on the emulated surface."""

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

from emulators.tool import ToolProfile
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.contact_force import find_across
from hil_bridge.errors import ConfigError
from hil_bridge.record import (
    CycleRecord,
    EventKind,
    EventRecord,
    Recorder,
    Recording,
    TruthRecord,
    Writing,
    read,
)
from hil_bridge.record.device_facts import devices_of
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
from hil_bridge.show.charts.maps import maps_of, removed_map
from hil_bridge.show.charts.run import run_charts
from hil_bridge.show.charts.surface import deflection_um, tilt_deg, touches
from hil_bridge.show.pages.maps import map_row
from hil_bridge.show.report.surface_section import surface_section
from tests.near_surface import WHOLE, merged
from tests.recordings import Recordings

pytestmark = pytest.mark.sweep


def settings(**sections: Any) -> dict[str, Any]:
    """Return the settings of a run with two seconds of tracking."""
    return {"run": {"duration_s": 2.0}, **sections}


def test_truth_contains_orientation_and_normal(recordings: Recordings) -> None:
    surface = {"kind": "sphere", "radius_mm": 300.0, "height_mm": 575.0, "origin_y_mm": -100.0}
    deep = {"approach_depth_limit_mm": 30.0}
    truths = recordings(settings(cell={"surface": surface}, task=deep)).truths
    assert len(truths) > 10
    for truth in truths:
        x, y, z = truth.position
        offset = np.array([x - 0.9, y + 0.1, z - 0.275])
        assert truth.normal == pytest.approx(offset / np.linalg.norm(offset))
        assert truth.quaternion == pytest.approx((0.0, 1.0, 0.0, 0.0), abs=1e-3)


def test_sample_contains_force_along_all_frame_axes(recordings: Recordings) -> None:
    """On a sphere whose top is not on the tool's path, compared with the wrench and the reported orientation."""
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
    assert np.median(slopes) == pytest.approx(40.0 / 300.0, rel=0.1), "40 mm from the top"


def test_older_truth_record_has_no_normal() -> None:
    old = b'{"cycle":1,"at":2.0,"position":[0,0,0],"force":[0,0,0],"joints_deg":[0,0,0,0,0,0],"faults":[]}'
    truth = TRUTH.decode(old)
    assert isinstance(truth, TruthRecord)
    assert all(map(math.isnan, (*truth.quaternion, *truth.normal, *truth.deflection)))


def test_unknown_normal_roundtrip() -> None:
    truth = TruthRecord(1, 2.0, 1.9, 2.1, (0.0,) * 3, (0.0,) * 3, (0.0,) * 6, (), (1.0, 0.0, 0.0, 0.0))
    result = TRUTH.decode(TRUTH.encode(truth))
    assert isinstance(result, TruthRecord)
    assert result.quaternion == truth.quaternion
    assert all(map(math.isnan, result.normal))


def test_height_file_path_is_relative_to_configuration(tmp_path: Path) -> None:
    (tmp_path / "heights.txt").write_text("0 0\n1 1\n")
    file = tmp_path / "run.toml"
    file.write_text('[cell.surface]\nkind = "height_map"\nheight_map_file = "heights.txt"\n')
    assert load_config(file, {}).cell.surface.height_map_file == str(tmp_path / "heights.txt")


def test_missing_height_file_is_refused_in_one_line(tmp_path: Path) -> None:
    config = read_config({"cell": {"surface": {"kind": "height_map", "height_map_file": "/nowhere/heights"}}})
    outputs = Outputs(record=tmp_path / "run.mcap")
    with pytest.raises(ConfigError, match=r"^cell: height_map_file: cannot read /nowhere/heights: No such"):
        execute(config, True, outputs, False)
    assert not (tmp_path / "run.mcap").exists()


def test_face_with_memory_surface_is_refused_in_one_line(tmp_path: Path) -> None:
    material = {"kind": "standard_linear_solid"}
    config = read_config({"cell": {"surface": {"material": material}, "tool": {"face_radius_mm": 5.0}}})
    with pytest.raises(ConfigError, match=r"^cell: tool.face_radius_mm must be 0 on a material with memory"):
        execute(config, True, Outputs(record=tmp_path / "run.mcap"), False)


WEARS = {"kind": "sphere", "height_mm": 590.0, "origin_y_mm": -80.0, "removal": {"um_per_n_cm2_m": 50.0}}


@pytest.mark.full
def test_removed_map_is_recorded(recordings: Recordings) -> None:
    recording = recordings(settings(cell={"surface": WEARS, "tool": {"face_radius_mm": 8.0}}))
    result = recording.removed
    assert result is not None
    assert result.depths.max() > 0.05
    assert not result.depths[[0, -1]].any()
    assert not result.depths[:, [0, -1]].any()
    # The tool touched above the path from -100 mm on, which is 20 mm before the crest.
    touched = [truth.position for truth in recording.truths if truth.force[2] > 5.0]
    first = np.array(touched[0][:2])
    rows, columns = result.depths.shape
    middle = np.array(result.origin_m) + 0.5e-3 * (rows - 1) * np.array(result.direction)
    left = np.array([-result.direction[1], result.direction[0]])
    assert middle + 0.5e-3 * (columns - 1) * left == pytest.approx(first, abs=0.012)
    assert result.corner_m[0] == pytest.approx(result.origin_m[1] + 0.08)
    assert result.corner_m[1] == pytest.approx(0.9 - result.origin_m[0])


@pytest.mark.full
def test_runs_with_wear_are_identical(tmp_path: Path) -> None:
    records = []
    for name in ("one", "two"):
        config = read_config(settings(cell={"surface": WEARS, "tool": {"face_radius_mm": 8.0}}))
        path = tmp_path / f"{name}.mcap"
        assert execute(config, True, Outputs(record=path), False) == 0
        records.append(path.read_bytes())
    assert records[0] == records[1]


def test_run_without_removal_has_no_map(recordings: Recordings) -> None:
    assert recordings(WHOLE).removed is None


def depths(rows: int, columns: int) -> np.ndarray:
    result = np.zeros((rows, columns))
    result[3:-4, 5:-2] = np.random.default_rng(1).uniform(1e-6, 2e-6, (rows - 7, columns - 7))
    return result


def test_removed_map_is_cropped_in_place() -> None:
    result = pack_map((0.5, -0.2), (0.0, 1.0), (-0.1, -0.05), 0.002, depths(20, 30))
    assert result.depths.shape == (15, 25)
    # Rows follow each other along base y, columns along base -x.
    assert result.origin_m == pytest.approx((0.5 - 4 * 0.002, -0.2 + 2 * 0.002))
    assert result.corner_m == pytest.approx((-0.1 + 2 * 0.002, -0.05 + 4 * 0.002))
    np.testing.assert_allclose(result.depths[1:-1, 1:-1], depths(20, 30)[3:-4, 5:-2] * 1e6, atol=5e-4)
    assert from_json(result.as_json()) == result


@pytest.mark.parametrize("turns", range(4))
def test_turned_removed_map_has_same_depths_in_place(turns: int) -> None:
    """Each depth stays at its position in the base frame, whatever the direction of the map."""
    depths = ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    removed = RemovedMap((0.9, 0.1), (0.6, 0.8), (0.0, 0.0), 0.01, depths)
    x, y = ((0.6, 0.8), (-0.8, 0.6), (-0.6, -0.8), (0.8, -0.6))[turns]
    turned = removed.turned_to((x, y), (0.9, 0.1))
    assert turned is not None
    assert _depths_at(turned) == _depths_at(removed)
    for row, line in enumerate(turned.depths_um):
        for column, depth in enumerate(line):
            along, across = (a + 0.01 * k for a, k in zip(turned.corner_m, (row, column), strict=True))
            east, north = along * x - across * y, along * y + across * x
            assert _depths_at(removed)[round(0.9 + east, 6), round(0.1 + north, 6)] == depth
    assert removed.turned_to((1.0, 0.0), (0.9, 0.1)) is None, "cells would not match"


def _depths_at(removed: RemovedMap) -> dict[tuple[float, float], float]:
    """Return the depths by position in base x and y, m."""
    (x, y), (dx, dy), step = removed.origin_m, removed.direction, removed.spacing_m
    return {
        (round(x + step * (row * dx - k * dy), 6), round(y + step * (row * dy + k * dx), 6)): depth
        for row, line in enumerate(removed.depths_um)
        for k, depth in enumerate(line)
    }


def test_large_removed_map_is_coarsened() -> None:
    complete = depths(1001, 400)
    result = pack_map((0.0, 0.0), (1.0, 0.0), (0.0, 0.0), 0.001, complete)
    assert result.depths.size <= CELLS_LIMIT
    assert result.spacing_m == 0.004
    volume = result.depths.sum() * result.spacing_m**2
    assert volume == pytest.approx(complete.sum() * 1e6 * 0.001**2, rel=0.01)
    centre = (np.array(result.depths.shape) - 1) / 2 * result.spacing_m + result.origin_m
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
def test_invalid_removed_map_is_refused(bad: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        from_json(bad)


@given(st.integers(0, len(GOOD.as_json()) - 1), st.binary(max_size=3))
@example(0, b"{")
def test_altered_removed_map_is_valid_or_refused(offset: int, new_bytes: bytes) -> None:
    good = GOOD.as_json()
    try:
        result = from_json(good[:offset] + new_bytes + good[offset + 1 :])
    except ValueError:
        pass
    else:
        assert np.isfinite(result.depths).all()
        assert (result.depths >= 0.0).all()
        assert 0.0 < result.spacing_m < 1e3


def test_recording_with_damaged_map_is_refused(tmp_path: Path) -> None:
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


def report_text(recording: Recording) -> str:
    page = surface_section(recording)
    return page.partition('<img alt="')[0]


def test_report_contains_removed_map_and_tilt(recordings: Recordings) -> None:
    recording = recordings(settings(cell={"surface": WEARS}))
    sentence = re.search(r"removed (\S+) mm³, at most (\S+) µm deep", report_text(recording))
    assert sentence is not None
    assert recording.removed is not None
    volume, deepest = map(float, sentence.groups())
    assert volume == pytest.approx(recording.removed.depths.sum() * 1e-3, rel=0.01)
    assert deepest == pytest.approx(recording.removed.depths.max(), rel=0.01)
    # The tool stays upright 20 mm from the crest of a ball of 300 mm, and approaches it.
    angle = re.search(r"axis was (\S+)° RMS from the normal, at most (\S+)°", report_text(recording))
    assert angle is not None
    rms, most = map(float, angle.groups())
    assert most == pytest.approx(math.degrees(math.asin(20.0 / 300.0)), abs=0.1)
    assert 0.5 * most < rms < most
    assert surface_section(recording) == surface_section(recording)
    with_map, without = (
        f"{surface_section(each)}{map_row(maps_of(each))}"
        for each in (recording, dataclasses.replace(recording, removed=None))
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
    # material is removed where the tool touched: the line on the map passes positions with a depth
    (line,) = wear.traces
    places = [
        (x, y) for x, y in zip(line.x, line.y, strict=True) if x is not None and y is not None and x == x
    ]
    assert len(places) == sum(touches(truth) for truth in recording.truths)
    cells = [(int((x - wear.x[0]) / spacing_mm), int((y - wear.y[0]) / spacing_mm)) for x, y in places]
    assert all(recording.removed.depths[cell] > 0.0 for cell in cells[5:-5])
    figure = Figure()
    paint_map(ax := figure.add_subplot(), wear, 600.0)
    (image,) = ax.images
    assert np.array_equal(np.asarray(image.get_array()), recording.removed.depths.T)
    assert ax.get_title(loc="left") == wear.title
    assert "data:image" not in without
    assert "mm³" not in without


def test_report_without_surface_data_omits_section(recordings: Recordings) -> None:
    recording = recordings(merged(WHOLE, {"cell": {"arm": {"compliance": "rigid"}}}))
    assert "0.00° RMS" in report_text(recording)
    bare = tuple(replace(truth, normal=(math.nan,) * 3) for truth in recording.truths)
    assert surface_section(dataclasses.replace(recording, truths=bare)) == ""
    assert surface_section(dataclasses.replace(recording, truths=())) == ""


STIFF_N_M = 30e3
COMPLIANT = {
    "run": {"duration_s": 2.0},
    "cell": {"arm": {"compliance": "cartesian", "stiffness_n_m": [STIFF_N_M] * 3 + [0.0] * 3}},
    "task": {"force_n": 40.0},
}
WEIGHT_N = 9.80665 * ToolProfile().mass_kg


def steady_cycles(recording: Recording) -> list[tuple[CycleRecord, TruthRecord]]:
    """Return the last cycles of the contact, in which the tool stays at its depth."""
    pairs = zip(recording.cycles, recording.truths, strict=True)
    return [(cycle, truth) for cycle, truth in pairs if cycle.phase == Phase.TRACK][-5:]


def test_truth_deflection_is_force_over_stiffness(recordings: Recordings) -> None:
    """Along the approach, where the sensor adds 2 µm and the tool still oscillates by some µm."""
    for _, truth in steady_cycles(recordings(COMPLIANT)):
        expected = (truth.force[2] - WEIGHT_N) / STIFF_N_M
        assert truth.deflection[2] == pytest.approx(expected, rel=0.01)


def test_position_without_deflection_is_reported(recordings: Recordings) -> None:
    recording = recordings(COMPLIANT)
    step = devices_of(recording).robot.position_step_m
    assert step is not None
    for cycle, truth in steady_cycles(recording):
        measured = truth.position[2] - truth.deflection[2]
        assert cycle.sample.position[2] == pytest.approx(measured, abs=0.51 * step)
        assert abs(cycle.sample.position[2] - truth.position[2]) > 5.0 * step


def test_report_of_compliant_arm_contains_deflection(recordings: Recordings) -> None:
    recording = recordings(COMPLIANT)
    charts = run_charts(recording)
    (chart,) = (one for one in charts.charts if one.id == "deflection")
    back, across = (charts.sources[one.source][one.column] for one in chart.series)
    assert back == pytest.approx([1e6 * one.deflection[2] for one in recording.truths], rel=1e-5, abs=1e-3)
    lateral = [1e6 * math.hypot(*one.deflection[:2]) for one in recording.truths]
    assert across == pytest.approx(lateral, rel=1e-5, abs=1e-3)
    text = report_text(recording)
    sentence = re.search(r"deflected by at most (\S+) µm .*; about (\S+) µm per newton", text)
    assert sentence is not None
    largest, ratio = map(float, sentence.groups())
    touched = [1e6 * math.hypot(*one.deflection) for one in recording.truths if touches(one)]
    assert largest == pytest.approx(max(touched), abs=0.5)
    assert ratio == pytest.approx(1e6 / STIFF_N_M, rel=0.05)
    assert "47 ms old, rounded to 0.125 mm." in text


def test_deflection_of_rigid_or_unknown_arm_is_not_drawn(recordings: Recordings) -> None:
    rigid = recordings(settings(cell={"arm": {"compliance": "rigid"}}))
    assert {truth.deflection for truth in rigid.truths} == {(0.0, 0.0, 0.0)}
    unknown = tuple(replace(truth, deflection=(math.nan,) * 3) for truth in recordings(COMPLIANT).truths)
    for recording in (rigid, dataclasses.replace(recordings(COMPLIANT), truths=unknown)):
        charts = run_charts(recording)
        assert "deflection" not in {chart.id for chart in charts.charts}
        assert "deflected" not in report_text(recording)


def test_deflection_is_split_along_and_across_approach() -> None:
    truth = TruthRecord(1, 2.0, 1.9, 2.1, (0.0,) * 3, (0.0,) * 3, (0.0,) * 6, deflection=(3e-6, 4e-6, 12e-6))
    assert deflection_um(truth, (0.0, 0.0, -1.0)) == pytest.approx((12.0, 5.0))
    assert deflection_um(truth, (0.6, 0.8, 0.0)) == pytest.approx((-5.0, 12.0))


def test_tilt_is_angle_between_axis_and_inward_normal() -> None:
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
