"""List of unexercised items: made from evidence, with reasoned exceptions, and a gate."""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from hil_bridge.errors import BridgeError, Cause
from hil_bridge.lab.campaign.criteria import Figure, find_unmet
from hil_bridge.lab.campaign.judging import carry_out
from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.working import missing
from hil_bridge.lab.invariants import Promise
from tools import exercised
from tools.exercised import (
    CONDITIONS,
    FAULTS,
    GROUPS,
    PHASED,
    REACTIONS,
    TARGETS,
    Balance,
    Evidence,
    balance,
    of_campaign,
    of_tests,
)
from tools.faults_doc import Job

pytestmark = pytest.mark.full

ROOT = Path(__file__).resolve().parents[2]
PLAN = """
[campaign]
name = "an emergency stop"
seeds = { from = 1, to = 1 }
without_fault = false

[[campaign.fault]]
on = "robot"
fault = "emergency-stop"
phase = ["track"]

[campaign.criteria]
outcome = ["completed"]

[config.run]
duration_s = 1.0
[config.cell]
start_position_mm = [900.0, -100.0, 591.0]
"""


def everything(without: Sequence[str] = ()) -> Balance:
    names = exercised.all_names()
    kept = (
        Evidence(group, name, "a test") for group, of in names.items() for name in of if name not in without
    )
    return balance(kept)


def test_unexercised_items_are_listed() -> None:
    assert list(everything().troubles({})) == []
    left = everything(["wall", "egm: robot: emergency-stop"])
    assert list(left.troubles({})) == [
        "never exercised, of the conditions: wall",
        "never exercised, of the faults: egm: robot: emergency-stop",
    ]
    assert list(left.troubles({"wall": "no wall is emulated"})) == [
        "never exercised, of the faults: egm: robot: emergency-stop"
    ]
    lines = list(exercised.describe(left, {"wall": "no wall is emulated"}))
    assert f"conditions: {len(Cause) - 1} of {len(Cause)} exercised" in lines
    assert "  never: wall – no wall is emulated" in lines


def test_exercised_exception_is_an_error() -> None:
    assert list(everything().troubles({"wall": "no wall is emulated"})) == [
        "an exception that has been exercised: wall"
    ]
    assert list(everything().troubles({"wal": "misspelt"})) == ["an exception that there is not: wal"]


def test_exceptions_exist_and_have_a_reason() -> None:
    names = {name for of in exercised.all_names().values() for name in of}
    for name, reason in exercised.EXCEPTIONS.items():
        assert name in names
        assert len(reason.split()) > 3


def test_run_rejected_by_model_is_an_error() -> None:
    result = Balance(everything().all_names, everything().exercised, ("tests/a.py::test_b: cycle 3",))
    assert list(result.troubles({})) == ["the model of the guard does not accept tests/a.py::test_b: cycle 3"]


def test_reaction_is_exercised_by_its_conditions() -> None:
    result = balance([Evidence(CONDITIONS, "force", "a test")])
    assert result.exercised[REACTIONS] == {"retracts and ends": "force: a test"}
    assert set(result.never(REACTIONS)) == set(result.all_names[REACTIONS]) - {"retracts and ends"}


def test_pytest_plugin_writes_exercised_items(tmp_path: Path) -> None:
    """In two processes, as the check does."""
    test = "tests/guard/test_causes_reached.py"
    chosen = [
        f"{test}::test_run_ends_for_its_cause[sensor-failed]",
        f"{test}::test_late_frame_holds_inward_motion",
    ]
    path = tmp_path / "exercised.json"
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-p",
        "tools.exercising",
        "-n",
        "2",
    ]
    done = subprocess.run(
        [*command, "--exercised", path, *chosen], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    data = json.loads(path.read_text())
    assert data["causes"] == {"overdue": chosen[1], "sensor-failed": chosen[0]}
    assert data["faults"] == {"jr3: sensor-wire: off": chosen[0]}
    assert data["promises"] == data["criteria"] == data["unaccepted"] == {}
    assert {(one.group, one.name) for one in of_tests(path)} == {
        (CONDITIONS, "overdue"),
        (CONDITIONS, "sensor-failed"),
        (FAULTS, "jr3: sensor-wire: off"),
    }


def test_campaign_reports_exercised_items(tmp_path: Path) -> None:
    (tmp_path / "stop.toml").write_text(PLAN)
    plan, path = read_plan(tmp_path / "stop.toml"), tmp_path / "stop.sqlite"
    with Store.begin(path, plan) as store:
        store.put([carry_out(job, plan.criteria, None) for job in missing(plan, store)], plan.cases)
    result = {(one.group, one.name): one.where for one in of_campaign(path)}
    assert result[FAULTS, "s3: robot: emergency-stop"] == "seed 1 of stop.sqlite"
    assert (CONDITIONS, "robot-state") in result or (CONDITIONS, "refused-order") in result


def test_unexercised_fault_gets_a_run() -> None:
    name, phase, broken = exercised.strike(Job("egm", "robot", "emergency-stop"))
    assert (name, phase, json.loads(broken)) == ("egm: robot: emergency-stop", "track", "")


@pytest.mark.parametrize("text", [None, "{", "[]"])
def test_invalid_evidence_is_one_line_error(text: str | None, tmp_path: Path) -> None:
    path = tmp_path / "exercised.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(BridgeError) as refused:
        list(of_tests(path))
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_all_exercisable_items_are_counted() -> None:
    names = exercised.all_names()
    assert tuple(names) == GROUPS
    assert len(names[FAULTS]) == len(set(names[FAULTS])) > 250
    assert names[GROUPS[3]] == [str(promise) for promise in Promise]
    assert names[GROUPS[4]] == ["outcome", "promises_broken", "retracted"]


def test_each_campaign_criterion_can_fail() -> None:
    criteria = read_plan(exercised.PLAN, (1,)).criteria
    well: dict[str, Figure] = {"outcome": "completed", "promises_broken": 0, "retracted": True}
    assert find_unmet(criteria, well) == []
    for figure, wrong in (("outcome", "interrupted"), ("promises_broken", 1), ("retracted", False)):
        (text,) = find_unmet(criteria, {**well, figure: wrong})
        assert text.startswith(figure)


def test_campaign_matrix_has_no_empty_cell() -> None:
    """Faults by phase, each target with each robot and sensor; what is left has a reason."""
    drawn = balance(exercised.of_plan(exercised.PLAN))
    left = [name for group in (PHASED, TARGETS) for name in drawn.never(group)]
    assert [name for name in left if name not in exercised.EXCEPTIONS] == []
    matrix = {name for group in (PHASED, TARGETS) for name in drawn.all_names[group]}
    assert [name for name in exercised.EXCEPTIONS if name in matrix and name not in left] == []
    assert {one.name for one in exercised.of_plan(exercised.PLAN)} <= matrix


def test_unreached_phase_is_listed(tmp_path: Path) -> None:
    text = exercised.PLAN.read_text(encoding="utf-8").replace(', "seek", "zero"]', ', "zero"]')
    others = ('label = "s3"', 'label = "rsi"', 'label = "rtde"', "boot_s", "board", 'label = "ati-can"')
    path = tmp_path / "guard.toml"
    path.write_text(
        "\n".join(line for line in text.splitlines() if not any(other in line for other in others)),
        encoding="utf-8",
    )
    left = balance(exercised.of_plan(path)).never(PHASED)
    assert "egm: robot: emergency-stop in seek" in left
    assert "egm: robot: emergency-stop in zero" not in left
