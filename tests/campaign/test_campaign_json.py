"""`--json` of `campaign compare`, `rerun`, `hunt` and `export`: exactly the values of their text."""

import json
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.lab.campaign.store import Store
from tests.campaign.conftest import SHORT


def json_output(*arguments: object, code: int = 0) -> Any:
    """Return the JSON output of a campaign command."""
    ended = CliRunner().invoke(cli, ["campaign", *map(str, arguments), "--json"], catch_exceptions=False)
    assert ended.exit_code == code, ended.output
    return json.loads(ended.stdout)


@pytest.fixture
def slower(short_results: Path, tmp_path: Path) -> tuple[Path, str]:
    """Results in which the force of one run is 2 N larger, and the key of that run."""
    path = tmp_path / "slower.sqlite"
    with sqlite3.connect(short_results) as source, sqlite3.connect(path) as target:
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
    return path, key


@pytest.mark.full
def test_compare_json_lists_differing_run(short_results: Path, slower: tuple[Path, str]) -> None:
    same = json_output("compare", short_results, short_results)
    assert (same["common"], same["changed"]) == (8, [])
    result = json_output("compare", short_results, slower[0], code=1)
    assert (result["before"]["results"], result["after"]["results"]) == ("short.sqlite", "slower.sqlite")
    assert (result["common"], result["worse"], result["better"]) == (8, 0, 0)
    (run,) = result["changed"]
    (difference,) = run["differences"]
    assert difference["figure"] == "force_true_max_n"
    assert difference["after"] == pytest.approx(difference["before"] + 2.0)


@pytest.mark.full
def test_rerun_json_has_difference_and_recording(slower: tuple[Path, str], tmp_path: Path) -> None:
    results, key = slower
    result = json_output("rerun", results, key, "-o", tmp_path, code=1)
    assert (result["results"], result["same_code"]) == ("slower.sqlite", True)
    (run,) = result["runs"]
    assert (run["key"], run["outcome"]) == (key, "completed")
    assert [one["figure"] for one in run["differences"]] == ["force_true_max_n"]
    assert Path(run["recording"]).is_file()


def test_export_has_the_files(short_results: Path, tmp_path: Path) -> None:
    result = json_output("export", short_results, "--to", "csv", "-o", tmp_path)
    assert result == {"files": [str(tmp_path / "short.csv")], "runs": 8}
    assert (tmp_path / "short.csv").is_file()


def test_hunt_json_has_worst_run(tmp_path: Path) -> None:
    plan = SHORT.replace("[[campaign.fault]]", "faults_per_run = 1\n[[campaign.fault]]", 1)
    plan = plan.replace("[campaign.matrix]\n", "").replace("task.force_n = [8.0, 10.0]\n", "")
    (tmp_path / "plan.toml").write_text(plan)
    path = tmp_path / "hunt.sqlite"
    result = json_output("hunt", tmp_path / "plan.toml", "--minutes", "0.02", "--workers", "1", "-o", path)
    with Store.open(path) as store:
        runs = {run.key: run for run in store.runs()}
        assert store.fact("worst") == result["worst"]["key"]
    assert (result["results"], result["runs"], result["broken"]) == ("hunt.sqlite", len(runs), 0)
    worst = result["worst"]
    assert worst["outcome"] == runs[worst["key"]].outcome
    assert worst["figures"]["force_bound_n"] == runs[worst["key"]].figures["force_bound_n"]
