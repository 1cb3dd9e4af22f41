"""Table of causes: each cause has one row with existing settings, a part and a remedy, and is reached."""

import ast
import dataclasses
import itertools
import operator
from pathlib import Path

import pytest

from hil_bridge import api
from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.errors import BridgeError, Cause, ConfigError, GateStop, OrderRefused, Part, Reason
from hil_bridge.errors.cause_row import LOOK, PART_DESCRIPTIONS, Reaction, When
from hil_bridge.errors.cause_table import AROUND, BEFORE, CLAMPS, ROWS, STOPS, TABLE
from hil_bridge.record import Outcome, Recording, RunEnd
from hil_bridge.record.analysis.why import why
from hil_bridge.runs.result import RunResult
from hil_bridge.settings.configuration import read_config
from hil_bridge.site.guard.conditions import as_text
from hil_bridge.site.guard.explaining import LOOSE

ROOT = Path(__file__).parents[2]
CONFIG = read_config({})
EVERY = pytest.mark.parametrize("cause", Cause)


def test_every_cause_has_one_row() -> None:
    assert [row.cause for row in TABLE] == list(dict.fromkeys(row.cause for row in TABLE))
    assert set(ROWS) == set(Cause)


@EVERY
def test_every_row_names_part_remedy_and_settings_that_exist(cause: Cause) -> None:
    row = ROWS[cause]
    assert row.condition
    assert row.part in Part
    for template in (row.blames, row.look):
        text = template.format(robot=" (egm)", sensor=" (netft)", recording="a.mcap")
        assert text.strip(".; ") == text
        assert "{" not in text
    for key in row.settings:
        result: object = CONFIG
        for name in key.split("."):
            assert hasattr(result, name), f"{cause}: {key}"
            result = getattr(result, name)


def test_device_settings_are_named_by_section() -> None:
    assert {key for row in TABLE for key in row.settings if key.count(".") > 1} == set()
    for robot in map(ROBOTS.kind, ROBOTS.own):
        for name in itertools.chain(*robot.ruling.values()):
            assert operator.attrgetter(name)(robot.settings()) is not None, f"{robot.name}: {name}"


def test_every_part_has_a_description() -> None:
    assert set(PART_DESCRIPTIONS) == set(LOOK) == set(Part)
    assert {row.part for row in TABLE} == set(Part)


def test_every_limit_is_in_the_table() -> None:
    reported = {key for row in TABLE for key in row.settings}
    assert {f"limits.{field.name}" for field in dataclasses.fields(CONFIG.limits)} <= reported
    assert set(LOOSE) <= reported


def test_reactions_match_exit_codes() -> None:
    for row in TABLE:
        assert (row.reaction is Reaction.CLAMPED) == (row.exit_code is None), row.cause
        assert (row.reaction is Reaction.REFUSED) == (row.when is When.BEFORE_MOTION), row.cause
    assert {row.exit_code for row in BEFORE} == {2, 3}
    assert {row.exit_code for row in STOPS} == {3}
    assert {row.exit_code for row in AROUND} == {3, 130}
    assert {row.reaction for row in CLAMPS} == {Reaction.CLAMPED}


def test_terminal_table_contains_every_row() -> None:
    lines = list(as_text())
    assert max(map(len, lines)) <= 110
    for row in TABLE:
        assert any(line.startswith(f"  {row.cause} ") for line in lines), row.cause


@pytest.mark.parametrize("error", [ConfigError, GateStop, OrderRefused])
def test_command_exit_code_is_that_of_its_row(error: type[BridgeError]) -> None:
    assert error.cause is not None
    assert error("it is wrong").exit_code == ROWS[error.cause].exit_code


def test_error_has_part_and_remedy_in_one_line() -> None:
    error = BridgeError("the sensor is silent", remedy="look at its cable", cause=Cause.STREAM)
    assert (error.part, error.remedy, error.fact) == (
        Part.SENSOR,
        "look at its cable",
        "the sensor is silent",
    )
    assert str(error) == "the sensor is silent; look at its cable"
    error.blame(Cause.GATE)
    assert error.reason(Cause.BUG) == Reason(Cause.STREAM, "the sensor is silent", "look at its cable")
    assert str(error.reason(Cause.BUG).in_step("2 (track)").in_step("3 (hold)")) == (
        "the sensor is silent, in step 2 (track); look at its cable"
    )


@pytest.fixture(scope="module")
def recording() -> Recording:
    return api.simulate({"run": {"duration_s": 0.2}}).recording


@EVERY
def test_why_names_part_and_what_to_check(recording: Recording, cause: Cause) -> None:
    row = ROWS[cause]
    outcome = {None: Outcome.STOPPED, 0: Outcome.COMPLETED, 130: Outcome.INTERRUPTED}.get(
        row.exit_code, Outcome.STOPPED
    )
    reason = Reason(cause, "this was it", "do that")
    end = RunEnd(outcome, reason, place="retracted, 0.0 N", left="retracted, 0.0 N").as_metadata()
    text = why(dataclasses.replace(recording, end=end), "a.mcap")
    assert "{" not in text
    if outcome is not Outcome.STOPPED:
        assert text.startswith(
            f"The run {'completed' if outcome is Outcome.COMPLETED else 'was interrupted'}"
        )
        return
    kinds = {"robot": " (s3)", "sensor": " (jr3)", "recording": "a.mcap"}
    assert f"The cause was {row.blames.format(**kinds)}: this was it." in text
    assert f"The message continues: do that. Check: {row.look.format(**kinds)}." in text


@EVERY
def test_run_exit_code_is_that_of_its_row(cause: Cause) -> None:
    row = ROWS[cause]
    if row.exit_code is not None:
        assert RunResult(Outcome.STOPPED, Reason(cause)).exit_code == row.exit_code
    assert RunResult(Outcome.COMPLETED).exit_code == 0


def causes_in(*folders: str) -> set[str]:
    """Names of causes that the modules in these folders name."""
    names: set[str] = set()
    for folder in folders:
        for path in (ROOT / folder).rglob("*.py"):
            if path.parent.name == "errors" or path == Path(__file__):
                continue
            names |= {
                node.attr
                for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
                if isinstance(node, ast.Attribute) and ast.unparse(node.value).split(".")[-1] == "Cause"
            }
    return names


NAMED_IN_ERRORS = {"CONFIGURATION", "REFUSED_ORDER", "GATE", "BUG", "PLUGIN_CODE", "ROBOT_FAILED", "CUT_WIRE"}
"""Causes that the errors themselves bring."""


def test_every_cause_is_raised_somewhere() -> None:
    """A row for what nothing raises would be a promise that nothing keeps."""
    assert {cause.name for cause in Cause} - causes_in("hil_bridge") == NAMED_IN_ERRORS - causes_in(
        "hil_bridge"
    )


NOT_REACHED = {
    "GAIN": "by its words: tests/runs/test_run_force.py reads the reasons of the record",
    "LEAVES_WORKSPACE": "the clamp that it follows from is tested; a program checks its path before it moves",
    "LEFT_UNKNOWN": "a sensor that falls silent while the tool comes to rest is stale in a cycle before",
    "NO_READING": "a sensor that tells nothing while it stands is stale, which comes first",
    "ZERO_CHANGED": "a force that changes within the one frame before a zero has no fault of its own",
}
"""Causes that no test names, with the reason."""


def test_every_cause_is_named_by_a_test_or_has_a_reason() -> None:
    assert {cause.name for cause in Cause} - causes_in("tests", "examples") == set(NOT_REACHED)
