"""The page on safety says what the code does and what was measured."""

import json
import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.settings.configuration import Config

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "explanation" / "safety.md").read_text(encoding="utf-8")
FIGURES = json.loads((ROOT / "docs" / "explanation" / "safety.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "safety_doc.py"))


def test_the_tables_are_those_of_code_and_figures(tool: dict[str, Any]) -> None:
    assert tool["renewed"](PAGE, FIGURES) == PAGE, "run python tools/safety_doc.py"


def test_a_table_without_a_place_is_missed(tool: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="no place for 'conditions'"):
        tool["renewed"](PAGE.replace("<!-- conditions: begin -->", ""), FIGURES)


def test_every_case_was_measured_with_every_seed(tool: dict[str, Any]) -> None:
    assert list(FIGURES) == [case.name for case in tool["ALL_CASES"]]
    for by_stiffness in FIGURES.values():
        assert [float(stiffness) for stiffness in by_stiffness] == list(tool["STIFFNESSES_N_M"])
        for runs in by_stiffness.values():
            assert {len(values) for values in runs.values()} == {tool["SEEDS"]}


@pytest.mark.parametrize("number", range(16))
def test_a_run_that_is_repeated_shows_the_same(tool: dict[str, Any], number: int) -> None:
    """One seed of each case, at one stiffness."""
    seed, stiffness = 1 + number, tool["STIFFNESSES_N_M"][number % 2]
    told = FIGURES[tool["ALL_CASES"][number].name][f"{stiffness:g}"]
    shown = tool["columns"]([tool["measured"](number, stiffness, seed)])
    for name, (value,) in shown.items():
        then = told[name][seed - 1]
        # In another version of the libraries the last digits may differ.
        assert value == then if value is None else value == pytest.approx(then, rel=0.02, abs=0.01), (
            f"{name}: run python tools/safety_doc.py --measure"
        )


def test_a_tool_told_as_retracted_presses_on_nothing(tool: dict[str, Any]) -> None:
    """Settings of the runs of the page, and their true values."""
    cases = [
        number for number, case in enumerate(tool["CASES"]) if case.name.startswith(("Ctrl-C", "the robot"))
    ]
    assert len(cases) == 4
    for number in cases:
        times = tool["measured"](number, 5e4, 3)
        assert times.left.startswith("retracted") == (times.end_n == 0.0)


def test_every_setting_that_the_page_names_exists() -> None:
    named = set(re.findall(r"`((?:limits|task|sensor|robot|tool|run|oscillation)\.[a-z0-9_.]+)`", PAGE))
    assert len(named) > 30
    for key in named:
        found: object = Config()
        for name in key.split("."):
            assert hasattr(found, name), key
            found = getattr(found, name)
