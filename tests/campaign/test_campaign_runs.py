"""Execution of campaigns: each key once, even after a kill; rerun and compare."""

import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.api import simulate
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.lab.campaign import comparison
from hil_bridge.lab.campaign.comparison import compare_campaigns
from hil_bridge.lab.campaign.judging import Job, configure_run, run
from hil_bridge.lab.campaign.page import page
from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.working import missing
from hil_bridge.lab.commands.campaign import campaign
from hil_bridge.record import read
from tests.campaign.study import STUDY, changed, done, study

pytestmark = pytest.mark.full

PATIENCE_S = 90.0
"""Longest wait for a complete process on a busy machine, s."""


def test_only_failed_runs_keep_recordings(results: Path) -> None:
    with Store.open(results) as store:
        runs = list(store.runs())
        assert len(runs) == 8
        stopped = [one for one in runs if not one.passed]
        assert {one.outcome for one in stopped} == {"stopped"}
        assert len(stopped) == 4
        assert sorted(path.name for path in store.folder.iterdir()) == sorted(
            one.recording for one in stopped
        )
        assert read(store.folder / stopped[0].recording).end["outcome"] == "stopped"
        for one in runs:
            force_n = one.figures["force_true_max_n"]
            assert isinstance(force_n, float)
            assert 5.0 < force_n < 20.0 or not one.passed
            assert one.figures.get("struck", 0) == (0 if one.passed else 1)


@pytest.mark.parametrize("fault", [0, 1])
def test_observing_the_truth_does_not_change_run(results: Path, fault: int) -> None:
    with Store.open(results) as store:
        case = store.plan().cases[fault]
    config = configure_run(Job("", fault, case.config, case.table, 1))
    watched, plain = run(config).result, simulate(config)
    assert watched is not None
    assert len(plain.cycles) > 3
    assert repr(watched.cycles) == repr(plain.cycles)
    assert repr(watched.recording.sensors) == repr(plain.recording.sensors)


def test_second_start_of_complete_campaign_runs_nothing(results: Path) -> None:
    with Store.open(results) as store:
        plan, runs = store.plan(), list(store.runs())
        store.put(runs, plan.cases)
        assert len(list(store.runs())) == len(runs)
        assert missing(plan, store) == []
    with sqlite3.connect(results) as connection, pytest.raises(sqlite3.IntegrityError, match="UNIQUE"):
        connection.execute(
            "INSERT INTO runs SELECT 'another', number, config_hash, code, fault, phase, seed, outcome, cause, "
            "passed, failed, figures, wall_s, recording FROM runs LIMIT 1"
        )
    connection.close()


def test_results_of_other_plan_are_not_changed(results: Path, tmp_path: Path) -> None:
    other = read_plan(study(tmp_path, text=STUDY.replace("60", "50")))
    with pytest.raises(ConfigError, match="another plan"):
        Store.begin(results, other)
    text = tmp_path / "notes.sqlite"
    text.write_text("no database, but long enough to be taken for one " * 100)
    with pytest.raises(ConfigError, match="cannot write results to"):
        Store.begin(text, other)
    assert text.read_text().startswith("no database")


def test_additional_seeds_extend_results_file(tmp_path: Path) -> None:
    text = STUDY.replace("[8.0, 10.0]", "[8.0]")
    done(read_plan(study(tmp_path, 1, text)), tmp_path / "a.sqlite")
    plan = read_plan(study(tmp_path, 2, text))
    with Store.begin(tmp_path / "a.sqlite", plan) as store:
        assert sorted(job.seed for job in missing(plan, store)) == [2, 2]


def test_resumed_campaign_has_facts_of_its_file(tmp_path: Path) -> None:
    """Primary figures and requirements do not change any run, and neither do axes that an older results file lacks."""
    plan = read_plan(study(tmp_path, 1))
    with Store.begin(tmp_path / "a.sqlite", plan) as store:
        store.keep("axes", "[]")
    text = (
        STUDY.replace("[campaign]\n", '[campaign]\nrequirements = ["REQ-7"]\n')
        + '[[campaign.primary]]\ntitle = "peak"\ncase = "task.force_n 8.0"\nfigure = "force_true_max_n"\n'
    )
    resumed = read_plan(study(tmp_path, 1, text))
    with Store.begin(tmp_path / "a.sqlite", resumed) as store:
        assert [one.title for one in store.plan().primary] == ["peak"]
        assert store.plan().requirements == ("REQ-7",)
        assert store.plan().axes == plan.axes
    with Store.begin(tmp_path / "a.sqlite", plan) as store:
        assert store.plan().primary == ()


