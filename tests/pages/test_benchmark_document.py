"""The benchmark: its campaigns suit every robot, and the page has the published figures and the results."""

import csv
import json
import runpy
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.record.analysis.figures import FIGURES

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples" / "campaigns" / "benchmark"
PAGE = (ROOT / "docs" / "reference" / "benchmark.md").read_text(encoding="utf-8")
CELLS = (("s3", "jr3"), ("egm", "netft"), ("rsi", "netft"), ("rtde", "ft300"))


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "benchmark_doc.py"))


@pytest.mark.parametrize(("robot", "sensor"), CELLS)
def test_benchmark_cases_are_possible_on_every_robot(robot: str, sensor: str) -> None:
    settings = {"robot.emulated": robot, "sensor.emulated": sensor, "controller.name": "pi"}
    for name, cases in (("force", 24), ("moved", 16), ("places", 25)):
        plan = read_plan(FOLDER / f"{name}.toml", settings=settings)
        assert len(plan.possible) == cases


def test_published_figures_have_keys_of_table(tool: dict[str, Any]) -> None:
    with (FOLDER / "measured-robots.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    facts = ("source", "table", "robot", "device", "contact_m_s", "travel_m_s", "force_n")
    assert [name for name in rows[0] if name not in FIGURES] == [*facts]
    assert {*tool["COMPARED"]} <= {*rows[0]}
    assert len({tuple(row[name] for name in facts) for row in rows}) == len(rows) == 68
    for row in rows:
        values = [float(row[name]) for name in rows[0] if name in FIGURES and row[name]]
        assert all(value > 0.0 for value in values)


def test_benchmark_page_has_its_tables(tool: dict[str, Any]) -> None:
    figures = json.loads((ROOT / "docs" / "reference" / "benchmark.json").read_text(encoding="utf-8"))
    for name, make in tool["TABLES"].items():
        assert f"<!-- {name}: begin -->\n{make(figures)}\n<!-- {name}: end -->" in PAGE


def test_distance_is_emulated_less_published(tool: dict[str, Any]) -> None:
    nearest = {"settle_10n_s": "0.64", "track_error_mean_n": ""}
    values = {"settle_10n_s": [0.5, 0.4, 0.6], "track_error_mean_n": [1.0, 1.0, 1.0]}
    assert tool["_distance"](nearest, "settle_10n_s", values) == "−0.14"
    assert tool["_distance"](nearest, "track_error_mean_n", values) == "–"
    assert tool["_distance"](nearest, "settle_10n_s", {"settle_10n_s": [None, 0.4, None]}) == "–"
