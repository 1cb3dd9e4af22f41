"""`--json` of `campaign compare`, `rerun`, `hunt` and `export`: the values of their text, and nothing else."""

import json
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.lab.campaign.store import Store
from tests.campaign.conftest import SHORT


def told(*arguments: object, code: int = 0) -> Any:
    """The JSON that a command of campaigns prints."""
    ended = CliRunner().invoke(cli, ["campaign", *map(str, arguments), "--json"], catch_exceptions=False)
    assert ended.exit_code == code, ended.output
    return json.loads(ended.stdout)


@pytest.fixture
def slower(short_results: Path, tmp_path: Path) -> tuple[Path, str]:
    """Results in which one run pressed 2 N more, and its key."""
    place = tmp_path / "slower.sqlite"
    with sqlite3.connect(short_results) as source, sqlite3.connect(place) as target:
        source.backup(target)
        (key,) = target.execute("SELECT key FROM runs WHERE passed ORDER BY key").fetchone()
        target.execute(
            "UPDATE runs SET figures = json_set(figures, '$.force_true_max_n', "
            "json_extract(figures, '$.force_true_max_n') + 2.0) WHERE key = ?",
            (key,),
        )
    source.close()
    target.commit()
    target.close()
    return place, key


@pytest.mark.full
def test_compare_names_the_run_that_differs(short_results: Path, slower: tuple[Path, str]) -> None:
    same = told("compare", short_results, short_results)
    assert (same["common"], same["changed"]) == (8, [])
    found = told("compare", short_results, slower[0], code=1)
    assert (found["before"]["results"], found["after"]["results"]) == ("short.sqlite", "slower.sqlite")
    assert (found["common"], found["worse"], found["better"]) == (8, 0, 0)
    (run,) = found["changed"]
    (difference,) = run["differences"]
    assert difference["figure"] == "force_true_max_n"
    assert difference["after"] == pytest.approx(difference["before"] + 2.0)


@pytest.mark.full
def test_rerun_has_the_difference_and_the_recording(slower: tuple[Path, str], tmp_path: Path) -> None:
    results, key = slower
    found = told("rerun", results, key, "-o", tmp_path, code=1)
    assert (found["results"], found["same_code"]) == ("slower.sqlite", True)
    (run,) = found["runs"]
    assert (run["key"], run["outcome"]) == (key, "completed")
    assert [one["figure"] for one in run["differences"]] == ["force_true_max_n"]
    assert Path(run["recording"]).is_file()


def test_export_has_the_files(short_results: Path, tmp_path: Path) -> None:
    found = told("export", short_results, "--to", "csv", "-o", tmp_path)
    assert found == {"files": [str(tmp_path / "short.csv")], "runs": 8}
    assert (tmp_path / "short.csv").is_file()


def test_hunt_has_the_worst_run(tmp_path: Path) -> None:
    plan = SHORT.replace("[[campaign.fault]]", "faults_per_run = 1\n[[campaign.fault]]", 1)
    plan = plan.replace("[campaign.matrix]\n", "").replace("task.force_n = [8.0, 10.0]\n", "")
    (tmp_path / "plan.toml").write_text(plan)
    place = tmp_path / "hunt.sqlite"
    found = told("hunt", tmp_path / "plan.toml", "--minutes", "0.02", "--workers", "1", "-o", place)
    with Store.open(place) as store:
        runs = {run.key: run for run in store.runs()}
        assert store.fact("worst") == found["worst"]["key"]
    assert (found["results"], found["runs"], found["broken"]) == ("hunt.sqlite", len(runs), 0)
    worst = found["worst"]
    assert worst["outcome"] == runs[worst["key"]].outcome
    assert worst["figures"]["force_bound_n"] == runs[worst["key"]].figures["force_bound_n"]
