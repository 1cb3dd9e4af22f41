"""Page of a campaign, saved and in the browser, and its runs as a table."""

import csv
import json
import math
import re
import sqlite3
from dataclasses import replace
from html.parser import HTMLParser
from itertools import combinations
from pathlib import Path
from platform import python_version
from socket import gethostname

import pytest
from click.testing import CliRunner

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign import live
from hil_bridge.lab.campaign.criteria import Criterion
from hil_bridge.lab.campaign.digest import values_of, worst_first
from hil_bridge.lab.campaign.live import Results
from hil_bridge.lab.campaign.page import page, point
from hil_bridge.lab.campaign.pictures import matrix
from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.lab.campaign.run_text import faults_of_run
from hil_bridge.lab.campaign.spreads import distributions
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.working import missing, work
from hil_bridge.lab.commands.campaign import campaign
from hil_bridge.record import read
from hil_bridge.show.charts.cell import cell_picture
from tests.campaign.study import STUDY, changed, study


@pytest.mark.full
def test_live_page_equals_saved_page(results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page is sent once, and again when another process has changed the file."""
    monkeypatch.setattr(live, "POLL_S", 0.0)
    monkeypatch.setattr(live, "REST_FACTOR", 0.0)
    other = changed(results, tmp_path / "study.sqlite")
    with Store.open(other) as store:
        in_browser = Results(store)
        first = in_browser.first()
        updates = in_browser.updates(first)
        assert updates is not None
        assert f"<body>\n{updates['body']}\n<script>" in page(store)
        assert (updates["title"], updates["trouble"]) == ("Campaign study", "")
        assert [in_browser.updates(first) for _ in range(25)] == [None] * 25  # nothing is said twice
        changed_by_another(other, "DELETE FROM runs WHERE passed")
        again = in_browser.updates(first)
        assert again is not None
        assert "4 of 8 runs done" in again["body"]
        changed_by_another(other, "UPDATE runs SET figures = '['")
        broken = in_browser.updates(first)
        assert broken is not None
        assert broken["trouble"].startswith("cannot read ")
        assert broken["body"] == again["body"]
        assert in_browser.updates(in_browser.first()) == broken  # a new page receives everything
        with pytest.raises(ValueError, match="accepts no messages"):
            in_browser.handle_request(first, {"at": 1})


def changed_by_another(path: Path, sql: str) -> None:
    """Change results as another process would."""
    with sqlite3.connect(path) as connection:
        connection.execute(sql)
    connection.close()


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "br", "wbr"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in ("line", "path", "rect")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_page_shows_cells_worst_runs_and_gaps(results: Path, tmp_path: Path) -> None:
    with Store.open(results) as store:
        text, worst = page(store), next(store.runs("passed = 0")).key
    tags = _Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.links == []
    assert '<span class="badge bad">4 of 8 failed</span>' in text
    assert '<b class="good">4</b> passed' in text
    assert '<b class="bad">4</b> failed' in text
    assert "<b>0</b> errors" in text
    assert (
        '<p class="point">2 of 4 cases have failed runs; every failed run missed “outcome completed”.' in text
    )
    headings = (
        "Each case of the matrix",
        "The worst run",
        "Criteria",
        "3 more that failed",
        "Not exercised",
    )
    assert sorted(headings, key=text.index) == [*headings]
    assert f'<td class="value">{gethostname()}</td>' in text
    assert f"Python {python_version()}" in text
    assert re.search(r'Date</td><td class="value">\d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC', text)
    assert "<td>outcome</td><td>stopped</td><td>completed</td>" in text  # figure, value, bound
    for cell in ("task.force_n 8.0", "task.force_n 8.0; robot: emergency-stop track"):
        titled = (("text", "figure", "largest true force"), ("text", "cell", cell), ("count", "runs", "2"))
        row = (f'<td class="{style}" data-title="{title}">{value}</td>' for style, title, value in titled)
        assert "".join(row) in text
    assert '<th class="over" colspan="2">task.force_n</th>' in text
    fields = re.findall(
        r'<td class="(\w+) l(\d)" data-title="8.0"><b>(\d/\d)</b><small>(.*?) N</small>', text
    )
    assert [(style, count) for style, _, count, _ in fields] == [("pass", "2/2"), ("fail", "0/2")]
    least = {"pass": 0, "fail": 2}
    shades = [max(math.ceil(float(force) / 60.0 * 5.0), least[style]) for style, _, _, force in fields]
    assert [int(level) for _, level, _, _ in fields] == shades, "60 N is the bound"
    assert re.findall(r'<rect class="(\w+ \w+)"', text) == ["passed completed", "failed stopped"]
    assert text.count("<article>") == 4
    assert "The run was stopped" in text
    assert "Check: " in text  # the paragraph of `why`
    assert "and the plan does not inject: robot: safeguard-stop" in text
    copied = f"<code>hil-bridge campaign rerun study.sqlite {worst}</code><button"
    assert copied in text
    rows = re.findall(r"<tr><td class=\"text\"[^>]*>([^<]*(?:completed|runs))</td>(.*?)</tr>", text)
    counts = {words: re.findall(r'<td class="([^"]*)"[^>]*>(\d+)<', row) for words, row in rows}
    assert counts["outcome completed"] == [("count", "4"), ("count bad", "4"), ("count", "0")]
    unmet = counts["overshoot below 1000 % in interrupted runs"]
    assert unmet == [("count", "0"), ("count", "0"), ("count", "8")], "met, not met, not applicable"
    out = tmp_path / "page.html"
    assert CliRunner().invoke(campaign, ["report", str(results), "--output", str(out)]).exit_code == 0
    linked = _Tags()
    linked.feed(out.read_text())
    assert len(linked.links) == 4
    assert all((tmp_path / link).is_file() for link in linked.links)  # relative to the page
    with pytest.raises(ConfigError, match="already exists"):
        CliRunner().invoke(campaign, ["report", str(results), "--output", str(out)], catch_exceptions=False)


def test_page_of_incomplete_campaign_says_so(results: Path, tmp_path: Path) -> None:
    part = changed(results, tmp_path / "part.sqlite", "DELETE FROM runs WHERE seed = 2")
    with Store.open(part) as store:
        assert '<span class="badge bad">2 of 4 failed · 4 not run</span>' in page(store)
    failed = changed(part, tmp_path / "failed.sqlite", "DELETE FROM runs WHERE passed")
    with Store.open(failed) as store:
        assert "All 2 cases run so far failed; every run missed “outcome completed”." in page(store)
    passed = changed(part, tmp_path / "passed.sqlite", "DELETE FROM runs WHERE NOT passed")
    with Store.open(passed) as store:
        assert '<span class="badge plain">all 2 passed · 6 not run</span>' in page(store)


TWO_AXES = """
robot = [{ label = "s3", robot.emulated = "s3" }, { label = "egm", robot.emulated = "egm" }]
task.force_n = [8.0, 9.0, 10.0]
"""


def test_matrix_of_one_fault_has_an_axis_as_columns(tmp_path: Path) -> None:
    text = re.sub(r"task.force_n = .*?(?=\[campaign.criteria)", TWO_AXES, STUDY, flags=re.DOTALL)
    plan = read_plan(study(tmp_path, 1, text))
    marked = matrix(plan, ())
    assert re.findall(r'<th class="over" colspan="3">(.*?)</th>', marked) == ["task.force_n"]
    assert re.findall(r'<tr><th data-title="robot">(.*?)</th>', marked) == ["s3", "egm"]
    assert re.findall(r'data-title="([^"]*)"><b>\?<', marked) == ["8.0", "9.0", "10.0"] * 2
    with Store.begin(tmp_path / "a.sqlite", plan) as store:
        assert store.plan().axes == plan.axes
    assert matrix(replace(plan, axes=()), ()) == marked, "results of earlier versions have no axes"


@pytest.mark.parametrize(("times", "dots"), [(1, 8), (3, 0)])
def test_distribution_has_dots_for_few_runs(results: Path, times: int, dots: int) -> None:
    """Eight runs are eight dots, and 24 are bars. A figure that only four of eight runs have is folded."""
    with Store.open(results) as store:
        plan, runs = store.plan(), list(store.runs()) * times
    first, _, folded = distributions(plan, runs).partition('<details class="fold" id="distributions">')
    force = first.partition("</figure>")[0]
    assert "force_true_max_n" in force
    assert (force.count("<circle"), "<rect" in force) == (dots, dots == 0)
    assert dots == 0 or "rms_error_n" in folded


def test_page_draws_worst_run_from_its_recording(results: Path, tmp_path: Path) -> None:
    with Store.open(results) as store:
        plain, text = page(store), page(store, tmp_path / "page.html")
        key, recording = store.fact("worst"), worst_first(store.plan().criteria, store.runs())[0].recording
        times = cell_picture(read(store.folder / recording))["rows"]["cycle"]["x"]
    assert key == "", "a campaign is no hunt"
    assert "data-cell=" not in plain
    assert json.loads(re.findall(r'id="data-cell">(.*)</script>', text)[0])["rows"]["cycle"]["x"] == times
    assert "From the recording of the run." in text
    assert len(text) - len(plain) < 250_000


def test_page_repeats_hardest_run_without_recording(results: Path, tmp_path: Path) -> None:
    passed = changed(results, tmp_path / "passed.sqlite", "DELETE FROM runs WHERE NOT passed")
    altered = changed(
        results,
        tmp_path / "altered.sqlite",
        "DELETE FROM runs WHERE NOT passed",
        "UPDATE runs SET figures = json_set(figures, '$.cycles', 1)",
    )
    slow = changed(
        results, tmp_path / "slow.sqlite", "DELETE FROM runs WHERE NOT passed", "UPDATE runs SET wall_s = 99"
    )
    texts = []
    for path in (passed, altered, slow):
        with Store.open(path) as store:
            texts.append(page(store, tmp_path / "page.html"))
    ended = "Every run so far met every criterion; largest true force"
    assert re.search(rf"{ended} \S+\sN \(required: below 60\sN\)\.", texts[0])
    assert "Show this run in three dimensions" in texts[0]
    assert "The run was repeated for this picture; all figures are the same." in texts[0]
    assert "The run was repeated for this picture; figures that differ from the results: 1." in texts[1]
    assert "data-cell=" not in texts[2], "a run of 99 s is not repeated for a picture"


def test_point_names_force_nearest_to_its_bound(results: Path) -> None:
    """All runs passed; the bounds include the increase due to the faults of each run."""
    with Store.open(results) as store:
        plan, (run, *_) = replace(store.plan(), criteria=()), store.runs("passed")
        forces = ((64.0, -368.0), (62.5, -1.5))
        runs = [
            replace(
                run, seed=seed, figures={**run.figures, "force_true_max_n": force, "force_beyond_n": beyond}
            )
            for seed, (force, beyond) in enumerate(forces)
        ]
    text = point(plan, runs, 2)
    assert text == (
        "Every run met every criterion; largest true force 64 N; nearest to its bound: 62.5 N of 64 N."
    )


def test_distributions_begin_with_most_information(results: Path) -> None:
    """Of two figures in 100 runs, one is 0 in all runs but one; the heights of its bars are logarithmic."""
    with Store.open(results) as store:
        plan, (run, *_) = replace(store.plan(), criteria=()), store.runs()
    runs = [
        replace(run, figures={"cycles": float(k == 7), "overshoot_percent": float(k)}) for k in range(100)
    ]
    first, second = distributions(plan, runs).split("</figure>")[:2]
    assert ("overshoot_percent" in first, "cycles" in second) == (True, True)
    assert [re.findall(r">([^<]*runs?[^<]*)</text>", one) for one in (first, second)] == [
        ["5 runs"],
        ["10 runs, logarithmic"],
    ]
    heights = [float(height) for height in re.findall(r'<rect .*?height="(.*?)"', second)]
    assert heights[1] / heights[0] == pytest.approx(math.log(2) / math.log(100), abs=0.01)


def test_dots_of_near_values_do_not_hide_each_other(results: Path) -> None:
    with Store.open(results) as store:
        plan, (run, *_) = replace(store.plan(), criteria=()), store.runs()
    values = (0.0, 0.1, 0.15, 0.3, 4.0, 4.2, 10.0)
    picture = distributions(plan, [replace(run, figures={"overshoot_percent": value}) for value in values])
    dots = [(float(x), float(y)) for x, y in re.findall(r'<circle cx="(.*?)" cy="(.*?)"', picture)]
    assert len(dots) == len(values)
    assert min(math.dist(one, other) for one, other in combinations(dots, 2)) > 7.9


def test_distribution_leaves_extreme_values_outside_axis(results: Path) -> None:
    with Store.open(results) as store:
        plan, (run, *_) = store.plan(), store.runs()
    values = [*map(float, range(200)), -7e14, 1e4]
    runs = [replace(run, figures={"duration_s": value}) for value in values]
    drawn = distributions(plan, runs)
    assert re.findall(r'<text x="\d+" y="\d+"[^>]*>([^<]*)<', drawn) == ["1", "198"]
    assert "202 runs" in drawn
    assert "least −7.00e+14, largest 10000; 4 outside the axis" in drawn
    assert "outside" not in distributions(plan, runs[:200])


def test_distribution_marks_dots_that_miss_a_criterion(results: Path) -> None:
    with Store.open(results) as store:
        plan, runs = store.plan(), list(store.runs())
    limited = replace(plan, criteria=(Criterion("cycles", {"below": max(values_of("cycles", runs))}),))
    missing = sum(limited.criteria[0].judge(run.figures) is False for run in runs)
    assert 0 < missing < len(runs)
    assert distributions(limited, runs).count('<circle class="bad"') == missing
    assert 'class="bad"' not in distributions(replace(plan, criteria=()), runs)


def test_drawn_faults_have_three_digits(results: Path) -> None:
    fault = {"on": "wire", "fault": "lost", "with": {"probability": 0.442271}, "after_s": 0.153084}
    with Store.open(results) as store:
        case, (run, *_) = store.plan().cases[0], store.runs()
    drawn = replace(run, table=json.dumps({"config": {}, "faults": [{**fault, "phase": "track"}]}))
    assert faults_of_run(case, drawn) == "wire: lost (probability 0.442, after_s 0.153) track"


def test_page_without_recordings_shows_cause(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "alone.sqlite"
    with sqlite3.connect(results) as source, sqlite3.connect(copy) as target:
        source.backup(target)
        target.execute("DELETE FROM runs WHERE seed = 1 AND passed")
    source.close()
    target.close()
    with Store.open(results) as store:
        again = [
            replace(run, figures={**run.figures, "rise_s": math.inf})
            for run in store.runs("seed = 1 AND passed")
        ]
    with Store.open(copy) as store:
        store.put(again, store.plan().cases)
        assert [run.figures["rise_s"] for run in store.runs("seed = 1 AND passed")] == [math.inf, math.inf]
        text = page(store)
    assert "The run was stopped" not in text
    assert "<p>stopped: the robot " in text
    assert "2 runs: never" in text


def test_runs_as_a_table(results: Path, tmp_path: Path) -> None:
    output = CliRunner().invoke(
        campaign, ["export", str(results), "--to", "csv", "--output", str(tmp_path / "new")]
    )
    assert output.exit_code == 0, output.output
    rows = list(csv.DictReader((tmp_path / "new" / "study.csv").read_text().splitlines()))
    with Store.open(results) as store:
        runs = list(store.runs())
        cell = store.plan().cases[runs[0].number].cell
    assert [row["key"] for row in rows] == [run.key for run in runs]
    assert [row["passed"] for row in rows] == [str(run.passed) for run in runs]
    assert [float(row["cycles"]) for row in rows] == [run.figures["cycles"] for run in runs]
    assert rows[0]["cell"] == cell
    assert {row["struck"] for row in rows if row["fault"] == "none"} == {""}
    again = ["export", str(results), "--to", "csv", "--output", str(tmp_path / "new")]
    with pytest.raises(ConfigError, match="already exists"):
        CliRunner().invoke(campaign, again, catch_exceptions=False)


def test_parquet_table_matches_csv(results: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    output = CliRunner().invoke(
        campaign, ["export", str(results), "--output", str(tmp_path)], catch_exceptions=False
    )
    assert output.exit_code == 0
    columns = parquet.read_table(tmp_path / "study.parquet").to_pydict()
    with Store.open(results) as store:
        runs = list(store.runs())
    assert columns["key"] == [run.key for run in runs]
    assert columns["force_true_max_n"] == [run.figures["force_true_max_n"] for run in runs]


def test_page_before_first_run_lists_all_cells(tmp_path: Path) -> None:
    text = STUDY.replace("emergency-stop", "late-answer")
    plan = read_plan(study(tmp_path, 1, text))
    with Store.begin(tmp_path / "a.sqlite", plan) as store:
        assert page(store).count("<b>?</b></td>") == 4
        work(plan, store, missing(plan, store)[:1], workers=1)
        assert page(store).count("<b>?</b></td>") == 3
