"""Steps from plug-ins: chosen by word, supervised by the guard, recorded, and named in errors when they fail."""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest
from click.testing import CliRunner

import hil_bridge
from hil_bridge.cli import cli, main
from hil_bridge.control.steps.settings import TaskSettings
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.record import read
from hil_bridge.record.analysis.why import tracebacks, why
from hil_bridge.runs.replay import recorded_config, replay
from hil_bridge.runs.resuming import describe_resume, resume_config
from hil_bridge.settings.configuration import dump, load_config, read_config

pytestmark = pytest.mark.sweep

EXAMPLE = Path(__file__).parents[2] / "examples" / "peg-step"
TASK = EXAMPLE / "insert-peg.toml"
OFFERED = """
[hil_bridge.steps]
insert = peg_step.insert:Insert
[hil_bridge.surfaces]
plate-with-hole = peg_step.plate:SURFACE
"""
Install = Callable[..., Path]
STEP = '''
from dataclasses import dataclass, field
from typing import Literal
from hil_bridge.control.steps.led import Lead, LedStep
from hil_bridge.control.steps.seam import NO_LIMITS, StepLimits
@dataclass(frozen=True, slots=True)
class S(LedStep):
    """Press."""
    do: Literal["mine"] = "mine"
    for_s: float = 2.0
    limits: StepLimits = NO_LIMITS
    def steer(self, memory, seen):
        {}
        return memory, Lead((0.0, 0.0))
'''
RUN = {
    "robot": {"emulated": "egm"},
    "task": {"retract_mm": 3.0, "step": [{"do": "approach"}, {"do": "mine"}, {"do": "retract"}]},
    "cell": {"start_position_mm": [900.0, -100.0, 590.5]},
}


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Put a distribution and its entry points on the import path; without code, that of the example."""
    before = set(sys.modules)

    def put(name: str, points: str, **modules: str) -> Path:
        folder = tmp_path / name
        info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(points)
        for module, code in modules.items():
            (folder / f"{module}.py").write_text(dedent(code))
        monkeypatch.syspath_prepend(str(folder if modules else EXAMPLE))
        monkeypatch.syspath_prepend(str(folder))
        return folder

    yield put
    for module in set(sys.modules) - before:
        if module.partition(".")[0] in ("peg_step", "own_step"):
            del sys.modules[module]


@pytest.fixture
def peg(install: Install) -> None:
    install("peg-step", OFFERED)


def mine(install: Install, line: str = "pass") -> None:
    install("mine", "[hil_bridge.steps]\nmine = own_step:S\n", own_step=STEP.replace("{}", line))


def command(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(cli, arguments)
    return result.exit_code, result.output


# --- the example


@pytest.mark.usefixtures("peg")
@pytest.mark.parametrize("robot", ["s3", "rtde"])
def test_example_step_runs_and_replays_identically(robot: str, tmp_path: Path) -> None:
    result = hil_bridge.simulate(load_config(TASK, {"robot.emulated": robot}))
    assert result.outcome == "completed", result.text
    record = read(result.save(tmp_path / "run.mcap"))
    reported = record.steps[1]
    assert (reported.label, reported.word, reported.name, reported.passed) == (
        "2 (insert)",
        "insert",
        "hole",
        True,
    )
    assert reported.text.startswith("in the hole, 6.")
    assert len(reported.found) == 3
    again = list(replay(record, recorded_config(record, {}), forced=False))
    assert len(again) == len(record.cycles) > 50
    assert not [cycle.differences for cycle in again if cycle.differences]
    assert json.loads(record.metadata["step_packages"]) == {"insert": "peg-step 1.0"}


@pytest.mark.usefixtures("peg")
def test_example_step_is_listed_and_drawn(tmp_path: Path) -> None:
    code, output = command("list", "plugins")
    assert code == 0
    assert "step     insert           peg-step 1.0  Press lightly, search for a hole on a spiral" in output
    code, output = command("config", "program", str(TASK), "-o", str(tmp_path / "peg.png"))
    assert code == 0, output
    assert "6 mm deep, searched within 5 mm with 4 N" in output
    assert (tmp_path / "peg.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("peg")
def test_step_settings_survive_recording() -> None:
    config = load_config(TASK, {"task.step.2.radius_mm": 3.0, "task.step.2.limits": {"force_limit_n": 30.0}})
    again = read_config(json.loads(dump(config)))
    assert again == config
    step: Any = again.task.step[1]
    assert (step.radius_mm, step.limits.force_limit_n) == (3.0, 30.0)
    assert TaskSettings(step=again.task.step).step == config.task.step


@pytest.mark.usefixtures("peg")
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "depth_mm = 6.0",
            "depth_mm = 6.0\nradus_mm = 3",
            "2 (insert): radus_mm is not a setting; did you mean radius_mm?",
        ),
        (
            "depth_mm = 6.0",
            "depth_m = 6.0",
            "2 (insert): depth_m is not a setting; the unit is part of the name: depth_mm",
        ),
        ("depth_mm = 6.0", "depth_mm = nan", "2 (insert): depth_mm must be a number above 0, got nan"),
        ("depth_mm = 6.0", "depth_mm = 1.0", "2 (insert): fallen_mm must be below depth_mm, 1, got 1.5"),
        ("depth_mm = 6.0", "", "2 (insert): depth_mm is missing"),
        (
            "depth_mm = 6.0",
            "depth_mm = 6.0\nsearch_n = 60",
            "2 (insert): search_n of 60 N must be below its force limit of 50 N",
        ),
        (
            "depth_mm = 6.0",
            "depth_mm = 6.0\nlimits.force_limt_n = 9",
            "2 (insert): limits.force_limt_n is not a setting; did",
        ),
        (
            '"insert"',
            '"inset"',
            "2: do must be one of approach, track, hold, seek, retract, move, zero, insert, repeat, got 'inset'",
        ),
    ],
)
def test_invalid_step_setting_names_step_number(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(TASK.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        hil_bridge.simulate(load_config(path, {}))
    text = str(refused.value)
    assert message in text, text
    assert "\n" not in text


@pytest.mark.usefixtures("peg")
def test_unknown_step_number_is_reported() -> None:
    with pytest.raises(
        ConfigError, match=r"--set task\.step\.9\.depth_mm: there is no '9'; give a number from 1 to 3"
    ):
        load_config(TASK, {"task.step.9.depth_mm": 3.0})


@pytest.mark.full
@pytest.mark.usefixtures("peg")
@pytest.mark.parametrize(("phase", "label"), [("approach", "1 (approach)"), ("track", "2 (insert)")])
def test_stopped_run_with_plugin_step_resumes(phase: str, label: str, tmp_path: Path) -> None:
    fault = {"on": "robot", "fault": "emergency-stop", "phase": phase, "after_s": 0.5}
    first = hil_bridge.simulate(load_config(TASK, {"robot.emulated": "egm"}), faults=[fault])
    assert first.outcome == "stopped"
    record = read(first.save(tmp_path / "first.mcap"))
    assert record.steps[-1].label == label
    config = resume_config(record, {})
    if label.startswith("2"):
        assert describe_resume(config) == (
            "resuming step 2 (insert) from its start; first a move, a zero and an approach"
        )
    again = hil_bridge.simulate(config)
    assert again.outcome == "completed", again.text
    assert next(step.text for step in again.steps if step.word == "insert").startswith("in the hole")


def test_missing_step_plugin_names_its_package(install: Install, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        mine(install)
        result = hil_bridge.simulate(RUN)
        record = read(result.save(tmp_path / "run.mcap"))
        patch.setattr(sys, "path", [each for each in sys.path if "/mine" not in each])
        with pytest.raises(ConfigError) as refused:
            recorded_config(record, {})
    assert str(refused.value) == (
        "the recording was made with the step 'mine', which is not installed here: install mine 1.0"
    )


# --- a step that fails


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero (mine 1.0, own_step.py:"),
        ("return memory, Lead((float('nan'), 0.0))", "it leads to nan m, nan m at a depth of "),
        ("return memory, Lead((0.0, float('nan')))", "it leads to nan m, nan m at a depth of "),
        (
            "return memory, Lead((0.0, 0.0), 60.0)",
            "ValueError: it asks for a force of 60 N; allowed: above 0 N an",
        ),
        ("return memory, Lead((0.0, 0.0), 0.0)", "it asks for a force of 0 N; allowed: above 0 N"),
        (
            "return None",
            "WrongAnswer: steer returns NoneType, not a state and a Lead (mine 1.0, own_step.py:",
        ),
        ("raise SystemExit(0)", "SystemExit: 0 (mine 1.0, own_step.py:"),
        ("return memory, Lead(None)", "TypeError: cannot unpack non-iterable NoneType object"),
        ("return memory, Lead((0.0, 0.0, 0.0))", "ValueError: too many values to unpack (expected 2)"),
    ],
)
def test_failing_step_retracts_and_names_package(line: str, message: str, install: Install) -> None:
    mine(install, line)
    result = hil_bridge.simulate(RUN)
    assert result.outcome == "stopped"
    assert result.cause is Cause.STEP_CODE
    assert result.text.startswith("step 2 (mine) failed: ")
    assert message in result.text
    assert "mine 1.0, own_step.py:" in result.text
    assert "\n" not in result.text
    assert result.left.startswith("retracted")
    assert max(result.arrays.truths.force[:, 2]) < 15.0
    assert "mine 1.0" in why(result.recording)
    assert all(trace.startswith("Traceback") for trace in tracebacks(result.recording))


AWAY = (
    STEP.partition("@dataclass")[0]
    + """
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.steps.seam import Step
@dataclass(frozen=True, slots=True)
class S(Step):
    '''Go somewhere.'''
    do: Literal["mine"] = "mine"
    limits: StepLimits = NO_LIMITS
    phase = Phase.MOVE
    presses = False
    def check(self, pressing, limits):
        pass
    def seconds(self, leg, begin):
        return 1.0
    def take(self, context, state):
        raise RuntimeError("lost")
