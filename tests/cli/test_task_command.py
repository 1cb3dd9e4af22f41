"""Programs as files and on the command line: the table, the picture, a file of its own, and what is wrong in words."""

import math
import tomllib
from pathlib import Path

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.record import read
from hil_bridge.runs.replay import changes_of, recorded_config
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import load_config
from hil_bridge.show.report.task_steps import duration, list_steps, total_line
from tests.command_line import Command, Result

pytestmark = pytest.mark.sweep

STEPS = """
[[step]]
do = "approach"
name = "corner"
at_most_mm = 12
[[step]]
do = "hold"
for_s = 0.5
[[step]]
do = "retract"
back_mm = 1
[[step]]
do = "repeat"
times = 3
until_removed_mm = 0.5
[[step.step]]
do = "move"
to_mm = [0, 10]
[[step.step]]
do = "approach"
[[step.step]]
do = "track"
path = { kind = "line", length_mm = 30 }
force_n = [[0, 5], [10, 12], [30, 8]]
speed_mm_s = 10
lateral_limit_n = 9
feed_error_n = 4
criterion = { within_n = 2, for_percent = 80 }
[[step.step]]
do = "retract"
limits = { travel_mm_s = 12 }
"""
WHOLE = "[task]\nsafe_height_mm = 3\n" + STEPS.replace("[[step", "[[task.step")
SHORT = '[[step]]\ndo = "approach"\n[[step]]\ndo = "hold"\nfor_s = 0.5\n[[step]]\ndo = "retract"\n'


def refused(result: Result) -> str:
    """The one line that a refusal is."""
    code, _, errors = result
    assert code == 2, errors
    assert errors.startswith("hil-bridge: ")
    assert errors.count("\n") == 1
    return errors.removeprefix("hil-bridge: ").rstrip()


def test_every_step_stands_in_the_table_once(hil: Command) -> None:
    Path("whole.toml").write_text(WHOLE)
    code, output, errors = hil("config", "program", "whole.toml")
    assert (code, errors) == (0, "")
    head, *all_lines, total = output.splitlines()
    assert head.split()[:2] == ["step", "word"]
    lines = [line for line in all_lines if not line.startswith(" ")]
    assert max(map(len, all_lines)) < 120
    assert [line.split()[:2] for line in lines] == [
        ["1", "approach"],
        ["2", "hold"],
        ["3", "retract"],
        ["4.1", "move"],
        ["4.2", "approach"],
        ["4.3", "track"],
        ["4.4", "retract"],
    ]
    assert '12 mm at most, contact at 1 N, named "corner"' in lines[0]
    assert "passes until 0.5 mm are removed" in lines[3]
    assert lines[3].split()[2] == "30.0", (
        "the way back from the end of the pass before, not that of the first pass"
    )
    assert lines[5].split()[2:8] == ["30.0", "5", "…", "12", "fixed", "3.0"]
    more = " ".join(" ".join(all_lines[all_lines.index(lines[5]) :]).split())
    assert "slower up to 9 N from the side, slower up to 4 N of error, within ±2 N for 80 %" in more
    assert "travel_mm_s 12" in lines[6]
    assert total.endswith("at most, with all passes")
    assert not list(Path().glob("*.png"))


def test_the_time_of_all_passes_is_told() -> None:
    config = load_config(None, {"task.step": [{"do": "zero"}]})
    row = Setup(config).loop.program.row
    assert total_line(list_steps(config.task.step, row), row) == "about 2 s"
    assert (duration(119.4), duration(131.0)) == ("119 s", "2 min 11 s")


def test_the_picture_is_drawn_the_same_again_and_never_over_a_file(hil: Command) -> None:
    Path("whole.toml").write_text(WHOLE)
    Path("steps.toml").write_text(STEPS)
    assert hil("config", "program", "whole.toml", "--output", "one.png")[1].endswith("wrote one.png\n")
    first = Path("one.png").read_bytes()
    assert first.startswith(b"\x89PNG")
    assert "--overwrite" in refused(hil("config", "program", "whole.toml", "--output", "one.png"))
    assert hil("config", "program", "whole.toml", "--output", "one.png", "--overwrite")[0] == 0
    assert Path("one.png").read_bytes() == first
    assert hil("config", "program", "steps.toml", "--output", "two.png")[0] == 0


