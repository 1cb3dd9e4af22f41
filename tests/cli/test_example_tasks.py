"""The example programs: each runs in virtual time, meets its criteria, is replayed identically, and can be drawn."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import pytest

import hil_bridge.cli
from hil_bridge.record import read
from hil_bridge.settings.configuration import load_config
from tests.command_line import Command

pytestmark = pytest.mark.sweep

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "tasks"
NAMES = ("deburr-edge", "polish-dome", "press-and-feel")

Recorded: TypeAlias = Callable[..., Path]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Return the recording of an example that was completed on the emulated cell."""
    folder = tmp_path_factory.mktemp("examples")

    def record(name: str, robot: str = "s3") -> Path:
        path = folder / f"{name}-{robot}.mcap"
        if not path.exists():
            options = ["--robot", robot, "--virtual", "--no-view", "--record", str(path)]
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sys, "argv", ["hil-bridge", "run", str(FOLDER / f"{name}.toml"), *options])
                with pytest.raises(SystemExit) as ended:
                    hil_bridge.cli.main()
            assert not ended.value.code
        return path

    return record


def test_example_tasks_are_three() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.toml")) == sorted(NAMES)


@pytest.mark.parametrize(("name", "robot"), [*((name, "s3") for name in NAMES), ("deburr-edge", "egm")])
def test_example_task_meets_its_criteria(recorded: Recorded, name: str, robot: str) -> None:
    record = read(recorded(name, robot))
    assert record.end["outcome"] == "completed"
    assert all(step.passed for step in record.steps)
    judged = [step for step in record.steps if step.within is not None]
    assert judged
    assert all(step.within >= step.wanted for step in judged if step.within and step.wanted)
    assert record.steps[-1].label.partition(" ")[2].startswith("(retract")


@pytest.mark.full
def test_example_dome_is_polished_to_target_removal(recorded: Recorded) -> None:
    """The step is completed after more than one pass, and before the last one."""
    steps = read(recorded("polish-dome")).steps
    passes = sum(step.label.startswith("1.4 (track") for step in steps)
    assert 2 <= passes <= 3
    assert steps[-1].text.endswith("mm removed")
    assert 0.15 <= float(steps[-1].text.split()[0]) < 0.3


def test_example_step_face_is_detected_and_pressed(recorded: Recorded) -> None:
    """The face is 12 mm from the start and yields by 0.2 mm per newton."""
    record = read(recorded("deburr-edge"))
    (result,) = [step.found for step in record.steps if step.name == "face"]
    assert result[1] == pytest.approx(0.0125, abs=0.4e-3)
    stroke = [cycle for cycle in record.cycles if cycle.step == 3]
    second_half = stroke[len(stroke) // 2 :]
    pressed = sum(cycle.sample.position[1] for cycle in second_half) / len(second_half) - 0.012
    assert pressed * 5000.0 == pytest.approx(4.0, abs=0.5)


@pytest.mark.full
def test_example_flat_tool_aligns_with_panel(recorded: Recorded) -> None:
    """The tool was tilted by 3°, and an S3 rotates in steps of a fifth of a degree."""
    record = read(recorded("press-and-feel"))
    names = [step.name for step in record.steps if step.name]
    assert names == ["near left", "near right", "pressed near right", "far"]
    for step in (2, 6):
        last = [cycle for cycle in record.cycles if cycle.step == step][-1]
        _, x, y, _ = last.sample.quaternion
        w, z = last.sample.quaternion[0], last.sample.quaternion[3]
        assert 1.0 - 2.0 * (w * w + z * z) == pytest.approx(1.0, abs=4e-5), "within half a degree"
        assert x * x + y * y > 0.99


@pytest.mark.parametrize("name", NAMES)
def test_example_task_replay_is_identical(recorded: Recorded, hil: Command, name: str) -> None:
    code, output, _ = hil("replay", recorded(name))
    assert (code, output.strip().rpartition(", ")[2]) == (0, "every command identical")


@pytest.mark.parametrize("name", NAMES)
def test_example_task_is_displayed(hil: Command, tmp_path: Path, name: str) -> None:
    picture = tmp_path / "picture.png"
    code, output, _ = hil("config", "program", FOLDER / f"{name}.toml", "--output", picture)
    assert code == 0
    *lines, total, wrote = output.splitlines()
    assert (total.split(":")[0], wrote) == ("total", f"wrote {picture}")
    steps = load_config(FOLDER / f"{name}.toml", {}).task.step
    assert sum(line[0] != " " for line in lines) - 1 == sum(
        len(step.step) if step.do == "repeat" else 1 for step in steps
    )
    assert picture.stat().st_size > 10_000
