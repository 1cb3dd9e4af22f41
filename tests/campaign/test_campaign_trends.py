"""Comparison of campaigns: sums by cell, significant changes, the page, and the exit code."""

import json
import math
import re
import sqlite3
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.digest import Tally
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.trend_page import point, trend_charts, trend_lines, trend_page
from hil_bridge.lab.campaign.trends import Change, Trend, trend_of
from hil_bridge.lab.significance import fisher_exact, holm, rank_sum
from hil_bridge.show.pages.svg import interval_plot
from tests.campaign.study import changed

SEEDS = 12
FORCES = {0: [8.0 + 0.1 * k for k in range(SEEDS)], 2: [10.0 + 0.1 * k for k in range(SEEDS)]}
"""Largest true forces by case, for the cells without a fault."""


def made(results: Path, path: Path, shift_n: float = 0.0, failing: Sequence[int] = ()) -> Path:
    """Return results with SEEDS runs of each case without a fault. Forces are shifted in the first cell only, where
    runs of the seeds in `failing` fail.
    """
    with sqlite3.connect(results) as source, sqlite3.connect(path) as target:
        source.backup(target)
        rows = {number: _row(target, number) for number in FORCES}
        target.execute("DELETE FROM runs")
        for number, forces in FORCES.items():
            for seed, force in enumerate(forces):
                bad = number == 0 and seed in failing
                figures = {"outcome": "completed", "cycles": 100}
                figures["force_true_max_n"] = force + (shift_n if number == 0 else 0.0)
                row = {
                    **rows[number],
                    "key": f"{number}-{seed}",
                    "seed": seed,
                    "failed": '["outcome completed"]' if bad else "[]",
                    "passed": not bad,
                    "figures": json.dumps(figures),
                }
                marks = ", ".join(f":{name}" for name in row)
                target.execute(f"INSERT INTO runs ({', '.join(row)}) VALUES ({marks})", row)
    source.close()
    target.commit()
    target.close()
    return path


def _row(connection: sqlite3.Connection, number: int) -> dict[str, object]:
    cursor = connection.execute("SELECT * FROM runs WHERE number = ?", (number,))
    names = [column[0] for column in cursor.description]
    return dict(zip(names, cursor.fetchone(), strict=True))


def trend(*paths: Path) -> Trend:
    stores = {path.stem: Store.open(path) for path in paths}
    try:
        return trend_of(stores)
    finally:
        for store in stores.values():
            store.close()


def with_primary(results: Path, path: Path, *keys: str) -> Path:
    """Return a copy of results whose campaign has these figures of its first case as primary figures."""
    figures = [{"title": f"the {key}", "case": "task.force_n 8.0", "figure": key} for key in keys]
    sql = f"INSERT OR REPLACE INTO facts VALUES ('primary', '{json.dumps(figures)}')"
    return changed(results, path, sql)