def test_a_place_that_only_the_run_knows_is_drawn_too(hil: Command) -> None:
    steps = (
        "[frame]\norigin_mm = [900, 0, 600]\n"
        '[[step]]\ndo = "seek"\ndirection_deg = 90\n'
        '[[step]]\ndo = "approach"\n'
        '[[step]]\ndo = "track"\npath = { kind = "line", length_mm = 3 }\n[[step]]\ndo = "retract"\n'
    )
    Path("steps.toml").write_text(steps)
    assert hil("config", "program", "steps.toml", "--output", "picture.png")[0] == 0


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ('[[step]]\ndo = "hold"\nfor_s = 1\n', "step 1 (hold): the tool does not press here"),
        (SHORT.replace("for_s = 0.5", ""), "step 2 (hold): for_s is missing"),
        (
            SHORT.replace("for_s", "for_ms"),
            "step 2 (hold): for_ms is no setting; the unit is part of the name: for_s",
        ),
        (SHORT.replace("0.5", "-1"), "step 2 (hold): for_s must be a number above 0, got -1.0"),
        (
            SHORT.replace('"hold"', '"hodl"'),
            "step 2: do must be one of approach, track, hold, seek, retract, move,",
        ),
        (SHORT.replace('do = "hold"', ""), "step 2: do is missing: one of approach, track,"),
        (
            SHORT.replace("for_s = 0.5", "for_s = 1\nlimits = 3"),
            "step 2 (hold): limits must be a table of settings",
        ),
        ("step = [3]\n", "step 1 must be a table of settings, got 3"),
        ("step = 3\n", "step must be tables [[task.step]], got 3"),
        (
            STEPS.replace("length_mm = 30", "length = 30"),
            "step 4.3 (track): path.length is no setting; the unit",
        ),
        (
            STEPS.replace('"line"', '"lime"'),
            "step 4.3 (track): path.kind must be one of line, arc, polyline,",
        ),
        (STEPS.replace("[10, 12]", "[0, 12]"), "step 4.3 (track): force_n must ascend along the way"),
        (
            STEPS.replace("[10, 12]", "[10]"),
            "step 4.3 (track): force_n must be a force in N, or pairs of distance in mm",
        ),
        (
            STEPS.replace("[30, 8]", "[20, 8]"),
            "step 4.3 (track, pass 1): force_n ends at 20 mm, but the path is 30.0",
        ),
        (STEPS.replace("within_n = 2, ", ""), "step 4.3 (track): criterion.within_n is missing"),
        (
            STEPS.replace("for_percent = 80", "for_percent = 800"),
            "step 4.3 (track): criterion.for_percent must be at",
        ),
        (STEPS.replace("[0, 10]", "[0]"), "step 4.1 (move): to_mm: a value is missing, got [0]"),
        (STEPS.replace("times = 3", "times = 0"), "step 4 (repeat): times must be 1 … 1000, got 0"),
        ("[limits]\n" + SHORT, "unknown key limits: the file of a program holds only [[step]] and [frame]"),
        ("[frame]\nfollow = 3\n" + SHORT, "frame.follow is no setting"),
        ("frame = 3\n" + SHORT, "frame must be a table of settings, got 3"),
        ("step = []\n", "no steps: give each as a table [[step]]"),
    ],
)
def test_a_wrong_program_is_told_in_one_line_with_file_and_step(
    hil: Command, steps: str, message: str
) -> None:
    Path("steps.toml").write_text(steps)
    for said in (
        refused(hil("config", "program", "steps.toml")),
        refused(hil("run", "--virtual", "--task", "steps.toml")),
    ):
        assert said.startswith(f"steps.toml: {message}"), said


def test_steps_in_the_configuration_are_told_by_its_name(hil: Command) -> None:
    Path("whole.toml").write_text(WHOLE.replace("times = 3", "times = 0"))
    assert refused(hil("config", "program", "whole.toml")).startswith(
        "whole.toml: task.step 4 (repeat): times must be"
    )
    Path("whole.toml").write_text(WHOLE.replace("[30, 8]", "[20, 8]"))
    assert refused(hil("config", "program", "whole.toml")).startswith(
        "whole.toml: task.step 4.3 (track, pass 1): force_n"
    )


def test_a_run_without_steps_is_shown_as_the_program_that_it_is(hil: Command) -> None:
    Path("none.toml").write_text("[run]\nduration_s = 6.0\n[task]\nspeed_mm_s = 5.0\n")
    code, output, errors = hil("config", "program", "none.toml")
    assert (code, errors) == (0, "")
    words = [line.split()[:2] for line in output.splitlines()[1:4]]
    assert words == [["1", "approach"], ["2", "track"], ["3", "retract"]]
    assert "6 s at most" in output


