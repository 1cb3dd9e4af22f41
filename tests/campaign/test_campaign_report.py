"""Campaign reports for people and build servers: text, Markdown, JSON, JUnit, and their options."""

import json
import shutil
import statistics
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.criteria import Criterion, Unmet, unmet_of
from hil_bridge.lab.campaign.digest import FigureResult, Tally, digest_of
from hil_bridge.lab.campaign.plan_file import PlanErrors, read_plan
from hil_bridge.lab.campaign.report_text import figures_section, markdown_report, text_report
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.working import missing, work
from hil_bridge.lab.commands.campaign import campaign
from hil_bridge.lab.junit import RECORDING, REQUIREMENT
from tests.campaign.conftest import SHORT
from tests.campaign.study import changed


def invoke(*arguments: object) -> str:
    """Return the output of a command that exits with 0."""
    ended = CliRunner().invoke(campaign, [*map(str, arguments)], catch_exceptions=False)
    assert ended.exit_code == 0, ended.output
    return ended.output


def plan_file(folder: Path, text: str = SHORT) -> Path:
    path = folder / "short.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("bound", "figures", "unmet"),
    [
        ({"below": 10}, {"overshoot_percent": 17.25}, Unmet("overshoot_percent", "17.2 %", "below 10 %")),
        (
            {"below": 10},
            {"overshoot_percent": 10.0004},
            Unmet("overshoot_percent", "10.0004 %", "below 10 %"),
        ),
        ({"below": 10}, {"overshoot_percent": 10.0}, Unmet("overshoot_percent", "10 %", "below 10 %")),
        ({"below": 10}, {"overshoot_percent": 9.0}, None),
        ({"below": 10}, {}, None),
        (
            {"at_least": 1, "at_most": 2},
            {"overshoot_percent": 0.5},
            Unmet("overshoot_percent", "0.500 %", "at most 2 %, at least 1 %"),
        ),
    ],
)
def test_unmet_criterion_shows_value_and_bounds(
    bound: object, figures: dict[str, Any], unmet: Unmet | None
) -> None:
    output = unmet_of([Criterion("overshoot_percent", bound)], figures)
    assert output == (() if unmet is None else (unmet,))


@pytest.mark.parametrize(
    ("figure", "allowed", "title"),
    [
        ("rms_error_n", {"below": 1.5}, "RMS error below 1.5 N"),
        ("contact_losses", 0, "no contact losses"),
        ("retracted", {"is": True, "outcomes": ["completed"]}, "retracted in completed runs"),
        ("retracted", False, "not retracted"),
        ("largest_force_n", 8, "largest force 8 N"),
        ("outcome", ["completed", "stopped", "refused"], "outcome completed, stopped or refused"),
    ],
)
def test_criterion_title_has_words_and_unit(figure: str, allowed: object, title: str) -> None:
    assert Criterion(figure, allowed).title == title


def test_figures_by_cell_agree_with_bounds() -> None:
    result = FigureResult("force_true_max_n", "a cell", 3, 0, 12.9996, 13.0, 13.0004, 13.0, 0.0004, (13.0,))
    ((*_, least, median, largest, _, _),) = figures_section([result]).rows
    assert (least, median, largest) == ("12.9996 N", "13 N", "13.0004 N")


def test_bug_is_counted_separately_from_unmet_criteria(short_results: Path, tmp_path: Path) -> None:
    bug = "UPDATE runs SET outcome = 'error', failed = '[\"no bug\"]', figures = '{\"outcome\": \"error\"}' "
    other = changed(short_results, tmp_path / "bug.sqlite", f"{bug} WHERE rowid = 1")
    with Store.open(other) as store:
        digest = digest_of(store)
    assert digest.tally == Tally(3, 4, 1)
    assert digest.failing[0].outcome == "error"
    assert digest.failing[0].unmet[0] == Unmet("outcome", "error", "no bug")
    assert digest.tally.text == "3 passed, 4 failed, 1 error"


def test_text_report_starts_with_matrix(short_results: Path) -> None:
    lines = invoke("report", short_results, "--text").splitlines()
    assert lines[0] == "short: 4 passed, 4 failed, 0 errors"
    assert lines[2] == "Matrix"
    assert lines[4].split() == ["task.force_n", "8.0", "2/2", "0/2", "✗"]
    with Store.open(short_results) as store:
        digest = digest_of(store)
        assert list(text_report(digest)) == lines
    worst = next(line for line in lines if digest.failing[0].key in line)
    assert worst.endswith("outcome stopped, required completed")
    assert not (short_results.parent / "short.html").exists()