@pytest.mark.skipif(os.name != "posix", reason="SIGKILL")
def test_killed_campaign_resumes_without_duplicates(tmp_path: Path) -> None:
    path, file, seeds = study(tmp_path, 5), tmp_path / "out.sqlite", 5
    command = [
        sys.executable,
        "-m",
        "hil_bridge",
        "campaign",
        str(path),
        "--output",
        str(file),
        "--workers",
        "2",
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    deadline, kept = time.monotonic() + PATIENCE_S, 0
    while kept == 0 and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.05)
        kept = _kept(file)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    kept = _kept(file)
    assert 0 < kept < 4 * seeds
    again = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert again.returncode == 4, again.stderr
    assert f"has {kept} of them already" in again.stdout
    plan = read_plan(path)
    with Store.open(file) as store:
        runs = list(store.runs())
        assert len(runs) == 4 * seeds
        assert {(one.number, one.seed) for one in runs} == {
            (number, seed) for number in range(4) for seed in range(1, seeds + 1)
        }
        assert missing(plan, store) == []
        # two processes and a kill between them change no figure
        for one in runs[:2]:
            case = plan.cases[one.number]
            job = Job(one.key, one.number, case.config, case.table, one.seed)
            assert run(configure_run(job)).figures == one.figures


@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C as a signal")
def test_ctrl_c_ends_all_processes_with_one_line(tmp_path: Path) -> None:
    path, file = study(tmp_path, 50), tmp_path / "out.sqlite"
    command = [
        sys.executable,
        "-m",
        "hil_bridge",
        "campaign",
        str(path),
        "--output",
        str(file),
        "--workers",
        "2",
    ]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    deadline = time.monotonic() + PATIENCE_S
    while _kept(file) == 0 and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # a terminal signals all its processes
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert errors.strip() == f"interrupted: {_kept(file)} runs are kept; the same command resumes"
    deadline = time.monotonic() + PATIENCE_S
    while _is_there(process.pid):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _is_there(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def _kept(path: Path) -> int:
    try:
        with Store.open(path) as store:
            return len(store.keys())
    except (BridgeError, sqlite3.Error):
        return 0


def test_rerun_reproduces_figures_and_saves_recording(results: Path, tmp_path: Path) -> None:
    with Store.open(results) as store:
        key = next(store.runs("passed = 0")).key
    arguments = ["rerun", str(results), key, "--output", str(tmp_path)]
    output = CliRunner().invoke(campaign, arguments, catch_exceptions=False)
    assert output.exit_code == 0, output.output
    assert "differs" not in output.output
    assert read(tmp_path / f"{key}.mcap").end["outcome"] == "stopped"
    with pytest.raises(ConfigError, match="already exists"):
        CliRunner().invoke(campaign, arguments, catch_exceptions=False)
    by_part = ["rerun", str(results), key[:6], "--output", str(tmp_path), "--overwrite"]
    assert CliRunner().invoke(campaign, by_part, catch_exceptions=False).output == output.output
    with pytest.raises(ConfigError, match="runs whose keys begin with ; give a longer key"):
        CliRunner().invoke(campaign, ["rerun", str(results), ""], catch_exceptions=False)
    with pytest.raises(ConfigError, match="no run with the key nothing"):
        CliRunner().invoke(campaign, ["rerun", str(results), "nothing"], catch_exceptions=False)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["report", "."], "is a folder; give a results file in it"),
        (["study.sqlite"], "contains results, not a plan; run `hil-bridge campaign report"),
        (["rpt", "study.sqlite"], "no such file or command 'rpt'; commands: run, hunt"),
    ],
)
def test_misplaced_arguments_are_refused(arguments: list[str], message: str) -> None:
    ended = CliRunner().invoke(campaign, arguments)
    assert ended.exit_code != 0
    assert message in f"{ended.exception} {ended.output}"


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("runs", "number", 99),
        ("runs", "number", 0.5),
        ("runs", "figures", '{"force_true_max_n": [1]}'),
        ("runs", "figures", "["),
        ("runs", "failed", '"all"'),
        ("runs", "wall_s", "long"),
        ("cases", "config", "{}"),
        ("cases", "fault_table", "[" * 5000),
        ("sittings", "workers", b"\xff"),
        ("facts", "value", "-1"),
    ],
)
def test_third_party_results_file_is_refused(
    results: Path, tmp_path: Path, table: str, column: str, value: object
) -> None:
    other = tmp_path / "other.sqlite"
    other.write_bytes(results.read_bytes())
    with sqlite3.connect(other) as connection:
        where = "name = 'cases_per_seed'" if table == "facts" else "rowid = 1"
        connection.execute(f"UPDATE {table} SET {column} = ? WHERE {where}", (value,))
    connection.close()
    with pytest.raises(ConfigError, match=r"^cannot read .*other\.sqlite: "):
        CliRunner().invoke(campaign, ["report", str(other)], catch_exceptions=False)