@pytest.mark.parametrize("whole", [True, False])
def test_a_path_that_the_robot_does_not_reach_is_told_before_anything_moves(
    hil: Command, whole: bool
) -> None:
    far = (WHOLE if whole else STEPS).replace("[0, 10]", "[0, 2500]")
    Path("far.toml").write_text(far)
    said = refused(hil("config", "program", "far.toml"))
    assert said.startswith(f"far.toml: {'task.' * whole}step 4.1 (move, pass 1): the robot does not reach"), (
        said
    )


def test_a_program_stands_in_one_place(hil: Command) -> None:
    Path("steps.toml").write_text("[frame]\ntravel = [1, 0, 0]\n" + SHORT)
    Path("both.toml").write_text(
        '[task]\nfile = "steps.toml"\n' + WHOLE.removeprefix("[task]\nsafe_height_mm = 3\n")
    )
    message = (
        "both.toml: the steps [[task.step]] are given, and the file steps.toml too: leave one of them out"
    )
    assert refused(hil("config", "program", "both.toml")) == message
    Path("other.toml").write_text("[frame]\ntravel = [0, 1, 0]\n")
    assert refused(hil("run", "other.toml", "--virtual", "--task", "steps.toml")) == (
        "other.toml: frame.travel differs from that in steps.toml: leave one of them out"
    )


def test_a_file_is_looked_for_beside_the_configuration_that_names_it(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "steps.toml").write_text("[frame]\norigin_mm = [900, 0, 600]\n" + STEPS)
    (folder / "site.toml").write_text('[frame]\ntravel = [1, 0, 0]\n[task]\nfile = "steps.toml"\n')
    config = load_config(folder / "site.toml", {})
    assert [step.do for step in config.task.step] == ["approach", "hold", "retract", "repeat"]
    assert config.frame.origin_mm == (900.0, 0.0, 600.0)
    assert config.frame.travel == (1.0, 0.0, 0.0)
    (folder / "none.toml").write_text('[task]\nfile = "gone.toml"\n')
    with pytest.raises(ConfigError, match=r"cannot read .*gone.toml"):
        load_config(folder / "none.toml", {})


def test_the_record_holds_the_steps_of_a_file(hil: Command) -> None:
    Path("steps.toml").write_text(SHORT)
    code, _, errors = hil(
        *(
            "run",
            "--virtual",
            "--no-view",
            "--task",
            "steps.toml",
            "--record",
            "run.mcap",
            "--summary",
            "sum.json",
        )
    )
    assert (code, errors) == (0, "")
    Path("steps.toml").unlink()
    record = read(Path("run.mcap"))
    assert [step.do for step in recorded_config(record, {}).task.step] == ["approach", "hold", "retract"]
    assert [step.label for step in record.steps] == ["1 (approach)", "2 (hold)", "3 (retract)"]
    assert hil("replay", "run.mcap")[0] == 0
    Path("steps.toml").write_text(SHORT.replace("0.5", "0.25"))
    Path("change.toml").write_text('[task]\nfile = "steps.toml"\n')
    changed = recorded_config(record, changes_of(Path("change.toml"), None))
    assert changed.task.step[1].for_s == 0.25


def test_a_resumed_run_keeps_its_program(hil: Command) -> None:
    said = refused(hil("run", "--virtual", "--resume", "run.mcap", "--task", "steps.toml"))
    assert said.startswith("--resume uses the configuration and program of the recording: leave others out")


