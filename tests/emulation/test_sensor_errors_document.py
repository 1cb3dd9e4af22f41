"""Tests that the page on fidelity has the tables of the runs with the errors of real sensors."""

import json
import runpy
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.settings.configuration import load_config

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "explanation" / "fidelity.md").read_text(encoding="utf-8")
FIGURES = json.loads((ROOT / "docs" / "explanation" / "sensor-errors.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "sensor_errors_doc.py"))


def test_each_run_has_figures(tool: dict[str, Any]) -> None:
    measured = [tuple(row[name] for name in tool["Job"]._fields) for row in FIGURES]
    assert measured == [tuple(job) for job in tool["jobs"]()], (
        "run python -m tools.documents sensor-errors --measure"
    )


def test_each_run_has_valid_configuration(tool: dict[str, Any]) -> None:
    for job in tool["jobs"]():
        config = load_config(None, tool["settings"](job))
        assert config.cell.surface.stiffness_n_m == job.stiffness_kn_m * 1e3
        assert len(config.faults) == bool(job.fault)


def test_errors_of_our_sensors_stop_no_run() -> None:
    healthy = [row for row in FIGURES if not row["fault"] and row["errors"] != "as a CB3"]
    assert healthy
    assert not [row["cause"] for row in healthy if row["cause"]]


def test_errors_do_not_weaken_guard(tool: dict[str, Any]) -> None:
    """The largest true force of a fault stays within 10 %, and one newton, of the force without these errors, or within
    twice the desired force if the sensor repeats a sample that differs from it.
    """
    faulty = [row for row in FIGURES if row["fault"] and row["errors"] != "as a CB3"]
    alone = {(row["robot"], row["fault"]): row for row in faulty if row["errors"] == "noise alone"}
    for row in faulty:
        same = alone[row["robot"], row["fault"]]
        assert row["cause"] or not same["cause"]
        repeated = 2.0 * tool["FORCE_N"] if row["cause"] == "unanswered" else 0.0
        assert row["peak_n"] <= max(1.1 * same["peak_n"] + 1.0, repeated)
