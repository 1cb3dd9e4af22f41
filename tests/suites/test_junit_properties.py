"""Properties of JUnit files: requirements, recordings, and outcomes of runs."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hil_bridge.lab.junit import RECORDING, REQUIREMENT
from hil_bridge.testing import plugin
from tests.near_surface import NEAR

pytest_plugins = "pytester"
TESTS = f"""
import pytest
NEAR = {NEAR!r}

@pytest.mark.hil_requirement("R-1", "R-9")
def test_force(hil_simulate):
    result = hil_simulate({{**NEAR, "run": {{"duration_s": 0.3}}}})
    assert result.outcome == "completed"

@pytest.mark.hil_requirement("R-2")
def test_wire(hil_simulate):
    fault = {{"on": "robot", "fault": "emergency-stop", "phase": "track"}}
    result = hil_simulate({{**NEAR, "run": {{"duration_s": 1.0}}, "faults": [fault]}})
    assert result.outcome == "completed"

@pytest.mark.hil_requirement("R-4")
@pytest.mark.skip(reason="no robot here")
def test_later():
    pass

def test_without_a_requirement():
    pass
"""
PLUGIN = (
    *("-p", "hil_bridge.testing.plugin", "-p", "no:xdist", "-p", "no:asyncio"),
    *("-q", "--junitxml=tests.xml", "--hil-recordings=kept"),
)


@pytest.fixture
def cases(pytester: pytest.Pytester) -> dict[str, Sequence[tuple[str, str]]]:
    """Return the properties of each test case by name."""
    pytester.makepyfile(test_mine=TESTS)
    pytester.runpytest_inprocess(*PLUGIN).assert_outcomes(passed=2, failed=1, skipped=1)
    root = ElementTree.parse(pytester.path / "tests.xml")
    return {
        str(case.get("name")): [
            (str(one.get("name")), str(one.get("value"))) for one in case.iter("property")
        ]
        for case in root.iter("testcase")
    }


def test_plugin_and_campaign_property_names_match() -> None:
    assert (plugin.REQUIREMENT, plugin.RECORDING) == (REQUIREMENT, RECORDING)


def test_marked_requirements_are_junit_properties(cases: dict[str, Sequence[tuple[str, str]]]) -> None:
    assert {
        name: [value for key, value in properties if key == REQUIREMENT] for name, properties in cases.items()
    } == {
        "test_force": ["R-1", "R-9"],
        "test_wire": ["R-2"],
        "test_later": ["R-4"],
        "test_without_a_requirement": [],
    }


def test_run_and_recording_are_junit_properties(cases: dict[str, Sequence[tuple[str, str]]]) -> None:
    recordings = [Path(value) for case in cases.values() for key, value in case if key == RECORDING]
    assert len(recordings) == 2
    assert all(path.parent.name == "kept" and path.is_file() for path in recordings)
    assert ("hil_run.0.outcome", "completed") in cases["test_force"]
    stopped = dict(cases["test_wire"])
    assert stopped["hil_run.0.outcome"] == "stopped"
    assert "hil_run.0.cause" in stopped
    assert stopped["hil_run.0.fault"].startswith("robot: emergency-stop")