WRONG = {
    "path of a move": (
        "to_mm = [0, 10]",
        "to_mm = [0, 10, 5]",
        "step 4.1 (move): to_mm must be x and y, two numbers",
    ),
    "whole passes": ("times = 3", "times = 2.5", "step 4 (repeat): times must be a whole number, got 2.5"),
    "idle setting": (
        "lateral_limit_n = 9",
        "across_n = 5",
        'step 4.3 (track): across_n needs across = "force", now "position"',
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_value_is_told_in_words_of_the_program(hil: Command, name: str) -> None:
    right, wrong, message = WRONG[name]
    assert STEPS.count(right) == 1
    Path("steps.toml").write_text(STEPS.replace(right, wrong))
    assert refused(hil("config", "program", "steps.toml")).startswith(f"steps.toml: {message}")


def test_a_repeat_without_steps_says_how_its_steps_are_written(hil: Command) -> None:
    Path("steps.toml").write_text('[[step]]\ndo = "repeat"\ntimes = 2\n' + SHORT)
    assert "step 1 (repeat): step is missing: its steps are tables" in refused(
        hil("config", "program", "steps.toml")
    )


def test_a_run_names_the_file_of_a_step_that_cannot_follow(hil: Command) -> None:
    twice = '[[step]]\ndo = "approach"\n' + SHORT
    Path("steps.toml").write_text(twice)
    Path("whole.toml").write_text(twice.replace("[[step", "[[task.step"))
    told = "step 2 (approach): the tool presses here"
    run = "run", "--virtual", "--no-record"
    assert refused(hil(*run, "--task", "steps.toml")).startswith(f"steps.toml: {told}")
    assert refused(hil(*run, "whole.toml")).startswith(f"whole.toml: task.{told}")


def test_steps_that_stand_alone_are_no_configuration(hil: Command) -> None:
    Path("steps.toml").write_text(SHORT)
    told = refused(hil("run", "--virtual", "--no-record", "steps.toml"))
    assert "steps in a configuration are [[task.step]]" in told
    assert "--task" in told


@pytest.mark.parametrize("robot", ["s3", "egm", "rtde"])
def test_a_retract_out_of_reach_is_refused(hil: Command, robot: str) -> None:
    Path("steps.toml").write_text(f"{SHORT}back_mm = 2000\n")
    told = refused(hil("run", "--virtual", "--no-record", "--robot", robot, "--task", "steps.toml"))
    assert told.startswith("steps.toml: step 3 (retract): the robot does not reach 900 -100 2585 mm")


@pytest.mark.parametrize(
    ("height_mm", "message"),
    [(2500, "it leads to 0.900 -0.100 3.100 m"), (1500, "the robot does not reach 890 -100 2100 mm")],
)
def test_a_safe_height_out_of_reach_is_refused(hil: Command, height_mm: int, message: str) -> None:
    whole = WHOLE.replace("safe_height_mm = 3", f"safe_height_mm = {height_mm}")
    Path("high.toml").write_text('[robot]\nemulated = "egm"\n' + whole)
    told = refused(hil("run", "--virtual", "--no-record", "high.toml"))
    assert told.startswith(f"high.toml: task.step 4.1 (move, pass 1): {message}")


SLOPE = """
[frame]
travel = [1, 0, 0]
[task]
approach_depth_limit_mm = 20.0
[cell]
start_position_mm = [900, 0, 596]
[cell.surface]
kind = "sloped"
slope_deg = 6
path_deg = 0
"""
PLACES = "--place", "0", "0", "--place", "40", "0", "--place", "0", "30"


@pytest.mark.parametrize("robot", ["s3", "egm"])
def test_the_frame_of_a_slope_is_found_and_a_program_in_it_runs(hil: Command, robot: str) -> None:
    Path("slope.toml").write_text(SLOPE)
    command = (
        "identify",
        "frame",
        "slope.toml",
        *PLACES,
        "--virtual",
        "--robot",
        robot,
        "--output",
        "frame.toml",
    )
    code, output, errors = hil(*command)
    assert (code, errors) == (0, "")
    frame = Path("frame.toml").read_text()
    assert f"{frame}wrote frame.toml\n" in output
    found = tomllib.loads(frame)["frame"]
    slope = math.radians(6)
    assert found["approach"] == pytest.approx([math.sin(slope), 0, -math.cos(slope)], abs=math.radians(0.5))
    assert found["travel"] == pytest.approx([math.cos(slope), 0, math.sin(slope)], abs=math.radians(0.5))
    assert found["origin_mm"] == pytest.approx([900, 0, 589.4], abs=0.2)
    Path("whole.toml").write_text(
        SHORT.replace("[[step", "[[task.step") + SLOPE.replace("[frame]\ntravel = [1, 0, 0]\n", frame)
    )
    assert hil("run", "whole.toml", "--virtual", "--robot", robot, "--no-record")[0] == 0


def test_a_program_of_the_configuration_does_not_keep_from_teaching(hil: Command) -> None:
    Path("steps.toml").write_text(SHORT)
    Path("slope.toml").write_text(SLOPE.replace("[task]\n", '[task]\nfile = "steps.toml"\n'))
    code, output, _ = hil("identify", "frame", "slope.toml", *PLACES, "--virtual")
    assert code == 0
    assert "touch 3 at" in output


@pytest.mark.parametrize("third", [("80", "0"), ("20", "4"), ("nan", "3")])
def test_places_on_one_line_are_refused_before_the_touch(hil: Command, third: tuple[str, str]) -> None:
    told = refused(hil("identify", "frame", *PLACES[:6], "--place", *third, "--virtual"))
    assert "lie on one line" in told
    assert not Path("runs").exists()
