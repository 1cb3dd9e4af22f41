"""Programs as files and on the command line: table, picture, separate file, and messages on errors."""

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
COMPLETE = "[task]\nsafe_height_mm = 3\n" + STEPS.replace("[[step", "[[task.step")
SHORT = '[[step]]\ndo = "approach"\n[[step]]\ndo = "hold"\nfor_s = 0.5\n[[step]]\ndo = "retract"\n'


def refusal_of(result: Result) -> str:
    """Return the message of a refusal, which must be one line."""
    code, _, errors = result
    assert code == 2, errors
    assert errors.startswith("hil-bridge: ")
    assert errors.count("\n") == 1
    return errors.removeprefix("hil-bridge: ").rstrip()


def test_task_table_contains_every_step_once(hil: Command) -> None:
    Path("whole.toml").write_text(COMPLETE)
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
    assert total.endswith("at most, including all passes")
    assert not list(Path().glob("*.png"))


def test_task_reports_time_of_all_passes() -> None:
    config = load_config(None, {"task.step": [{"do": "zero"}]})
    row = Setup(config).loop.program.row
    assert total_line(list_steps(config.task.step, row), row) == "about 2 s"
    assert (duration(119.4), duration(131.0)) == ("119 s", "2 min 11 s")


def test_task_picture_is_reproducible_and_never_overwrites(hil: Command) -> None:
    Path("whole.toml").write_text(COMPLETE)
    Path("steps.toml").write_text(STEPS)
    assert hil("config", "program", "whole.toml", "--output", "one.png")[1].endswith("wrote one.png\n")
    first = Path("one.png").read_bytes()
    assert first.startswith(b"\x89PNG")
    assert "--overwrite" in refusal_of(hil("config", "program", "whole.toml", "--output", "one.png"))
    assert hil("config", "program", "whole.toml", "--output", "one.png", "--overwrite")[0] == 0
    assert Path("one.png").read_bytes() == first
    assert hil("config", "program", "steps.toml", "--output", "two.png")[0] == 0


def test_task_picture_includes_unknown_position(hil: Command) -> None:
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
            "step 2 (hold): for_ms is not a setting; the unit is part of the name: for_s",
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
            "step 4.3 (track): path.length is not a setting; the unit",
        ),
        (
            STEPS.replace('"line"', '"lime"'),
            "step 4.3 (track): path.kind must be one of line, arc, polyline,",
        ),
        (STEPS.replace("[10, 12]", "[0, 12]"), "step 4.3 (track): force_n must ascend along the path"),
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
        ("[frame]\nfollow = 3\n" + SHORT, "frame.follow is not a setting"),
        ("frame = 3\n" + SHORT, "frame must be a table of settings, got 3"),
        ("step = []\n", "no steps: give each as a table [[step]]"),
    ],
)
def test_task_error_names_file_and_step(hil: Command, steps: str, message: str) -> None:
    Path("steps.toml").write_text(steps)
    for output in (
        refusal_of(hil("config", "program", "steps.toml")),
        refusal_of(hil("run", "--virtual", "--task", "steps.toml")),
    ):
        assert output.startswith(f"steps.toml: {message}"), output


def test_task_error_names_configuration(hil: Command) -> None:
    Path("whole.toml").write_text(COMPLETE.replace("times = 3", "times = 0"))
    assert refusal_of(hil("config", "program", "whole.toml")).startswith(
        "whole.toml: task.step 4 (repeat): times must be"
    )
    Path("whole.toml").write_text(COMPLETE.replace("[30, 8]", "[20, 8]"))
    assert refusal_of(hil("config", "program", "whole.toml")).startswith(
        "whole.toml: task.step 4.3 (track, pass 1): force_n"
    )


def test_task_shows_run_without_steps_as_program(hil: Command) -> None:
    Path("none.toml").write_text("[run]\nduration_s = 6.0\n[task]\nspeed_mm_s = 5.0\n")
    code, output, errors = hil("config", "program", "none.toml")
    assert (code, errors) == (0, "")
    text = [line.split()[:2] for line in output.splitlines()[1:4]]
    assert text == [["1", "approach"], ["2", "track"], ["3", "retract"]]
    assert "6 s at most" in output


@pytest.mark.parametrize("is_complete", [True, False])
def test_task_unreachable_path_is_refused_before_motion(hil: Command, is_complete: bool) -> None:
    far = (COMPLETE if is_complete else STEPS).replace("[0, 10]", "[0, 2500]")
    Path("far.toml").write_text(far)
    message = refusal_of(hil("config", "program", "far.toml"))
    assert message.startswith(
        f"far.toml: {'task.' * is_complete}step 4.1 (move, pass 1): the robot does not reach"
    ), message


def test_task_specified_twice_is_refused(hil: Command) -> None:
    Path("steps.toml").write_text("[frame]\ntravel = [1, 0, 0]\n" + SHORT)
    Path("both.toml").write_text(
        '[task]\nfile = "steps.toml"\n' + COMPLETE.removeprefix("[task]\nsafe_height_mm = 3\n")
    )
    message = "both.toml: both the steps [[task.step]] and the file steps.toml are given: remove one of them"
    assert refusal_of(hil("config", "program", "both.toml")) == message
    Path("other.toml").write_text("[frame]\ntravel = [0, 1, 0]\n")
    assert refusal_of(hil("run", "other.toml", "--virtual", "--task", "steps.toml")) == (
        "other.toml: frame.travel differs from that in steps.toml: remove one of them"
    )