"""
)


def test_step_failure_after_retraction_ends_run(install: Install) -> None:
    install("mine", "[hil_bridge.steps]\nmine = own_step:S\n", own_step=AWAY)
    steps = [{"do": "approach"}, {"do": "retract", "back_mm": 1.0}, {"do": "mine"}, {"do": "retract"}]
    result = hil_bridge.simulate({**RUN, "task": {"retract_mm": 3.0, "step": steps}})
    assert (result.outcome, result.cause) == ("stopped", Cause.STEP_CODE)
    assert result.text.startswith("step 3 (mine) failed: RuntimeError: lost (mine 1.0, own_step.py:")
    assert result.left.startswith("retracted")


def test_step_trouble_ends_run_with_its_text(install: Install) -> None:
    mine(
        install, r"return memory, Lead((0.0, 0.0), trouble='it is too cold\nand wet' if seen.s > 0.2 else '')"
    )
    result = hil_bridge.simulate(RUN)
    assert (result.cause, result.text) == (Cause.STEP_TROUBLE, "it is too cold, in step 2 (mine)")
    assert result.left.startswith("retracted")
    assert "workspace" not in why(result.recording)


def test_led_step_steers_in_its_last_sample(install: Install) -> None:
    mine(install, "return memory, Lead((0.0, 0.0), trouble='found nothing' if seen.last else '')")
    assert hil_bridge.simulate(RUN).text == "found nothing, in step 2 (mine)"


def test_led_step_ends_after_its_time(install: Install) -> None:
    mine(install)
    result = hil_bridge.simulate(RUN)
    assert result.outcome == "completed"
    step = result.steps[1]
    assert step.text == "ended after 2 s"
    assert step.at - step.began_at == pytest.approx(2.0, abs=0.05)


def test_step_trial_uses_half_the_desired_force(install: Install) -> None:
    mine(install, "assert seen.force == (seen.force_n / 2, 0.0, 0.0), seen.force")
    code, output = command("list", "plugins")
    assert code == 0
    assert "mine 1.0" in output
    assert "fails at its first sample" not in output


def test_failing_step_hook_names_step(
    install: Install, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code = STEP.replace("{}", "pass") + "    def seconds(self, leg, begin):\n        return {}['a']\n"
    install("mine", "[hil_bridge.steps]\nmine = own_step:S\n", own_step=code)
    (tmp_path / "c.toml").write_text(
        '[[task.step]]\ndo = "approach"\n[[task.step]]\ndo = "mine"\n[[task.step]]\ndo = "retract"\n'
    )
    monkeypatch.setattr(sys, "argv", ["hil-bridge", "config", "program", str(tmp_path / "c.toml")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "task.step 2 (mine): KeyError: 'a' (mine 1.0, own_step.py:" in line


# --- a package that is wrong


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("(LedStep)", "", "own_step:S is not a frozen dataclass that derives from Step"),
        ("frozen=True, ", "", "own_step:S is not a frozen dataclass that derives from Step"),
        (
            "@dataclass(frozen=True, slots=True)\n",
            "",
            "own_step:S is not a frozen dataclass that derives from Step",
        ),
        ('"mine"', '"other"', "must have the word 'mine' as the default of its field `do`"),
        (
            "for_s: float = 2.0",
            "for_s: float",
            "has no default for for_s, and uses a property of Step as one",
        ),
        ("for_s: float = 2.0", "of: type(seen) = None", "NameError: name 'seen' is not defined"),
        ("for_s: float = 2.0", "of: 'Hidden' = None", "has a setting that no file can contain: "),
        ("for_s: float = 2.0", "of: memoryview = None", "has a setting that no file can contain: Unable"),
        (
            "{}",
            "1 / 0",
            "it fails at its first sample: ZeroDivisionError: division by zero (mine 1.0, own_step.py:",
        ),
        ("{}", "return memory, Lead((float('inf'), 0.0))", "it leads to (inf, 0.0) m at its first sample"),
        ("{}", "return 3", "steer returns int, not a state and a Lead"),
        (
            "for_s: float = 2.0",
            "for_s: float = 2.0\n    def __post_init__(self): {}['a']",
            "made from its defaults: Key",
        ),
    ],
)
def test_list_plugins_reports_invalid_step_in_one_line(
    old: str, new: str, message: str, install: Install
) -> None:
    assert old in STEP
    code = STEP.replace(old, new).replace("{}\n        return", "pass\n        return")
    install("mine", "[hil_bridge.steps]\nmine = own_step:S\n", own_step=code)
    exit_code, output = command("list", "plugins")
    assert exit_code == 2, output
    (line,) = output.splitlines()
    assert line.startswith("step  mine  mine 1.0  WRONG: ")
    assert message in line


@pytest.mark.parametrize("word", ["hold", "repeat"])
def test_built_in_step_word_is_reserved(word: str, install: Install) -> None:
    install("mine", f"[hil_bridge.steps]\n{word} = own_step:S\n", own_step=STEP.replace("mine", word))
    exit_code, output = command("list", "plugins")
    assert exit_code == 2
    assert f"step '{word}' is built in, but mine 1.0 also provides one of that name" in output
