"""The report of a program: its steps as a table, and where they led as pictures."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from msgspec import structs

from hil_bridge.analysis.summary import summarise
from hil_bridge.recording import Recording, StepRecord, read
from hil_bridge.report import write_report
from hil_bridge.report.plots import draw
from hil_bridge.report.program_plot import FEED, NORMALS, SIGMA, draw_program
from hil_bridge.report.step_marks import mark_steps
from hil_bridge.report.steps_section import steps_section
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import load_config

PROGRAM = """
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


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("program")
    config, record = folder / "task.toml", folder / "run.mcap"
    config.write_text(PROGRAM)
    made = load_config(config, {"robot.emulated": "egm"})
    assert execute(made, True, Outputs(record), view=False) == 4
    return read(record)


def without_program(recording: Recording) -> Recording:
    cycles = tuple(structs.replace(cycle, step=0) for cycle in recording.cycles)
    return Recording(cycles, recording.sensors, recording.events, devices=recording.devices)


def test_the_page_holds_a_row_for_each_step_and_names_the_failed_criterion(
    recording: Recording, tmp_path: Path
) -> None:
    page = write_report(recording, summarise(recording), tmp_path).read_text()
    assert page.count("<h2>Steps</h2>") == 1
    rows = re.findall(r"<tr><td>(\d \(\w+\))</td>(.*?)</tr>", page)
    assert [label for label, _ in rows] == ["1 (approach)", "2 (track)", "3 (retract)"]
    assert "touch: 900" in rows[0][1]
    assert "<td>100 %</td><td>criterion FAILED: force within ±0.001 N: " in rows[1][1]
    assert "<p>criterion failed in step <strong>2 (track)</strong></p>" in page
    assert "target force</td>" in page
    assert re.search(r"<td class=\"value\">6\.00 … 1[12]\.\d\d N</td>", page)


def test_a_run_without_a_program_has_no_such_section(recording: Recording) -> None:
    plain = without_program(recording)
    assert steps_section(plain, summarise(plain)) == ""


def test_the_pictures_tell_path_feed_and_normal(recording: Recording, figures: list[Figure]) -> None:
    drawn = draw_program(recording, 0.0)
    assert drawn is not None
    assert drawn[0].startswith(b"\x89PNG")
    titles = [ax.get_title(loc="left") for ax in figures[-1].axes]
    assert list(filter(None, titles)) == [
        "path from above, and error of the force on it",
        "feed: share of the step's own speed along its path",
        "estimated fall of the surface, ± 2 standard deviations",
        "uncertainty of the normal",
    ]
    (low, high), (left, right) = figures[-1].axes[0].get_ylim(), figures[-1].axes[0].get_xlim()
    assert low < 0.0 < 5.0 < high
    assert left < 0.0 < 15.0 < right


def test_only_what_a_program_tells_is_drawn(recording: Recording, figures: list[Figure]) -> None:
    hidden = {FEED, SIGMA, *NORMALS}
    cycles = tuple(
        structs.replace(
            cycle,
            explanation={name: value for name, value in cycle.explanation.items() if name not in hidden},
        )
        for cycle in recording.cycles
    )
    assert draw_program(Recording(cycles, steps=recording.steps), 0.0) is not None
    assert len(figures[-1].axes) == 2, "the path and its scale"
    still = tuple(structs.replace(cycle, travel_commanded=0.0, across_commanded=0.0) for cycle in cycles)
    assert draw_program(Recording(still, steps=recording.steps), 0.0) is None


def test_the_picture_draws_the_wanted_force_of_each_sample_where_the_tool_presses(
    recording: Recording, figures: list[Figure]
) -> None:
    draw(recording, summarise(recording))
    (target,) = (line for line in figures[-1].axes[0].lines if line.get_label() == "target")
    drawn = np.asarray(target.get_ydata(), dtype=float).tolist()
    for cycle, force in zip(recording.cycles, drawn, strict=True):
        assert force == cycle.force_reference if cycle.phase == "track" else force != force
    texts = [text.get_text() for text in figures[-1].axes[0].texts]
    assert "2 track" in texts


def test_the_borders_of_too_many_steps_are_left_out() -> None:
    ax = Figure().add_subplot()
    many = [
        StepRecord(at=k + 1.0, step=k, label=f"1.1 (zero, pass {k})", began_at=float(k)) for k in range(201)
    ]
    mark_steps(ax, many, 0.0, named=True)
    assert not ax.lines
    mark_steps(ax, many[:10], 0.0, named=True)
    assert len(ax.lines) == 10
    assert {text.get_text() for text in ax.texts} == {"1.1"}, "there is no room for more"


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Every figure that is made."""
    made: list[Figure] = []
    begin = Figure.__init__

    def noted(figure: Figure, *arguments: object, **settings: object) -> None:
        begin(figure, *arguments, **settings)  # type: ignore[arg-type]
        made.append(figure)

    monkeypatch.setattr(Figure, "__init__", noted)
    return made
