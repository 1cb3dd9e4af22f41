"""Documentation of the hidden cells: its tables match the stored figures, and those match the drawn cells."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from tools.documents import DOCS
from tools.identified_cells import (
    CELLS,
    Row,
    all_rows,
    cell,
    true_values,
    within_of,
)

ROWS = json.loads((DOCS / "reference" / "identified-cells.json").read_text(encoding="utf-8"))
PAGE = (DOCS / "reference" / "identify-cell.md").read_text(encoding="utf-8")


def test_documented_figures_match_drawn_cells() -> None:
    assert [(one["robot"], one["sensor"]) for one in ROWS] == list(CELLS)
    for one in ROWS:
        true = true_values(cell(one["cell"]))
        assert {row["key"]: row["true"] for row in one["rows"]} == {
            key: value for key, value in true.items() if any(row["key"] == key for row in one["rows"])
        }, "run python -m tools.documents identified-cells --measure"


def test_cells_draw_within_documented_ranges() -> None:
    """A setting that the table lacks is the same in all cells, and documented next to it."""
    documented = dict(drawn_settings_of_page())
    shared = {
        "run.duration_s": 10.0,
        "task.expected_stiffness_n_m": 3e4,
        "cell.arm.compliance": "rigid",
    }
    for number in range(len(CELLS)):
        settings = dict(_leaves(cell(number)))
        assert settings.pop("run.seed") == number + 1
        assert (settings.pop("robot.emulated"), settings.pop("sensor.emulated")) == CELLS[number]
        for fault in settings.pop("faults"):
            assert 5e-4 <= fault["with"]["probability"] <= 1e-2
        for key, value in shared.items():
            assert settings.pop(key) == value
        for key, value in settings.items():
            low, high = documented[key]
            assert low <= value <= high, key
    keys = {key for number in range(len(CELLS)) for key, _ in _leaves(cell(number))}
    assert set(documented) < keys, "a setting of the table is drawn for no cell"


def test_documented_draw_rules_apply() -> None:
    jr3 = [cell(number) for number in range(5)]
    pairs = [tuple(one["sensor"]["jr3"]["gateway"].values()) for one in jr3]
    assert (10.0, 10.0) not in pairs, "the page says that none drew the default filter"
    least = [true_values(one)["sensor.noise.fx"] / (115.0 / 2**14) for one in jr3]
    assert sum(noise < 0.5 for noise in least) == 1, "the page says so of one cell"
    friction = [
        true_values(cell(number))["surface.friction"] / cell(number)["cell"]["surface"]["friction"]
        for number in range(len(CELLS))
    ]
    assert friction[:5] == [1.0] * 5
    assert {round(share, 3) for share in friction[5:]} == {0.984}
    assert "has 98.4 %" in PAGE
    assert "is 0.984 of the drawn one" in " ".join(PAGE.split())


def drawn_settings_of_page() -> Iterator[tuple[str, tuple[float, float]]]:
    """Return the ranges of the table by setting; for pairs, the smallest and the largest of each."""
    table = PAGE.partition("<!-- drawn: begin -->")[2].partition("<!-- drawn: end -->")[0]
    for line in table.splitlines()[3:]:
        _, _, keys, ranges, *_ = [part.strip() for part in line.split("|")]
        named = [key.strip("`") for key in keys.split(" and ")]
        if ranges.startswith("one of: "):
            rows = [[*map(float, one.split(", "))] for one in ranges.removeprefix("one of: ").split("; ")]
        else:
            rows = [[float(end)] for end in ranges.partition(",")[0].split(" … ")]
        for key, values in zip(named, zip(*rows, strict=True), strict=True):
            yield key, (min(values), max(values))


def _leaves(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{before}{key}.")
        else:
            yield before + key, value


def test_documented_values_lie_within_intervals() -> None:
    """The target is 95 %; intervals with an allowance contain more."""
    within, observed = within_of([row for _, row in all_rows(ROWS)])
    assert observed > 300
    assert within >= 0.95 * observed
    noises = [row for _, row in all_rows(ROWS) if row.key.startswith("sensor.noise")]
    within, observed = within_of(noises)
    assert 0.9 * observed <= within


def test_value_outside_interval_is_counted() -> None:
    inside = Row("key", "robot", "words", "s", 1.0, 1.1, 0.9, 1.3, None)
    assert within_of([inside, inside._replace(true=1.4), inside._replace(found=None)]) == (1, 2)