def test_campaign_json_has_documented_keys(short_results: Path) -> None:
    output = json.loads(invoke("report", short_results, "--json"))
    assert output["tally"] == {"passed": 4, "failed": 4, "errors": 0}
    assert [(one["cell"], one["fault"]) for one in output["cases"]] == [
        ("task.force_n 8.0", "none"),
        ("task.force_n 8.0", "robot: emergency-stop"),
        ("task.force_n 10.0", "none"),
        ("task.force_n 10.0", "robot: emergency-stop"),
    ]
    assert {one["key"] for one in output["failing"]} == {
        run.key for run in _runs(short_results) if not run.passed
    }
    force = [one for one in output["figures"] if one["figure"] == "force_true_max_n"]
    stop = "robot: emergency-stop track"
    assert [one["cell"] for one in force] == [
        f"task.force_n {force_n}{fault}" for force_n in (8.0, 10.0) for fault in ("", f"; {stop}")
    ]
    values = [run.figures["force_true_max_n"] for run in _runs(short_results) if run.number == 0]
    assert (force[0]["largest"], force[0]["mean"]) == (max(values), statistics.fmean(values))
    assert force[0]["deviation"] == pytest.approx(statistics.stdev(values))


def _runs(results: Path) -> list[Any]:
    with Store.open(results) as store:
        return list(store.runs())


def test_junit_has_one_test_case_per_run(short_results: Path, tmp_path: Path) -> None:
    path = tmp_path / "runs.xml"
    assert invoke("report", short_results, "--junit", path).splitlines() == [str(path)]
    suite = ElementTree.parse(path).getroot()[0]
    counts = {name: suite.get(name) for name in ("tests", "failures", "errors", "skipped")}
    assert counts == {"tests": "8", "failures": "4", "errors": "0", "skipped": "0"}
    runs = {run.key: run for run in _runs(short_results)}
    for case in suite.iter("testcase"):
        values = {one.get("name"): one.get("value") for one in case.iter("property")}
        run = runs[str(values["key"])]
        assert case.get("name", "").endswith(f", seed {run.seed}")
        assert float(values["cycles"] or "nan") == run.figures["cycles"]
        failure = case.find("failure")
        assert (failure is None) == run.passed
        if failure is not None:
            assert failure.get("message") == "outcome stopped, required completed"
            assert f"campaign rerun short.sqlite {run.key}" in (failure.text or "")