def test_task_file_is_relative_to_configuration(tmp_path: Path) -> None:
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


def test_recording_contains_steps_of_task_file(hil: Command) -> None:
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


def test_resumed_run_keeps_program(hil: Command) -> None:
    message = refusal_of(hil("run", "--virtual", "--resume", "run.mcap", "--task", "steps.toml"))
    assert message.startswith(
        "--resume uses the configuration and program of the recording: leave others out"
    )


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
def test_task_invalid_value_is_described(hil: Command, name: str) -> None:
    right, wrong, message = WRONG[name]
    assert STEPS.count(right) == 1
    Path("steps.toml").write_text(STEPS.replace(right, wrong))
    assert refusal_of(hil("config", "program", "steps.toml")).startswith(f"steps.toml: {message}")


def test_task_repeat_without_steps_reports_syntax(hil: Command) -> None:
    Path("steps.toml").write_text('[[step]]\ndo = "repeat"\ntimes = 2\n' + SHORT)
    assert "step 1 (repeat): step is missing: its steps are tables" in refusal_of(
        hil("config", "program", "steps.toml")
    )


def test_run_names_file_of_invalid_step_order(hil: Command) -> None:
    twice = '[[step]]\ndo = "approach"\n' + SHORT
    Path("steps.toml").write_text(twice)
    Path("whole.toml").write_text(twice.replace("[[step", "[[task.step"))
    message = "step 2 (approach): the tool presses here"
    run = "run", "--virtual", "--no-record"
    assert refusal_of(hil(*run, "--task", "steps.toml")).startswith(f"steps.toml: {message}")
    assert refusal_of(hil(*run, "whole.toml")).startswith(f"whole.toml: task.{message}")


def test_steps_alone_are_not_a_configuration(hil: Command) -> None:
    Path("steps.toml").write_text(SHORT)
    message = refusal_of(hil("run", "--virtual", "--no-record", "steps.toml"))
    assert "steps in a configuration are [[task.step]]" in message
    assert "--task" in message


@pytest.mark.parametrize("robot", ["s3", "egm", "rtde"])
def test_task_retract_out_of_reach_is_refused(hil: Command, robot: str) -> None:
    Path("steps.toml").write_text(f"{SHORT}back_mm = 2000\n")
    message = refusal_of(hil("run", "--virtual", "--no-record", "--robot", robot, "--task", "steps.toml"))
    assert message.startswith("steps.toml: step 3 (retract): the robot does not reach 900 -100 2585 mm")


@pytest.mark.parametrize(
    ("height_mm", "message"),
    [(2500, "it leads to 0.900 -0.100 3.100 m"), (1500, "the robot does not reach 890 -100 2100 mm")],
)
def test_task_safe_height_out_of_reach_is_refused(hil: Command, height_mm: int, message: str) -> None:
    complete = COMPLETE.replace("safe_height_mm = 3", f"safe_height_mm = {height_mm}")
    Path("high.toml").write_text('[robot]\nemulated = "egm"\n' + complete)
    output = refusal_of(hil("run", "--virtual", "--no-record", "high.toml"))
    assert output.startswith(f"high.toml: task.step 4.1 (move, pass 1): {message}")


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
def test_identified_frame_of_slope_is_usable(hil: Command, robot: str) -> None:
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
    result = tomllib.loads(frame)["frame"]
    slope = math.radians(6)
    assert result["approach"] == pytest.approx([math.sin(slope), 0, -math.cos(slope)], abs=math.radians(0.5))
    assert result["travel"] == pytest.approx([math.cos(slope), 0, math.sin(slope)], abs=math.radians(0.5))
    assert result["origin_mm"] == pytest.approx([900, 0, 589.4], abs=0.2)
    Path("whole.toml").write_text(
        SHORT.replace("[[step", "[[task.step") + SLOPE.replace("[frame]\ntravel = [1, 0, 0]\n", frame)
    )
    assert hil("run", "whole.toml", "--virtual", "--robot", robot, "--no-record")[0] == 0


def test_identify_frame_ignores_configured_program(hil: Command) -> None:
    Path("steps.toml").write_text(SHORT)
    Path("slope.toml").write_text(SLOPE.replace("[task]\n", '[task]\nfile = "steps.toml"\n'))
    code, output, _ = hil("identify", "frame", "slope.toml", *PLACES, "--virtual")
    assert code == 0
    assert "touch 3 at" in output


@pytest.mark.parametrize("third", [("80", "0"), ("20", "4"), ("nan", "3")])
def test_identify_frame_refuses_collinear_points(hil: Command, third: tuple[str, str]) -> None:
    message = refusal_of(hil("identify", "frame", *PLACES[:6], "--place", *third, "--virtual"))
    assert "lie on one line" in message
    assert not Path("runs").exists()
