"""The page on RTDE has the table of the runs of our own controllers on the maker's surfaces."""

import json
import runpy
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.settings.configuration import load_config

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "rtde.md").read_text(encoding="utf-8")
FIGURES = json.loads((ROOT / "docs" / "reference" / "held-force.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "held_force_doc.py"))


def test_the_table_is_that_of_its_figures(tool: dict[str, Any]) -> None:
    assert tool["renewed"](PAGE, FIGURES) == PAGE, "run python -m tools.documents held-force"


def test_each_controller_has_its_figures_with_each_sensor(tool: dict[str, Any]) -> None:
    cases = product(tool["CONTROLLERS"], tool["SENSORS"], tool["STIFFNESSES_KN_M"])
    keys = [(row["controller"], row["sensor"], row["stiffness_kn_m"]) for row in FIGURES]
    assert keys == list(cases), "run python -m tools.documents held-force --measure"


def test_each_run_is_one_that_its_configuration_allows(tool: dict[str, Any]) -> None:
    for row in FIGURES:
        config = load_config(
            None, tool["settings"]((row["controller"], row["sensor"], row["stiffness_kn_m"]))
        )
        assert config.cell.surface.stiffness_n_m == row["stiffness_kn_m"] * 1e3
        assert config.task.force_n == tool["FORCE_N"]
