"""Page on safety: it matches the code and the measurements."""

import json
import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.settings.configuration import read_config

pytestmark = pytest.mark.sweep

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "explanation" / "safety.md").read_text(encoding="utf-8")
FIGURES = json.loads((ROOT / "docs" / "explanation" / "safety.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "safety_doc.py"))


def test_every_case_was_measured_with_every_seed(tool: dict[str, Any]) -> None:
    assert list(FIGURES) == [case.name for case in tool["ALL_CASES"]]
    for case in tool["ALL_CASES"]:
        assert list(FIGURES[case.name]) == list(case.robots)
        for robot, by_stiffness in FIGURES[case.name].items():
            assert [float(stiffness) for stiffness in by_stiffness] == list(tool["STIFFNESSES_N_M"])
            for runs in by_stiffness.values():
                assert {len(values) for values in runs.values()} == {tool["SEEDS"][robot]}


def repeated() -> list[tuple[int, str]]:
    """Each case once, its robots in turn; each of the S3 too, for its runs are quick."""
    cases = runpy.run_path(str(ROOT / "tools" / "safety_doc.py"))["ALL_CASES"]
    rows = [(number, case.robots[number % len(case.robots)]) for number, case in enumerate(cases)]
    return sorted({*rows, *((number, "s3") for number, case in enumerate(cases) if "s3" in case.robots)})


@pytest.mark.parametrize(("number", "robot"), repeated())
def test_repeated_run_gives_same_result(tool: dict[str, Any], number: int, robot: str) -> None:
    """One seed of each case, at one stiffness."""
    case = tool["ALL_CASES"][number]
    seed, stiffness = 1 + number % tool["SEEDS"][robot], tool["STIFFNESSES_N_M"][number % 2]
    kept = FIGURES[case.name][robot][f"{stiffness:g}"]
    again = tool["columns"]([tool["measured"](tool["Job"](case, robot, stiffness, seed))])
    for name, (value,) in again.items():
        then = kept[name][seed - 1]
        # In another version of the libraries the last digits may differ.
        assert value == then if value is None else value == pytest.approx(then, rel=0.02, abs=0.01), (
            f"{name}: run python -m tools.documents safety --measure"
        )


@pytest.mark.full
def test_tool_reported_retracted_is_free(tool: dict[str, Any]) -> None:
    """Settings of the runs of the page, and their true values."""
    cases = [case for case in tool["CASES"] if case.name.startswith(("Ctrl-C", "the robot"))]
    assert len(cases) == 4
    for case in cases:
        times = tool["measured"](tool["Job"](case, "s3", 5e4, 3))
        assert times.left.startswith("retracted") == (times.end_n == 0.0)


def test_every_setting_that_the_page_names_exists() -> None:
    named = set(re.findall(r"`((?:limits|task|sensor|robot|tool|run|oscillation)\.[a-z0-9_.]+)`", PAGE))
    assert len(named) > 30
    for key in named:
        result: object = read_config({})
        for name in key.split("."):
            assert hasattr(result, name), key
            result = getattr(result, name)


@pytest.fixture(scope="module")
def sentences() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "safety_sentences.py"))


def test_named_tests_exist(sentences: dict[str, Any]) -> None:
    assert sentences["missing_tests"](sentences["kept"]()) == []
    name = "tests/guard/test_none.py::test_none"
    assert sentences["missing_tests"]({"heading": {"sentence": [name]}}) == [name]


def test_every_sentence_has_its_tests_or_a_mark(sentences: dict[str, Any]) -> None:
    marks = (sentences["NOT_TESTED"], sentences["NO_PROMISE"])
    for rows in sentences["kept"]().values():
        for sentence, evidence in rows.items():
            assert evidence in marks if isinstance(evidence, str) else evidence, sentence