def test_results_file_without_cases_is_refused(results: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.sqlite"
    other.write_bytes(results.read_bytes())
    with sqlite3.connect(other) as connection:
        connection.execute("DELETE FROM cases")
        connection.execute("DELETE FROM runs")
    connection.close()
    with pytest.raises(ConfigError, match=r"^cannot read .*other\.sqlite: no cases"):
        CliRunner().invoke(campaign, ["report", str(other)], catch_exceptions=False)


def test_rerun_of_a_seed_repeats_every_case(results: Path, tmp_path: Path) -> None:
    output = CliRunner().invoke(campaign, ["rerun", str(results), "--seed", "2", "--output", str(tmp_path)])
    assert output.exit_code == 0, output.output
    assert len(list(tmp_path.glob("*.mcap"))) == 4
    with pytest.raises(ConfigError, match="no run with seed 9"):
        CliRunner().invoke(campaign, ["rerun", str(results), "--seed", "9"], catch_exceptions=False)
    with pytest.raises(ConfigError, match="either the KEY of a run or --seed"):
        CliRunner().invoke(campaign, ["rerun", str(results)], catch_exceptions=False)


def test_rerun_reports_differing_figures(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.sqlite"
    with sqlite3.connect(results) as source, sqlite3.connect(copy) as target:
        source.backup(target)
        target.execute("UPDATE runs SET figures = json_set(figures, '$.cycles', -1)")
        (key,) = target.execute("SELECT key FROM runs WHERE passed").fetchone()
    source.close()
    target.commit()
    target.close()
    output = CliRunner().invoke(campaign, ["rerun", str(copy), key, "--output", str(tmp_path)])
    assert output.exit_code == 1
    assert "differs: cycles -1 →" in output.output


def test_compare_lists_setting_changes_of_equal_runs(results: Path, tmp_path: Path) -> None:
    same = CliRunner().invoke(campaign, ["compare", str(results), str(results)])
    assert same.exit_code == 0
    assert "8 runs in both, 0 of them differ" in same.output
    done(read_plan(study(tmp_path, 1, STUDY.replace("0.3", "0.4"))), tmp_path / "other.sqlite")
    other = CliRunner().invoke(campaign, ["compare", str(results), str(tmp_path / "other.sqlite")])
    assert other.exit_code == 1
    assert other.output.splitlines()[2:4] == [
        "setting run.duration_s: 0.3 → 0.4",
        "4 runs in both, 2 of them differ",
    ]
    assert re.search(r"task.force_n 8.0 \| none  \| seed 1: .*duration_s", other.output)


def test_compare_counts_worse_and_better_runs(results: Path, tmp_path: Path) -> None:
    """A verdict is also given if all changes have the same direction."""
    failing = changed(
        results,
        tmp_path / "failing.sqlite",
        "UPDATE runs SET failed = '[\"a criterion\"]', figures = json_set(figures, '$.force_true_max_n', "
        "json_extract(figures, '$.force_true_max_n') + 2.0) WHERE rowid IN "
        "(SELECT rowid FROM runs WHERE failed = '[]' LIMIT 1)",
    )
    with Store.open(results) as before, Store.open(failing) as after:
        worse, better = compare_campaigns(before, after), compare_campaigns(after, before)
        same = compare_campaigns(before, before)
    assert (worse.differing, better.differing, same.differing) == (1, 1, 0)
    output, back = list(worse.lines), list(better.lines)
    assert output[3] == "1 passed and fail now, 0 failed and pass now"
    assert back[3] == "0 passed and fail now, 1 failed and pass now"
    assert len(list(same.lines)) == 3


def test_compare_lists_changed_outcomes_first(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = changed(
        results,
        tmp_path / "other.sqlite",
        "UPDATE runs SET figures = json_set(figures, '$.force_true_max_n', "
        "json_extract(figures, '$.force_true_max_n') + 2.0)",
        "UPDATE runs SET outcome = 'refused', figures = json_set(figures, '$.outcome', 'refused') "
        "WHERE rowid = (SELECT max(rowid) FROM runs)",
    )
    monkeypatch.setattr(comparison, "LINES", 3)
    with Store.open(results) as before, Store.open(other) as after:
        result = compare_campaigns(before, after)
        lines = list(result.lines)
    named = [line for line in lines if " | seed " in line]
    assert len(named) == 3
    assert "refused" in named[0]
    assert "refused" not in named[1]
    assert lines[-1] == f"and {result.differing - 3} more"
    assert result.differing == 8


def test_results_of_other_format_version_are_refused(results: Path, tmp_path: Path) -> None:
    older = changed(
        results, tmp_path / "older.sqlite", "UPDATE facts SET value = 'form 0' WHERE name = 'format'"
    )
    with pytest.raises(
        ConfigError, match=r"has the format 'form 0' of another version, and this one reads '"
    ):
        Store.open(older)


def test_shipped_campaign_sample_passes(tmp_path: Path) -> None:
    """The complete campaign takes an hour. Any change of the vocabulary draws other runs."""
    campaign = read_plan(Path(__file__).parents[2] / "examples" / "campaigns" / "guard.toml")
    assert campaign.count >= 100
    assert not [case for case in campaign.cases if case.impossible and case.fault == "none"]
    plan = replace(campaign, seeds=(4, 8, 12, 33))
    assert (plan.count, len({case.cell for case, _ in plan.runs()})) == (4, 4)
    done(plan, tmp_path / "guard.sqlite")
    with Store.open(tmp_path / "guard.sqlite") as store:
        runs = list(store.runs())
        assert "error" not in {run.outcome for run in runs}
        assert [run.figures["promises_broken"] for run in runs if run.figures.get("cycles")] != []
        assert "1 in turn; seeds for each case: 0 or 1" in page(store)


def test_command_line_seeds_accumulate(tmp_path: Path) -> None:
    path, file = str(study(tmp_path, 9, STUDY.replace("[8.0, 10.0]", "[8.0]"))), str(tmp_path / "a.sqlite")
    for seeds, kept in (("3", 2), ("1:3", 6)):
        output = CliRunner().invoke(campaign, [path, "--seeds", seeds, "--output", file, "--workers", "1"])
        assert output.exit_code == 4, output.output
        assert f"{kept // 2} passed, {kept // 2} failed" in output.output
    with Store.open(tmp_path / "a.sqlite") as store:
        assert sorted(store.plan().seeds) == [1, 2, 3]
    refused = CliRunner().invoke(campaign, [path, "--seeds", "3:1"])
    assert refused.exit_code == 2
    assert "must be FROM:TO, such as 1:20" in refused.output


def test_campaign_command_prints_all_plan_errors(tmp_path: Path) -> None:
    path = study(tmp_path, text=STUDY.replace("below", "under").replace("[8.0, 10.0]", "8"))
    output = CliRunner().invoke(campaign, [str(path)])
    assert isinstance(output.exception, ConfigError)
    assert output.output.count("hil-bridge: ") == 2
    assert not (tmp_path / "study.sqlite").exists()


def test_results_damaged_during_use_are_reported(tmp_path: Path) -> None:
    plan = read_plan(study(tmp_path))
    path = tmp_path / "study.sqlite"
    with (
        pytest.raises(
            ConfigError, match=r"cannot use the results in .*study\.sqlite: database or disk is full"
        ),
        Store.begin(path, plan),
    ):
        raise sqlite3.OperationalError("database or disk is full")
    for change, expected in (
        ("DROP TABLE runs", "no such table: runs"),
        ("UPDATE facts SET value = 'nonsense' WHERE name = 'criteria'", "Expecting value"),
    ):
        with sqlite3.connect(path) as connection:
            connection.execute(change)
        connection.close()
        result = CliRunner().invoke(campaign, ["report", str(path)])
        assert isinstance(result.exception, ConfigError)
        assert expected in str(result.exception)