@pytest.mark.full
def test_campaign_junit_has_requirements(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(SHORT.replace("[campaign]", '[campaign]\nrequirements = ["R-1", "R-2"]', 1))
    plan = read_plan(file)
    with Store.begin(tmp_path / "mine.sqlite", plan) as store:
        work(plan, store, missing(plan, store), workers=1)
    invoke("report", tmp_path / "mine.sqlite", "--junit", tmp_path / "runs.xml")
    cases = list(ElementTree.parse(tmp_path / "runs.xml").iter("testcase"))
    assert len(cases) == 8
    for case in cases:
        properties = [(one.get("name"), str(one.get("value"))) for one in case.iter("property")]
        assert [value for key, value in properties if key == REQUIREMENT] == ["R-1", "R-2"]
        recordings = [Path(value) for key, value in properties if key == RECORDING]
        failure = case.find("failure")
        assert len(recordings) == (failure is not None)
        assert all(path.is_file() for path in recordings)


def test_missing_recording_is_not_listed(short_results: Path, tmp_path: Path) -> None:
    alone = changed(short_results, tmp_path / "a.sqlite", "UPDATE cases SET cell = 'alone'")
    invoke("report", alone, "--junit", tmp_path / "a.xml")
    invoke("report", short_results, "--junit", tmp_path / "short.xml")
    assert "ATTACHMENT" not in (tmp_path / "a.xml").read_text()
    assert (tmp_path / "short.xml").read_text().count("[[ATTACHMENT|") == 4


@pytest.mark.parametrize("wrong", ['"R-1"', '[""]', "[1]", '["a\\u0007"]'])
def test_campaign_requirements_must_be_names(tmp_path: Path, wrong: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(SHORT.replace("[campaign]", f"[campaign]\nrequirements = {wrong}", 1))
    with pytest.raises(ConfigError, match='requirements must be a list of names such as "R-12"'):
        read_plan(file)


def test_markdown_report_is_a_summary(short_results: Path, tmp_path: Path) -> None:
    path = tmp_path / "summary.md"
    invoke("report", short_results, "--markdown", path)
    lines = path.read_text().splitlines()
    assert lines[0] == "## ❌ Campaign short: 4 passed, 4 failed, 0 errors"
    assert "| task.force_n 8.0 | 2/2 | 0/2 ✗ |" in lines
    with Store.open(short_results) as store:
        digest = digest_of(store)
    assert sum(f"| {one.key} |" in line for one in digest.failing for line in lines) == 4
    with pytest.raises(ConfigError, match="already exists"):
        invoke("report", short_results, "--markdown", path)


def test_markdown_escapes_plan_texts(short_results: Path, tmp_path: Path) -> None:
    other = changed(short_results, tmp_path / "a.sqlite", "UPDATE cases SET cell = 'a | b <img src=x>'")
    with Store.open(other) as store:
        text = markdown_report(digest_of(store))
    assert "| a \\| b &lt;img src=x>" in text
    assert "<img" not in text


def test_campaign_writes_reports_and_lists_worst_runs(short_results: Path, tmp_path: Path) -> None:
    path, file = plan_file(tmp_path), changed(short_results, tmp_path / "short.sqlite")
    files = ["--junit", tmp_path / "a.xml", "--markdown", tmp_path / "a.md"]
    arguments = [str(one) for one in (path, "--output", file, *files)]
    ended = CliRunner().invoke(campaign, arguments, catch_exceptions=False)
    assert ended.exit_code == 4
    assert "has 8 of them already" in ended.output
    assert ended.output.count("  outcome stopped, required completed\n") == 4
    assert ElementTree.parse(tmp_path / "a.xml").getroot().get("failures") == "4"
    with pytest.raises(ConfigError, match="already exists"):
        CliRunner().invoke(campaign, arguments, catch_exceptions=False)
    as_json = CliRunner().invoke(campaign, [str(path), "--output", str(file), "--json"])
    assert as_json.exit_code == 4
    assert json.loads(as_json.stdout)["tally"]["failed"] == 4


def test_page_links_failed_runs_to_their_reports(short_results: Path, tmp_path: Path) -> None:
    results = changed(short_results, tmp_path / "short.sqlite")
    shutil.copytree(short_results.parent / "short-failed", tmp_path / "short-failed")
    failing = [run for run in _runs(results) if not run.passed]
    (tmp_path / "short-failed" / failing[0].recording).write_bytes(b"damaged")
    invoke("report", results, "--reports", "--output", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    for run in failing:
        assert f'href="short-failed/{run.recording}">Recording</a>' in text
        report = tmp_path / "short-failed" / run.key / "report.html"
        assert report.is_file() == (run is not failing[0])
        assert (f'href="short-failed/{run.key}/report.html">report</a>' in text) == report.is_file()


def test_set_option_overrides_file(tmp_path: Path) -> None:
    path = plan_file(tmp_path)
    plan = read_plan(path, (), {"run.duration_s": 0.7, "cell.surface.stiffness_n_m": 9000.0})
    for case in plan.cases:
        config = json.loads(case.config)
        assert config["run"]["duration_s"] == 0.7
        assert config["cell"]["surface"]["stiffness_n_m"] == 9000.0
    assert plan.identity != read_plan(path).identity
    for key, expected in (
        ("task.force_n", "campaign.matrix.task.force_n sets task.force_n, and so does --set"),
        ("run.seed", "--set cannot give run.seed"),
        ("faults", "--set cannot give faults"),
        ("run.durations", "durations"),
    ):
        with pytest.raises(PlanErrors, match=expected):
            read_plan(path, (), {key: 1})
    assert invoke(path, "--set", "run.duration_s=0.7", "--check") == "short: 4 cases × 2 seeds = 8 runs\n"
    counts = CliRunner().invoke(campaign, [str(path), "--check", "--json"], catch_exceptions=False)
    assert json.loads(counts.stdout) == {"name": "short", "planned": 8, "cases": 4, "seeds": 2}


def test_campaign_help_groups_options_before_commands() -> None:
    for arguments in (["--help"], ["run", "--help"]):
        lines = CliRunner().invoke(campaign, arguments).output.splitlines()
        offsets = [
            lines.index(f"{title}:") for title in ("Runs", "Where they run", "Results", "Other options")
        ]
        assert offsets == sorted(offsets)
        assert any("--set KEY=VALUE" in line for line in lines[offsets[0] : offsets[1]])
        assert any("--junit" in line for line in lines[offsets[2] :])
        assert ("Commands:" in lines) == (arguments == ["--help"])
