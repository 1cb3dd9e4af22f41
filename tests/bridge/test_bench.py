"""The benchmarks' own bookkeeping: figures, the file of results, the page. Nothing is timed here."""

import json
from pathlib import Path

import pytest

from tools.bench.figures import Figure, Report, Spread, Target
from tools.bench.page import renewed

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_page_shows_the_published_results():
    page = (DOCS / "performance.md").read_text(encoding="utf-8")
    results = json.loads((DOCS / "performance.json").read_text(encoding="utf-8"))
    assert renewed(page, results) == page, "run make bench PAGE=1"


def test_a_figure_is_judged_by_its_value_or_by_its_ratio():
    assert Figure("speed", 120.0, "s/s", target=Target("value", 100.0, least=True)).met is True
    assert Figure("speed", 90.0, "s/s", target=Target("value", 100.0, least=True)).met is False
    late = Figure("lateness", 30.0, "µs", 100.0, "asyncio", Target("ratio", 0.25))
    assert (late.ratio, late.met) == (0.3, False)
    assert late.line() == "lateness: 30.0 µs; 100 µs (asyncio), ratio 0.300 ×; ≤ 0.25 ×: NOT met"


def test_a_ratio_beside_its_target_is_told_to_the_digit_that_decides():
    target = Target("ratio", 1.03)
    ratios = [Figure("f", value, "ms", 1.0, "floor", target).cells()[3] for value in (1.028, 1.032, 1.06)]
    assert ratios == ["1.028 ×", "1.032 ×", "1.06 ×"]


def test_a_target_without_its_baseline_is_not_judged():
    assert Figure("lateness", 30.0, "µs", target=Target("ratio", 0.25)).met is None


def test_results_come_back_from_their_file_as_they_went():
    report = Report(
        (
            Figure("a", 1.5, "µs", 3.0, "C", Target("ratio", 2.0, aim=1.5)),
            Figure("b", 100.0, "s/s", target=Target("value", 40.0, least=True)),
        ),
        ("vcan: none here",),
    )
    assert Report.from_json(json.loads(json.dumps(report.as_json()))) == report


def test_a_table_without_a_place_on_the_page_is_missed():
    with pytest.raises(ValueError, match="no place for 'machine'"):
        renewed("# Performance", {"machine": {}, "benchmarks": {}})


def test_the_hundredth_part_lies_above_the_99th_percentile():
    spread = Spread([float(value) for value in range(1, 201)])
    assert (spread.p50, spread.p99) == (100.5, 198.0)