@pytest.fixture(scope="module")
def before(short_results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(short_results, tmp_path_factory.mktemp("trend") / "before.sqlite")


def test_trend_of_identical_campaigns_has_no_change(
    short_results: Path, before: Path, tmp_path: Path
) -> None:
    result = trend(before, made(short_results, tmp_path / "after.sqlite"))
    assert result.figures == ()
    assert [one.tallies for one in result.cells] == [(Tally(12), Tally(12))] * 2
    assert [one.probability for one in (result.overall, *result.cells)] == [1.0, 1.0, 1.0]
    assert not result.worse
    assert "no significant difference" in trend_page(result)


def test_trend_cell_with_fewer_passed_runs_is_worse(
    short_results: Path, before: Path, tmp_path: Path
) -> None:
    result = trend(before, made(short_results, tmp_path / "after.sqlite", failing=range(8)))
    first, second = result.cells
    assert first.tallies == (Tally(12), Tally(4, 8))
    assert first.probability == fisher_exact((12, 0), (4, 8))
    assert (first.change, second.change) == (Change.WORSE, Change.NONE)
    assert first.adjusted == holm([first.probability, 1.0])[0]
    assert result.overall.tallies == (Tally(24), Tally(16, 8))
    assert result.worse
    back = trend(tmp_path / "after.sqlite", before)
    assert back.cells[0].change is Change.BETTER
    assert not back.worse


def test_trend_lists_setting_changes_first(before: Path, tmp_path: Path) -> None:
    """A changed setting may explain a change of the results."""
    longer = "UPDATE cases SET config = json_set(config, '$.run.duration_s', 0.4)"
    more = longer.replace("0.4)", "0.4, '$.task.retract_mm', 3.0, '$.cell.tool.mass_kg', 0.2)")
    result = trend(before, changed(before, tmp_path / "after.sqlite", longer))
    lines = list(trend_lines(result))
    assert lines[2] == "setting run.duration_s: 0.3 → 0.4"
    assert lines[3].startswith("before → after: ")
    assert "<code>run.duration_s</code> is 0.3 in" in trend_page(result)
    several = trend(before, changed(before, tmp_path / "several.sqlite", more))
    assert "<h2>Settings that differ</h2>" in trend_page(several)
    same = changed(before, tmp_path / "same.sqlite")
    assert "Settings that differ" not in trend_page(trend(before, same))


def test_interval_plot_includes_zero_and_best_value() -> None:
    plot = interval_plot((10.0, 20.0, 30.0), (0.0, 0.0, 5.0), 0.0, "good")
    (best,) = re.findall(r'class="best" x1="(\S+)%"', plot)
    first, last = (float(x) for x in re.findall(r'<circle cx="(\S+)%"', plot))
    assert float(best) == last
    ends = [float(x) for x in re.findall(r'x1="\S+%" x2="(\S+)%" y1="5"', plot)]
    assert first - last == pytest.approx(2.0 * (ends[0] - first), abs=0.2)
    assert "<circle" not in interval_plot(None, None, None, "")


def test_interval_plot_with_endless_end_has_arrow() -> None:
    plot = interval_plot((1.0, 2.0, math.inf), (1.0, 2.0, 3.0), None, "")
    first, last = re.findall(r"<g .*?</g>", plot)
    assert ("<circle" in first, "<path" in first) == (True, True)
    assert ("<circle" in last, "<path" in last) == (True, False)


def test_few_failures_are_not_significant(short_results: Path, before: Path, tmp_path: Path) -> None:
    result = trend(before, made(short_results, tmp_path / "after.sqlite", failing=[3, 4]))
    assert result.cells[0].tallies[1] == Tally(10, 2)
    assert result.cells[0].change is Change.NONE
    assert not result.worse


@pytest.mark.parametrize(
    ("shift_n", "change"), [(2.0, Change.WORSE), (-2.0, Change.BETTER), (0.05, Change.NONE)]
)
def test_changed_figure_is_judged_by_its_good_direction(
    short_results: Path, before: Path, tmp_path: Path, shift_n: float, change: Change
) -> None:
    result = trend(before, made(short_results, tmp_path / "after.sqlite", shift_n))
    (row,) = result.figures  # of one cell, and no other figure
    assert (row.figure, row.cell, row.runs) == ("force_true_max_n", "task.force_n 8.0", (12, 12))
    assert row.medians == pytest.approx((8.55, 8.55 + shift_n))
    assert row.probability == rank_sum(FORCES[0], [force + shift_n for force in FORCES[0]])
    assert row.change is change


def test_primary_figures_are_tested_among_themselves(
    short_results: Path, before: Path, tmp_path: Path
) -> None:
    after = made(short_results, tmp_path / "made.sqlite", 2.0)
    plain = trend(before, after).figures[0]
    result = trend(before, with_primary(after, tmp_path / "after.sqlite", "cycles", "force_true_max_n"))
    first, second = result.primary
    assert (first.figure, first.label, first.medians) == ("cycles", "the cycles", (100.0, 100.0))
    assert (second.probability, second.change) == (plain.probability, Change.WORSE)
    assert second.adjusted == 2.0 * (plain.probability or 0.0)
    assert result.figures == ()
    assert result.worse
    text = trend_page(result)
    assert "<h2>Primary figures, medians</h2>" in text
    assert "Course over the results" not in text
    lines = [line.split("  ")[0] for line in trend_lines(result)]
    assert lines[-8:-5] == ["figure", "the cycles", "the force_true_max_n"]
    assert lines[-3:-1] == ["all cells", "and 2 more cells, the same in all results"]


def test_trend_of_single_runs_is_not_tested(short_results: Path, before: Path, tmp_path: Path) -> None:
    """The text marks the better value, and neither the page nor the text has a column for tests."""
    made(short_results, tmp_path / "made.sqlite", 2.0)
    first = "DELETE FROM runs WHERE seed > 0"
    left = changed(before, tmp_path / "left.sqlite", first)
    right = changed(tmp_path / "made.sqlite", tmp_path / "one.sqlite", first)
    result = trend(left, with_primary(right, tmp_path / "right.sqlite", "cycles", "force_true_max_n"))
    verdict = "`right` is better in 0 and worse in 1 of 2 primary figures"
    verdict += (
        " (1 has no preferred direction or equal values); the largest difference is the force_true_max_n: "
    )
    verdict += (
        "8.00 N → 10.0 N. Nothing is tested: a difference can be significant from 5 seeds on. Passed runs: "
    )
    assert point(result).startswith(f"{verdict}2/2 → 2/2 (`left` has 2 of 8 runs; `right` has 2 of 8 runs).")
    text, lines = trend_page(result), "\n".join(trend_lines(result))
    assert "<h2>Primary figures, single runs</h2>" in text
    assert "<h2>Largest differences, not tested</h2>" in text
    assert "adjusted p" not in text + lines
    assert '<td class="count" data-title="○ left">8.00 N <small>(1 run)</small></td>' in text
    assert '<td class="count" data-title="difference">+2.00 N</td>' in text
    assert re.search(
        r"the force_true_max_n +task.force_n 8.0 +8.00 N \(1 run\) \* +10.0 N \(1 run\) +\+2.00 N\n", lines
    )


def test_trend_ranks_displayed_differences(before: Path, tmp_path: Path) -> None:
    """Of single runs: values that are displayed alike do not differ, and a zero without a scale is no large change."""
    sides = []
    for name, values in (("left", (20.0, 0.01, 0.0, 1.0)), ("right", (0.5, 0.0, 50.0, 1.001))):
        keys = "$.track_error_max_n", "$.drift_n_min", "$.overshoot_percent", "$.rms_error_n"
        pairs = ", ".join(f"'{key}', {value}" for key, value in zip(keys, values, strict=True))
        sql = f"UPDATE runs SET figures = json_set(figures, {pairs}) WHERE number = 0"
        sides.append(changed(before, tmp_path / f"{name}.sqlite", "DELETE FROM runs WHERE seed > 0", sql))
    lines = "\n".join(trend_lines(trend(*sides)))
    rows = re.findall(r"^(\w[\w ]*?)  +task.force_n 8.0 .*?(\S+ \S+)$", lines, re.MULTILINE)
    assert rows == [
        ("overshoot", "+50.0 points"),
        ("largest track error", "−19.5 N"),
        ("drift", "−0.010 N/min"),
    ]


def test_trend_endless_time_is_never(before: Path, tmp_path: Path) -> None:
    """An infinite median has no difference, and is worse than any other."""
    sql = "UPDATE runs SET figures = json_set(figures, '$.settle_s', json('{}')) WHERE number = 0"
    left = changed(before, tmp_path / "left.sqlite", sql.format("0.5"))
    row = trend(left, changed(before, tmp_path / "right.sqlite", sql.format("9e999"))).figures[0]
    assert (row.medians, row.change) == ((0.5, None), Change.WORSE)
    assert row.best == {0}
    result = trend(left, tmp_path / "right.sqlite")
    lines = "\n".join(trend_lines(result))
    (plot,) = re.findall(r'<g class="last bad">(.*?)</g>', trend_page(result))
    assert ("<circle" in plot, plot.count("<path")) == (False, 1)  # an arrow
    assert re.search(r"settling time +task.force_n 8.0 +0.50 s \* +never +– +< 0", lines)


def test_trend_without_significance_counts_medians(short_results: Path, before: Path, tmp_path: Path) -> None:
    after = made(short_results, tmp_path / "made.sqlite", 0.05)
    result = trend(before, with_primary(after, tmp_path / "after.sqlite", "cycles", "force_true_max_n"))
    assert point(result).startswith(
        "`after` is better in 0 and worse in 1 of 2 primary figures (1 has no preferred direction or equal values); "
        "the largest difference is the force_true_max_n: 8.55 N → 8.60 N. No difference is significant. Passed runs: "
    )


def test_trend_over_all_cells_is_in_the_badge(before: Path) -> None:
    result = trend(before, changed(before, before.with_name("same.sqlite")))
    worse = replace(result, overall=replace(result.overall, adjusted=0.01, change=Change.WORSE))
    assert worse.worse
    verdict = "`same` is significantly worse over all cells. Passed runs: 24/24 → 24/24."
    assert point(worse).startswith(verdict)
    assert '<span class="badge bad">significantly worse over all cells</span>' in trend_page(worse)


@pytest.mark.parametrize(("seeds", "needed"), [(1, 5), (4, 5), (5, 0), (12, 0)])
def test_trend_names_number_of_runs_that_tests_need(
    short_results: Path, before: Path, tmp_path: Path, seeds: int, needed: int
) -> None:
    """Two figures can differ significantly with five runs: 2 · 2/252 < 0.05 < 2 · 2/70."""
    made(short_results, tmp_path / "made.sqlite", 2.0)
    few = f"DELETE FROM runs WHERE seed >= {seeds}"
    left = changed(before, tmp_path / "left.sqlite", few)
    right = changed(tmp_path / "made.sqlite", tmp_path / "few.sqlite", few)
    result = trend(left, with_primary(right, tmp_path / "right.sqlite", "cycles", "force_true_max_n"))
    assert result.runs_needed == needed
    assert ("too few runs" in trend_page(result)) == (needed > 0)
    assert (f"from {needed} seeds on" in point(result)) == (needed > 0)
    assert result.worse == (needed == 0)


def test_trend_page_shows_several_results(short_results: Path, before: Path, tmp_path: Path) -> None:
    middle = made(short_results, tmp_path / "middle.sqlite", 1.0, [1])
    result = trend(before, middle, made(short_results, tmp_path / "after.sqlite", 2.0, range(9)))
    charts = trend_charts(result)
    assert charts.axes["place"].names == ["before", "middle", "after"]
    passed, force = charts.charts
    assert (passed.id, force.id) == ("passed", "force_true_max_n")
    assert charts.sources["passed"][passed.series[0].column] == pytest.approx([100.0, 1100 / 12, 25.0])
    assert charts.sources[force.id][force.series[0].column] == pytest.approx([8.55, 9.55, 10.55])
    assert force.series[0].colour == passed.series[0].colour
    text = trend_page(result)
    assert "3 campaigns compared" in text
    assert '<span class="badge bad">2 significantly worse, 0 better</span>' in text
    counts = (("before", "12/12"), ("middle", "11/12"), ("after", "3/12"))
    for (name, count), sign in zip(counts, ("○ ", "", "● "), strict=True):
        best = " best" * (name == "before")
        assert f'<td class="count{best}" data-title="{sign}{name}">{count}</td>' in text
    assert point(result) == (
        "`after` is significantly better in 0 and worse in 2 of 3 cells and figures; the clearest is "
        "largest true force at task.force_n 8.0: 8.55 N → 10.6 N (worse). "
        "Passed runs: 24/24 → 15/24. No setting differs."
    )


def test_compare_command_exits_with_1_if_worse(short_results: Path, before: Path, tmp_path: Path) -> None:
    after = made(short_results, tmp_path / "after.sqlite", failing=range(8))
    page = tmp_path / "page.html"
    arguments = ["compare", str(before), str(after), "--output", str(page)]
    ended = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert ended.exit_code == 1
    assert "before → after: 1 significantly worse, 0 better" in ended.output
    assert "<h1>before and after compared</h1>" in page.read_text()
    with pytest.raises(ConfigError, match="already exists"):
        CliRunner().invoke(cli, arguments, catch_exceptions=False)
    as_json = CliRunner().invoke(cli, [*arguments, "--json"], catch_exceptions=False)
    assert as_json.exit_code == 1
    output = json.loads(as_json.output)
    assert output["cells"][0]["change"] == "worse"
    assert output["cells"][0]["tallies"][1] == {"passed": 4, "failed": 8, "errors": 0}
    back = CliRunner().invoke(cli, ["compare", str(after), str(before), "--json"], catch_exceptions=False)
    assert back.exit_code == 0


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["before"], "takes the results of 2 to 50 campaigns, not of 1"),
        (["before", "run.mcap"], "either recordings or results of campaigns"),
        (["before", "before"], "given the same file twice"),
        (["before", "none"], "no such file"),
        (["before", "empty"], "has no run yet; run the campaign first"),
    ],
)
def test_compare_command_refuses_invalid_input(
    before: Path, tmp_path: Path, files: list[str], message: str
) -> None:
    empty = tmp_path / "empty.sqlite"
    with sqlite3.connect(before) as source, sqlite3.connect(empty) as target:
        source.backup(target)
        target.execute("DELETE FROM runs")
    source.close()
    target.commit()
    target.close()
    names = {"before": str(before), "run.mcap": "run.mcap", "none": "none.sqlite", "empty": str(empty)}
    arguments = ["compare", *(names[name] for name in files), "--output", str(tmp_path / "page.html")]
    with pytest.raises(ConfigError, match=message):
        CliRunner().invoke(cli, arguments, catch_exceptions=False)
