"""Division of the tests between the tiers of the check."""

from collections import Counter
from types import SimpleNamespace

import pytest

from tests.conftest import pytest_collection_modifyitems

SWEPT = [f"test_a.py::test_swept[{number}]" for number in range(8)]
OTHERS = {"test_a.py::test_plain": "", "test_a.py::test_long": "full"}


def selected(tier: str, part: str = "1/1") -> list[str]:
    """Return the identifiers of the tests that a tier runs."""
    marks = dict.fromkeys(SWEPT, "sweep") | OTHERS
    items = [
        SimpleNamespace(
            nodeid=name, get_closest_marker=lambda kind, mark=mark: kind if kind == mark else None
        )
        for name, mark in marks.items()
    ]
    options = {"--tier": tier, "--part": part}
    hook = SimpleNamespace(pytest_deselected=lambda items: None)
    pytest_collection_modifyitems(SimpleNamespace(getoption=options.get, hook=hook), items)  # type: ignore[arg-type]
    return [item.nodeid for item in items]


@pytest.mark.parametrize("part", ["1/1", "0/3", "2/3"])
def test_gate_runs_first_case_in_every_part(part: str) -> None:
    assert selected("gate", part) == [SWEPT[0], "test_a.py::test_plain"]


def test_parts_run_every_further_case_once() -> None:
    further = [name for part in range(3) for name in selected("full", f"{part}/3") if name in SWEPT]
    assert Counter(further) == Counter(SWEPT[1:])
    assert all("test_a.py::test_long" in selected("full", f"{part}/3") for part in range(3))


def test_full_tier_runs_every_case_by_default() -> None:
    assert selected("full") == [*SWEPT[1:], "test_a.py::test_long"]
