"""Failing plug-in code: each run ends as by the guard, names package and location, and is recorded."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import hil_bridge
from hil_bridge.cli import main
from hil_bridge.record.analysis.why import tracebacks, why

pytestmark = pytest.mark.sweep

EXAMPLES = Path(__file__).parents[2] / "examples"
TOYS = ("toy-robot", "toy-sensor", "toy-surface")
POINTS = """
[hil_bridge.controllers]
failing = failing_toys:Law
[hil_bridge.robots]
failarm = failing_toys:ROBOT
[hil_bridge.sensors]
failload = failing_toys:SENSOR
[hil_bridge.surfaces]
failspring = failing_toys:SURFACE
"""
SITE = """
[run]
period_ms = 20
duration_s = 1
[robot]
emulated = "failarm"
[sensor]
emulated = "failload"
[controller]
name = "failing"
sample_ms = 20
[cell]
surface_kind = "failspring"
start_position_mm = [900, -100, 592]
[task]
retract_mm = 4.0
[limits]
retract_patience_s = 0.5
"""
PACKAGE = "failing-toys 2.0, failing_toys.py:"


@pytest.fixture
def fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """Install the failing toys as a package. The tests select the part that fails."""
    info = tmp_path / "failing_toys-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: failing-toys\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text(POINTS)
    source = Path(__file__).with_name("failing_toys.py").read_text(encoding="utf-8")
    (tmp_path / "failing_toys.py").write_text(source, encoding="utf-8")
    (tmp_path / "site.toml").write_text(SITE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for folder in (*(EXAMPLES / toy for toy in TOYS), tmp_path):
        monkeypatch.syspath_prepend(str(folder))
    import failing_toys

    yield failing_toys.FAILS
    modules = {"failing_toys", *(toy.replace("-", "_") for toy in TOYS)}
    for name in [name for name in sys.modules if name.partition(".")[0] in modules]:
        del sys.modules[name]


def run_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *options: str
) -> tuple[int, str]:
    """Return exit code and output of a run by the command line."""
    monkeypatch.setattr(sys, "argv", ["hil-bridge", "run", "site.toml", "--virtual", "--no-view", *options])
    ended: list[Any] = []
    monkeypatch.setattr("hil_bridge.cli.leave", ended.append)
    main()
    captured = capsys.readouterr()
    return int(ended[0] or 0), captured.err + captured.out


CASES = [
    ("law", "raise", 40, "controller failing failed: ValueError: it is broken (", "retracted"),
    ("law", "exit", 40, "controller failing failed: SystemExit: 0 (", "retracted"),
    ("law", "keyboard", 40, "controller failing failed: KeyboardInterrupt (", "retracted"),
    (
        "law",
        "nothing",
        40,
        "controller failing failed: TypeError: step returned NoneType, not a state",
        "retracted",
    ),
    ("law", "nan", 40, "controller failing failed: it commands nan m (", "retracted"),
    ("law", "own", 40, "controller failing failed: PluginExit: unrecoverable (", "retracted"),
    ("law", "generator", 40, "controller failing failed: GeneratorExit (", "retracted"),
    ("law", "cancelled", 40, "controller failing failed: CancelledError (", "retracted"),
    ("arm-client", "own", 600, "robot link udp+memory:toyarm stopped: PluginExit: unrecoverable (", "NOT"),
    ("load-client", "generator", 1300, "force sensor udp+memory:toyload stopped: GeneratorExit (", "NOT"),
    ("link", "own", 100, "robot link udp+memory:toyarm stopped: PluginExit: unrecoverable (", "NOT"),
    ("link", "generator", 100, "robot link udp+memory:toyarm stopped: GeneratorExit (", "NOT"),
    ("link", "cancelled", 100, "robot link udp+memory:toyarm stopped: CancelledError (", "NOT"),
    ("arm", "own", 600, "the emulated cell failed: PluginExit: unrecoverable (", "NOT"),
    ("spring", "own", 200, "the emulated cell failed: PluginExit: unrecoverable (", "NOT"),
    ("spring", "cancelled", 200, "the emulated cell failed: CancelledError (", "NOT"),
    ("arm-client", "raise", 600, "robot link udp+memory:toyarm stopped: ValueError: it is broken (", "NOT"),
    ("arm-client", "exit", 600, "robot link udp+memory:toyarm stopped: SystemExit: 0 (", "NOT"),
    ("load-client", "raise", 1300, "force sensor udp+memory:toyload stopped: ValueError: it is", "NOT"),
    ("load-client", "keyboard", 1300, "force sensor udp+memory:toyload stopped: KeyboardInterrupt (", "NOT"),
    ("link", "raise", 100, "robot link udp+memory:toyarm stopped: ValueError: it is broken (", "NOT"),
    ("link", "exit", 100, "robot link udp+memory:toyarm stopped: SystemExit: 0 (", "NOT"),
    ("link", "keyboard", 100, "robot link udp+memory:toyarm stopped: KeyboardInterrupt (", "NOT"),
    ("arm", "raise", 600, "the emulated cell failed: ValueError: it is broken (", "NOT"),
    ("load", "raise", 1300, "the emulated cell failed: ValueError: it is broken (", "NOT"),
    ("load", "exit", 1300, "the emulated cell failed: SystemExit: 0 (", "NOT"),
    ("spring", "raise", 200, "the emulated cell failed: ValueError: it is broken (", "NOT"),
    (
        "spring",
        "nan",
        200,
        "the emulated cell failed: InvalidForce: the surface returned [nan, nan, nan] N",
        "NOT",
    ),
    (
        "spring",
        "nothing",
        200,
        "the emulated cell failed: InvalidForce: the surface returned NoneType",
        "NOT",
    ),
    ("spring", "shape", 200, "the emulated cell failed: InvalidForce: the surface returned shape (", "NOT"),
]


@pytest.mark.parametrize(("part", "failure", "after", "cause", "left"), CASES)
def test_plugin_failure_ends_run_and_is_recorded(
    fails: dict[str, Any], part: str, failure: str, after: int, cause: str, left: str
) -> None:
    fails.update(part=part, how=failure, after=after)
    result = hil_bridge.simulate("site.toml", seed=7)
    assert result.outcome == "stopped"
    assert result.text.startswith(cause)
    if cause.startswith("the emulated cell failed"):
        assert result.cause is hil_bridge.Cause.CELL_FAILED
    assert PACKAGE in result.text
    assert "\n" not in result.text
    assert result.left.startswith(left)
    if left == "NOT":  # the text states nothing that is no longer known
        assert "unknown" in result.left
    assert max(result.arrays.truths.force[:, 2]) < 15.0
    traces = tracebacks(result.recording)
    assert bool(traces) == (failure != "nan" or part == "spring")
    assert all(text.startswith("Traceback") for text in traces)
    assert PACKAGE in why(result.recording)


ENDS = [
    ("law", "own", 40, 3, "controller failing failed: PluginExit: unrecoverable (", "left: retracted, "),
    ("law", "callback", 40, 3, "plug-in code ended the run: SystemExit: 1 (", "left: retracted, "),
    ("law", "cancels", 40, 3, "the run was cancelled", "left: retracted, "),
    ("link", "own", 1, 3, "robot link udp+memory:toyarm stopped: PluginExit: unrecoverable (", ""),
    ("link", "callback", 1, 3, "plug-in code ended the run: SystemExit: 1 (", ""),
    ("link", "cancels", 1, 3, "the run was cancelled before the movement began", ""),
    ("link", "generator", 20, 3, "robot link udp+memory:toyarm stopped: GeneratorExit (", "left: "),
    (
        "link-close",
        "own",
        1,
        3,
        "robot link udp+memory:toyarm stopped: PluginExit: unrecoverable (",
        "left: retr",
    ),
    ("connect", "own", 1, 2, "plug-in code failed: PluginExit: unrecoverable (", ""),
    ("make", "generator", 1, 2, "plug-in code failed: GeneratorExit (", ""),
]


@pytest.mark.parametrize(("part", "failure", "after", "code", "cause", "left"), ENDS)
def test_plugin_exception_ends_command_in_order(
    fails: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    part: str,
    failure: str,
    after: int,
    code: int,
    cause: str,
    left: str,
) -> None:
    fails.update(part=part, how=failure, after=after)
    ended, text = run_command(monkeypatch, capsys, "--no-record")
    assert ended == code, text
    assert cause in text.splitlines()[0]
    assert "Traceback" not in text
    assert text.splitlines()[-1].startswith(left), text


ARM = "hil-bridge: stopped: robot link udp+memory:toyarm stopped: "
BEFORE = "hil-bridge: robot link udp+memory:toyarm stopped: "
OTHERS = "hil-bridge: plug-in code failed: "
ATTACKS = [
    ("connect", "nothing", 1, 2, f"{OTHERS}WrongAnswer: connect returns NoneType, not a robot link", ""),
    ("connect-load", "nothing", 1, 2, f"{OTHERS}WrongAnswer: connect returns NoneType, not a wire and", ""),
    ("Law.__init__", "raise", 1, 2, "hil-bridge: controller failing: it is broken (", ""),
    ("Arm.__init__", "raise", 1, 2, "hil-bridge: cell: it is broken (", ""),
    ("Link.ready", "nothing", 1, 3, f"{BEFORE}WrongAnswer: ready returns NoneType, not a RobotReport (", ""),
    ("Link.report", "nan", 100, 3, f"{ARM}WrongAnswer: report returns float, not a RobotReport (", "left: "),
    ("Link.enter", "group", 1, 3, f"{ARM}BaseExceptionGroup: two at once (2 sub-exceptions) (", ""),
    ("Link.leave", "keyboard", 1, 3, f"{ARM}KeyboardInterrupt (", "left: retracted, "),
    (
        "Motion.to",
        "nothing",
        40,
        3,
        f"{ARM}WrongAnswer: to returns NoneType, not a Sent (",
        "left: NOT retracted",
    ),
    (
        "Motion.to",
        "group",
        40,
        3,
        f"{ARM}BaseExceptionGroup: two at once (2 sub-exceptions) (",
        "left: NOT retracted",
    ),
    ("Motion.ordered", "raise", 1, 3, f"{ARM}ValueError: it is broken (", "left: "),
    (
        "ArmClient.data_to_send",
        "nothing",
        600,
        3,
        f"{ARM}TypeError: object of type 'NoneType' has no len() (",
        "",
    ),
    ("LoadClient.data_to_send", "nan", 1300, 3, "object of type 'float' has no len() (", "left: "),
    (
        "Arm.data_to_send",
        "nothing",
        600,
        3,
        "the emulated cell failed: TypeError: object of type 'NoneType'",
        "",
    ),
    (
        "ArmClient.next_deadline",
        "past",
        600,
        3,
        f"{ARM}PastDeadline: FailingArmClient.next_deadline stays at 0.000000 s, and now is 79",
        "left: ",
    ),
    (
        "LoadClient.next_deadline",
        "past",
        1300,
        3,
        "udp+memory:toyload stopped: PastDeadline: FailingLoadClient.next_deadline stays at 0.000000 s",
        "left: ",
    ),
    (
        "Arm.next_deadline",
        "past",
        600,
        3,
        "the emulated cell failed: PastDeadline: FailingArm.next_deadline stays at 0.000000 s, and now is",
        "left: ",
    ),
    (
        "Law.step",
        "group",
        40,
        3,
        "controller failing failed: BaseExceptionGroup: two at once",
        "left: retracted, ",
    ),
]


@pytest.mark.parametrize(("part", "failure", "after", "code", "cause", "left"), ATTACKS)
def test_plugin_invalid_return_value_names_package(
    fails: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    part: str,
    failure: str,
    after: int,
    code: int,
    cause: str,
    left: str,
) -> None:
    fails.update(part=part, how=failure, after=after)
    ended, text = run_command(monkeypatch, capsys, "--no-record")
    assert ended == code, text
    assert cause in text.splitlines()[0]
    assert "failing-toys 2.0" in text.splitlines()[0]
    assert "Traceback" not in text
    assert "bug" not in text.replace("--debug", "")
    assert text.splitlines()[-1].startswith(left), text


def test_plugin_without_failure_completes(fails: dict[str, Any]) -> None:
    result = hil_bridge.simulate("site.toml", seed=7)
    assert result.outcome == "completed", result.text
    assert not tracebacks(result.recording)


def test_plugin_failure_prints_traceback_on_request(
    fails: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fails.update(part="law", how="raise", after=40)
    code, output = run_command(monkeypatch, capsys)
    assert code == 3
    (line,) = [line for line in output.splitlines() if "broken" in line]
    assert line.startswith("hil-bridge: stopped: controller failing failed: ValueError: it is broken (")
    assert line.endswith("); --debug shows the traceback")
    fails.update(after=0)
    code, output = run_command(monkeypatch, capsys, "--debug")
    assert code == 3
    assert "Traceback (most recent call last)" in output
    assert 'raise RAISES[FAILS["how"]]' in output


@pytest.mark.parametrize("part", ["connect", "make"])
@pytest.mark.parametrize("failure", ["raise", "exit"])
def test_plugin_failure_before_run_exits_with_code_2(
    fails: dict[str, Any],
    part: str,
    failure: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fails.update(part=part, how=failure)
    code, output = run_command(monkeypatch, capsys)
    assert code == 2
    (line,) = [line for line in output.splitlines() if line.startswith("hil-bridge:")]
    assert line.startswith("hil-bridge: plug-in code failed: ")
    assert PACKAGE in line
    assert "Traceback" not in output
