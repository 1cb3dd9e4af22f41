"""The page of the hidden cells has the tables of its figures, and its figures are those of the cells that are drawn."""

import json
from pathlib import Path

from tools.identified_cells import (
    CELLS,
    DOCUMENT,
    FIGURES,
    Row,
    all_rows,
    cell,
    renewed,
    true_values,
    within_of,
)

ROWS = json.loads(FIGURES.read_text(encoding="utf-8"))
PAGE = Path(DOCUMENT).read_text(encoding="utf-8")


def test_the_tables_are_those_of_the_figures() -> None:
    assert renewed(PAGE, ROWS) == PAGE, "run python -m tools.identified_cells"


def test_the_figures_are_of_the_cells_that_are_drawn() -> None:
    assert [(one["robot"], one["sensor"]) for one in ROWS] == list(CELLS)
    for one in ROWS:
        true = true_values(cell(one["cell"]))
        assert {row["key"]: row["true"] for row in one["rows"]} == {
            key: value for key, value in true.items() if any(row["key"] == key for row in one["rows"])
        }, "run python -m tools.identified_cells --measure"


def test_nine_values_in_ten_lie_within_their_intervals() -> None:
    """The aim is 95 %; the intervals with an allowance hold more."""
    within, seen = within_of([row for _, row in all_rows(ROWS)])
    assert seen > 300
    assert within >= 0.95 * seen
    noises = [row for _, row in all_rows(ROWS) if row.key.startswith("sensor.noise")]
    within, seen = within_of(noises)
    assert 0.9 * seen <= within


def test_a_value_outside_its_interval_counts_as_such() -> None:
    inside = Row("key", "robot", "words", "s", 1.0, 1.1, 0.9, 1.3, None)
    assert within_of([inside, inside._replace(true=1.4), inside._replace(found=None)]) == (1, 2)
