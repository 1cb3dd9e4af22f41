"""Page on faults: it matches the emulators, and its runs use existing faults."""

import json
import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from emulators.faults import Fault, Parameter
from hil_bridge.errors.cause_row import COMPLETED, STOPPED
from hil_bridge.settings.configuration import load_config

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "faults.md").read_text(encoding="utf-8")
FIGURES = json.loads((ROOT / "docs" / "reference" / "faults.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "faults_doc.py"))


def test_every_fault_was_measured_once(tool: dict[str, Any]) -> None:
    assert list(FIGURES) == [job.key for job in tool["jobs"]()], (
        "run python -m tools.documents faults --measure"
    )
    for key, end in FIGURES.items():
        assert end["exit"] in (COMPLETED, STOPPED), key
        assert bool(end["cause"]) == bool(end["exit"]), key
        assert "\n" not in end["cause"]


def test_every_run_has_a_cell_with_its_fault(tool: dict[str, Any]) -> None:
    """A configuration refuses any other combination."""
    for job in tool["jobs"]():
        (fault,) = load_config(None, tool["settings"](job)).faults
        assert (fault.on, fault.fault) == (job.on, job.fault)


def test_parameters_have_default_and_unit(tool: dict[str, Any]) -> None:
    fault = Fault("something", {"by": Parameter(2, "how much", 1, 5, "mm")}, 3.0)
    assert tool["parameters"](fault) == "`by` 2 mm"
    assert tool["lasts"](fault) == "3 s"


def test_every_fault_of_every_device_is_on_the_page(tool: dict[str, Any]) -> None:
    for device in (*tool["ROBOT_NAMES"], *tool["SENSOR_NAMES"], tool["CELL"]):
        for on, faults in tool["faults_of_device"](device).items():
            table = PAGE.partition(f"### `{on}`\n")[2].partition("###")[0]
            for fault in faults:
                rows = [line for line in table.splitlines() if line.startswith(f"| `{fault}` |")]
                assert rows, (device, on, fault)
                assert device == tool["CELL"] or any(device in re.split(r"[ ,:;]+", row) for row in rows)


def test_no_parameter_has_the_old_duration_name(tool: dict[str, Any]) -> None:
    """It would be read as the duration, and the parameter would keep its default."""
    for device in (*tool["ROBOT_NAMES"], *tool["SENSOR_NAMES"], tool["CELL"]):
        for on, faults in tool["faults_of_device"](device).items():
            for name, fault in faults.items():
                assert fault.lasts_s is None or "seconds" not in fault.parameters, f"{device}: {on}: {name}"
