"""Report of a program: its steps as a table, and its path as pictures."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from msgspec import structs

from hil_bridge.record import Recording
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.show.charts.columns import FEED, NORMALS, SIGMA
from hil_bridge.show.charts.maps import path_map
from hil_bridge.show.charts.painter import paint
from hil_bridge.show.charts.run import run_charts
from hil_bridge.show.pages import Axis, Chart, Charts, Span
from hil_bridge.show.pages.description import Map, Scale, room_of
from hil_bridge.show.pages.maps import map_svg
from hil_bridge.show.report import write_report
from hil_bridge.show.report.page import page
from hil_bridge.show.report.plots import draw
from hil_bridge.show.report.steps_section import criteria_paragraph, steps_section
from tests.recordings import Recordings

PROGRAM = """
[robot]
emulated = "egm"
[cell]
start_position_mm = [900.0, 0.0, 590.3]
[run]
seed = 3
[task]
approach_speed_mm_s = 1
[[task.step]]
do = "approach"
name = "touch"
[[task.step]]
do = "track"
path = { kind = "polyline", points_mm = [[0, 0], [15, 0], [15, 5]] }
speed_mm_s = 10
force_n = [[0, 6], [10, 12], [20, 6]]
feed_error_n = 3
orientation = "normal"
criterion = { within_n = 0.001, for_percent = 100 }
[[task.step]]
do = "retract"
back_mm = 0.5
"""


@pytest.fixture
def recording(recordings: Recordings) -> Recording:
    return recordings(tomllib.loads(PROGRAM))


def without_program(recording: Recording) -> Recording:
    cycles = tuple(structs.replace(cycle, step=0) for cycle in recording.cycles)
    return Recording(cycles, recording.sensors, recording.events, devices=recording.devices)


def test_page_lists_steps_and_failed_criterion(recording: Recording, tmp_path: Path) -> None:
    page = write_report(recording, summarise(recording), tmp_path).read_text()
    assert page.count("<h2>Steps</h2>") == 1
    rows = re.findall(r'<tr><td data-title="step">(\d \(\w+\))</td>(.*?)</tr>', page)
    assert [label for label, _ in rows] == ["1 (approach)", "2 (track)", "3 (retract)"]
    assert "touch: 900" in rows[0][1]
    assert '"required">100 %</td><td data-title="outcome">failed: force within ±0.001 N: ' in rows[1][1]
    assert "<p>Criterion failed in step <strong>2 (track)</strong>; 0 of 1 passed.</p>" in page
    assert "target force</td>" in page
    assert re.search(r"<td class=\"value\">6\.00 … 1[12]\.\d N</td>", page)


def test_steps_table_drops_empty_columns(recording: Recording) -> None:
    summary = summarise(recording)
    approach, track, _ = summary.steps
    passed = replace(track, passed=True, within=1.0, wanted=0.9, text="force within ±1 N: 100 % of the path")
    text = steps_section(recording, replace(summary, steps=(approach,)))
    assert re.findall("<th>(.*?)</th>", text) == ["step", "time", "outcome", "result"]
    assert "passed: force within ±1 N: 100 % of the path</td>" in steps_section(
        recording, replace(summary, steps=(passed,))
    )
    assert criteria_paragraph(replace(summary, steps=(passed,))) == "<p>The criterion passed.</p>"
    assert criteria_paragraph(replace(summary, steps=(passed,) * 2)) == "<p>Both criteria passed.</p>"


def test_page_without_program_omits_steps_section(recording: Recording) -> None:
    plain = without_program(recording)
    assert steps_section(plain, summarise(plain)) == ""


def test_charts_show_feed_and_normal_and_map_shows_path(recording: Recording) -> None:
    charts = run_charts(recording)
    by_id = {chart.id: chart for chart in charts.charts}
    assert {"feed", "normal"} < set(by_id)
    texts = [span.text for span in charts.spans]
    steps = {span.text: span.kind for span in charts.spans if "(" in span.text}
    assert steps == {"1 (approach)": "approach", "2 (track)": "track", "3 (retract)": "retract"}
    assert texts[:-1][-3:] == list(steps), "phases precede and follow the steps"
    assert set(texts) - set(steps) <= {"connect", "tare", "retract"}
    cycle = charts.sources["cycle"]
    for at, force in zip(recording.cycles, cycle["force_reference"], strict=True):
        assert force == (pytest.approx(at.force_reference, rel=1e-5) if at.phase == "track" else None)
    sigma = [c.explanation.get(SIGMA) if c.phase == "track" else None for c in recording.cycles]
    assert cycle[SIGMA] == [None if value is None else pytest.approx(value, rel=1e-5) for value in sigma]
    path = path_map(recording)
    assert path is not None
    svg = map_svg(path)
    assert svg.count("<path ") > 20
    assert ">2</text>" in svg, "the number of the step that tracks"
    assert svg in page(recording, summarise(recording))


def test_charts_without_values_are_omitted(recording: Recording) -> None:
    hidden = {FEED, SIGMA, *NORMALS}
    cycles = tuple(
        structs.replace(
            cycle,
            explanation={name: value for name, value in cycle.explanation.items() if name not in hidden},
            travel_commanded=0.0,
            across_commanded=0.0,
        )
        for cycle in recording.cycles
    )
    stationary = Recording(cycles, steps=recording.steps)
    charts = run_charts(stationary)
    assert not {"feed", "normal", "way"} & {chart.id for chart in charts.charts}
    assert path_map(stationary) is None
    assert path_map(without_program(recording)) is None


@pytest.mark.full
def test_page_and_picture_draw_same_map(recording: Recording, figures: list[Figure]) -> None:
    """Compares the pressed segments of the path, in the colours of their errors, and the numbers of their steps."""
    path = path_map(recording)
    assert path is not None
    free, pressed = path.traces
    pressing = [cycle for cycle in recording.cycles if cycle.phase == "track"]
    errors = [cycle.force - cycle.force_reference for cycle in pressing]
    assert list(pressed.values) == pytest.approx(errors)
    assert list(pressed.x) == pytest.approx([1e3 * cycle.travel_commanded for cycle in pressing])
    assert list(pressed.y) == pytest.approx([1e3 * cycle.across_commanded for cycle in pressing])
    assert sum(x == x for x in free.x) == len(recording.cycles) - len(pressing)
    assert [(spot.text, spot.x) for spot in path.spots] == [("2", pytest.approx(pressed.x[0]))]
    draw(recording, summarise(recording))
    (ax,) = (one for one in figures[-1].axes if one.get_title(loc="left") == path.title)
    (lines,) = (one for one in ax.collections if isinstance(one, LineCollection))
    assert np.asarray(lines.get_array()).tolist() == pytest.approx(errors[:-1])
    assert [text.get_text() for text in ax.texts] == ["2"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == (path.x_label, path.y_label)
    svg = map_svg(path)
    assert svg.count('stroke-width="3.5"') == len(errors) - 1
    assert f">{path.title}<" in svg


def test_map_keeps_aspect_ratio_in_any_size() -> None:
    """Equal scales: a tall map becomes narrower, and a flat one gets more space above and below."""

    def map_of(x: float, y: float) -> Map:
        return Map("m", "", "", "", (0.0, x), (0.0, y), Scale("sign", -1.0, 1.0, "N"), heights_px=(100, 500))

    assert room_of(map_of(10.0, 5.0), 800.0) == (800.0, 400.0, (0.0, 5.0))
    assert room_of(map_of(10.0, 20.0), 800.0) == (250.0, 500.0, (0.0, 20.0))
    assert room_of(map_of(80.0, 4.0), 800.0) == (800.0, 100.0, (-3.0, 7.0))


@pytest.mark.full
def test_picture_draws_target_force_while_pressing(recording: Recording, figures: list[Figure]) -> None:
    draw(recording, summarise(recording))
    (target,) = (line for line in figures[-1].axes[0].lines if line.get_label() == "target")
    forces = np.asarray(target.get_ydata(), dtype=float).tolist()
    for cycle, force in zip(recording.cycles, forces, strict=True):
        assert (
            force == pytest.approx(cycle.force_reference, rel=1e-5)
            if cycle.phase == "track"
            else force != force
        )
    texts = [text.get_text() for text in figures[-1].axes[0].texts]
    assert "2 (track)" in texts


def test_borders_of_too_many_steps_are_omitted() -> None:
    def drawn(count: int) -> tuple[int, set[str]]:
        spans = [Span(float(k), k + 1.0, f"1.1 (zero, pass {k})", "zero", short="1.1") for k in range(count)]
        chart = Chart("force", "Force", "N")
        ax = Figure().add_subplot()
        paint(ax, chart, Charts({"time": Axis("time", "s")}, [chart], {}, spans=spans))
        return len(ax.patches), {text.get_text() for text in ax.texts}

    assert drawn(201) == (0, set())
    assert drawn(10) == (10, {"1.1"}), "there is no space for more"


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return every figure that is created."""
    made: list[Figure] = []
    begin = Figure.__init__

    def noted(figure: Figure, *arguments: object, **settings: object) -> None:
        begin(figure, *arguments, **settings)  # type: ignore[arg-type]
        made.append(figure)

    monkeypatch.setattr(Figure, "__init__", noted)
    return made
