"""Campaigns that draw settings and several faults per run, and hunts in the same space."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from hil_bridge.control.course import supervisor
from hil_bridge.control.course.verdict import Allow, Request
from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.drawing import Between, Draw, Setting, fault_of_slot, numbers_of
from hil_bridge.lab.campaign.hunting import badness, hunt, is_broken, plan_hunt, running
from hil_bridge.lab.campaign.judging import Job, configure_run, run
from hil_bridge.lab.campaign.page import page
from hil_bridge.lab.campaign.plan import Plan, faults_of_table
from hil_bridge.lab.campaign.plan_file import PlanErrors, read_plan
from hil_bridge.lab.campaign.shrinking import shrink_bad, smaller
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.working import missing, work
from hil_bridge.lab.commands.campaign import campaign
from hil_bridge.runs.faults.wrong_controller import CONTROLLER_FAULTS
from hil_bridge.runs.replay import replay

pytestmark = pytest.mark.sweep

STUDY = """
[campaign]
name = "drawn"
seeds = { from = 1, to = 6 }
faults_per_run = { from = 1, to = 3 }
[campaign.draw]
task.force_n = { from = 4.0, to = 12.0 }
cell.surface.stiffness_n_m = { from = 2000.0, to = 50000.0, log = true }
pace = [{ run.period_ms = 0 }, { run.period_ms = 2 }]
[[campaign.fault]]
on = "*"
fault = "*"
phase = ["connect", "approach", "track"]
[[campaign.fault]]
on = "controller"
fault = "*"
phase = "track"
[[campaign.fault]]
on = "computer"
fault = "pause"
phase = "track"
after_s = 0.1
with = { seconds = { from = 0.6, to = 2.0 } }
[campaign.criteria]
promises_broken = 0
[config.run]
duration_s = 0.3
[config.sensor]
emulated = "ft300"
[config.task]
retract_mm = 1.0
[config.cell]
start_position_mm = [900.0, -100.0, 590.5]
"""


def planned(folder: Path, text: str = STUDY) -> Plan:
    path = folder / "drawn.toml"
    path.write_text(text)
    return read_plan(path)


def test_seed_draws_settings_and_several_faults(tmp_path: Path) -> None:
    plan = planned(tmp_path)
    (case,) = plan.cases
    tables = [json.loads(plan.table_of(case, seed)) for seed in range(1, 301)]
    assert Counter(len(table["faults"]) for table in tables).keys() == {1, 2, 3}
    stiffness = [table["config"]["cell.surface.stiffness_n_m"] for table in tables]
    assert 2000.0 <= min(stiffness) < 3000.0
    assert 40000.0 < max(stiffness) <= 50000.0
    assert {table["config"]["run.period_ms"] for table in tables} == {0}, "an S3 has no period of 2 ms"
    faults = [fault for table in tables for fault in table["faults"]]
    assert {"controller", "computer", "signal", "robot", "surface"} <= {fault["on"] for fault in faults}
    assert {fault["phase"] for fault in faults if fault["on"] == "controller"} == {"track"}
    pauses = [fault for fault in faults if fault["on"] == "computer"]
    assert all(fault["after_s"] == 0.1 and 0.6 <= fault["with"]["seconds"] <= 2.0 for fault in pauses)
    for table in tables[:40]:
        names = [(fault["on"], fault["fault"]) for fault in table["faults"]]
        assert len(set(names)) == len(names)


def test_draws_are_identical_in_all_processes(tmp_path: Path) -> None:
    plan = planned(tmp_path)
    (case,) = plan.cases
    code = (
        "import sys; from pathlib import Path; from hil_bridge.lab.campaign.plan_file import read_plan;"
        "plan = read_plan(Path(sys.argv[1])); print(plan.table_of(plan.cases[0], 5))"
    )
    other = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "drawn.toml")],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONHASHSEED": "7", "PYTHONPATH": ":".join(sys.path)},
    )
    assert other.stdout.strip() == plan.table_of(case, 5)


def test_drawn_numbers_reach_range_limits() -> None:
    between = Between(2.0, 8.0)
    assert (between.value(0.0), between.value(1.0)) == (2.0, 8.0)
    assert Between(1.0, 100.0, log=True).value(0.5) == 10.0
    assert Between(1.0, 3.0, whole=True).value(0.9) == 3
    setting = Setting("a", None, ({"a": 1}, {"a": 2}))
    assert [dict(setting.values(number)) for number in (0.0, 0.49, 0.5, 1.0)] == [
        {"a": n} for n in (1, 1, 2, 2)
    ]
    assert Draw.read(Draw((setting,), ({"on": "*", "fault": "*"},), 1, 2).text).most == 2
    assert numbers_of("1 a", 3) != numbers_of("2 a", 3)


def test_fault_without_ranges_varies_its_defaults() -> None:
    devices = "s3", "netft", ""
    low = fault_of_slot({"on": "signal", "fault": "offset"}, [0.0] * 7, *devices)
    high = fault_of_slot({"on": "signal", "fault": "offset"}, [0.0, 0.0, 1.0, 0.9, 1.0, 1.0, 1.0], *devices)
    assert low["with"] == {"amount": -200.0, "axis": "fx"}
    assert low["for_s"] == 0.05
    assert high["with"] == {"amount": 200.0, "axis": "all"}
    assert "for_s" not in high


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("to = 3 }", "to = 30 }", "campaign.faults_per_run must be a number from 0 to 9"),
        ("from = 4.0, to = 12.0", "from = 12.0, to = 4.0", "campaign.draw.task.force_n must be a range"),
        ("from = 4.0, to = 12.0", "from = 4.0, to = 120.0", "campaign.draw: task.force_n"),
        ("task.force_n =", "task.force =", "campaign.draw: task.force is not a setting"),
        ('on = "*"\n', "", "campaign.fault.0 needs `on` and `fault`"),
        ("seconds = { from = 0.6", "seconds = { low = 0.6", "campaign.fault.2 seconds must be a range"),
    ],
)
def test_invalid_draw_is_refused(tmp_path: Path, old: str, new: str, line: str) -> None:
    assert STUDY.count(old) == 1
    with pytest.raises(PlanErrors) as raised:
        planned(tmp_path, STUDY.replace(old, new))
    assert any(line in problem for problem in raised.value.problems)


def test_drawn_runs_are_repeated_by_key(tmp_path: Path) -> None:
    plan = planned(tmp_path)
    path = tmp_path / "drawn.sqlite"
    with Store.begin(path, plan) as store:
        work(plan, store, missing(plan, store), workers=1)
        assert missing(plan, store) == []
        runs = list(store.runs())
        assert store.plan().identity == plan.identity
        text = page(store)
    assert len(runs) == 6
    assert "Faults by phase" in text
    assert "? no run had it." in text
    assert all("force_bound_n" in done.figures or done.outcome == "refused" for done in runs)
    ended = CliRunner().invoke(campaign, ["rerun", str(path), runs[3].key, "--output", str(tmp_path)])
    assert ended.exit_code == 0, ended.output
    assert "differs" not in ended.output


LIE = {"on": "controller", "phase": "track", "after_s": 0.1}


@pytest.mark.parametrize("lie", CONTROLLER_FAULTS)
def test_controller_fault_is_reproduced_by_replay(tmp_path: Path, lie: str) -> None:
    (case,) = planned(tmp_path).cases

    def ran(faults: list[dict[str, Any]]) -> Any:
        table = json.dumps({"config": {}, "faults": faults})
        config = configure_run(Job("", 0, case.config, table, 1))
        return config, run(config).result

    _, honest = ran([])
    config, lying = ran([{**LIE, "fault": lie}])
    assert repr(lying.cycles) != repr(honest.cycles)
    assert not any(cycle.differences for cycle in replay(lying.recording, config, forced=False))


def test_combined_faults_begin_together(tmp_path: Path) -> None:
    table = """[[campaign.fault]]
on = "sensor-wire"
fault = "twice"
phase = ["approach", "track"]
together = [{ on = "sensor-wire", fault = "late", with = { ms = { from = 20.0, to = 50.0 } } }]

[campaign.criteria]"""
    head, _, tail = STUDY.partition("[[campaign.fault]]")
    plan = planned(tmp_path, head + table + tail.partition("[campaign.criteria]")[2])
    (case,) = plan.cases
    for seed in range(20):
        copies, late = faults_of_table(plan.table_of(case, seed))[:2]
        assert (copies["fault"], late["fault"]) == ("twice", "late")
        assert (copies["phase"], copies.get("after_s", 0.0)) == (late["phase"], late.get("after_s", 0.0))
        assert 20.0 <= late["with"]["ms"] <= 50.0
    for wrong in ('"late"', '[{ on = "*", fault = "late" }]', '[{ on = "wire" }]'):
        text = head + table.replace(table.partition("together = ")[2].partition("\n")[0], wrong)
        with pytest.raises(ConfigError, match="together"):
            planned(tmp_path, text + tail.partition("[campaign.criteria]")[2])


def test_weighted_option_is_drawn_proportionally(tmp_path: Path) -> None:
    drawn = "task.force_n = [5.0, 8.0]\nwall = [{ weight = 3 }, { cell.surface.wall_at_mm = 20.0 }]"
    head, _, tail = STUDY.partition("[campaign.draw]")
    _, mark, rest = tail.partition("[[campaign.fault]]")
    plan = planned(tmp_path, f"{head}[campaign.draw]\n{drawn}\n\n{mark}{rest}")
    assert plan.draw is not None
    (wall,) = [setting for setting in plan.draw.settings if setting.key == "wall"]
    assert wall.options == ({}, {}, {}, {"cell.surface.wall_at_mm": 20.0})
    with pytest.raises(ConfigError, match="weight must be a whole number from 1 to 1000, got 0"):
        planned(tmp_path, f"{head}[campaign.draw]\n{drawn.replace('= 3', '= 0')}\n\n{mark}{rest}")


def test_hunt_covers_every_draw_of_its_campaign(tmp_path: Path) -> None:
    campaign = planned(tmp_path)
    plan = plan_hunt(campaign)
    (case,) = plan.cases
    assert campaign.draw is not None
    numbers = [numbers_of(str(seed), campaign.draw.dimensions) for seed in range(50)]
    assert [plan.table_for(case, row) for row in numbers] == [
        campaign.table_for(case, row) for row in numbers
    ]
    head, tail = STUDY.partition("[[campaign.fault]]")[0], STUDY.partition("[campaign.criteria]")[2]
    without = head.replace("faults_per_run = { from = 1, to = 3 }\n", "") + "[campaign.criteria]" + tail
    with pytest.raises(ConfigError, match="faults_per_run"):
        plan_hunt(planned(tmp_path, without))


HOLE = (
    STUDY.replace(
        'on = "*"\nfault = "*"',
        'on = "sensor-wire"\nfault = "lost"\nwith = { probability = 1.0, count = 20, way = "from" }',
    )
    .replace("{ from = 1, to = 3 }", "{ from = 1, to = 2 }")
    .replace(
        'on = "controller"\nfault = "*"',
        'on = "controller"\nfault = "deeper"\nwith = { mm = { from = 1.0, to = 30.0 } }',
    )
)


@pytest.mark.full
def test_hunt_finds_and_shrinks_planted_bug(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard accepts every order, so that the force of a faulty controller is unlimited."""

    def allowed(limits: Any, state: Any, request: Request, dt: float) -> Allow:
        return Allow(request.depth, request.position)

    monkeypatch.setattr(supervisor, "_clamp", allowed)
    plan = plan_hunt(planned(tmp_path, HOLE))
    with Store.begin(tmp_path / "hunt.sqlite", plan) as store:
        with running(plan, store, 1, 3.0) as runner:
            runner.advance = lambda count, broken: setattr(runner, "until", 0.0) if broken else None
            worst = hunt(runner)
            assert worst is not None
            assert is_broken(worst)
            assert len(runner.known) < 80
            runner.advance = lambda count, broken: None
            small = shrink_bad(runner, worst, badness)
        assert is_broken(small)
        assert len(small.table) <= len(worst.table)
        (fault,) = faults_of_table(small.table)
        assert fault["on"] == "controller"
        before = len(store.keys())
        with running(plan, store, 1, 10.0) as again:
            assert again.known.keys() == store.keys()
            assert again.done([again.job(plan.cases[0], small.table)]) == [small]
        assert len(store.keys()) == before


def test_shrinking_removes_faults_settings_and_digits() -> None:
    fault = {
        "on": "signal",
        "fault": "offset",
        "phase": "track",
        "after_s": 0.123456,
        "with": {"amount": 9.87},
    }
    table = json.dumps({"config": {"a": 1.2345}, "faults": [fault]})
    steps = [json.loads(text) for text in smaller(table)]
    assert {"config": {"a": 1.2345}, "faults": []} in steps
    assert {"config": {}, "faults": [fault]} in steps
    assert {"config": {"a": 1.0}, "faults": [fault]} in steps
    assert {"config": {"a": 1.2345}, "faults": [{**fault, "with": {"amount": 10.0}}]} in steps
    assert all(len(json.dumps(step)) <= len(table) for step in steps)


@pytest.mark.full
def test_hunt_command_reports_worst_run(tmp_path: Path) -> None:
    planned(tmp_path, HOLE)
    path = tmp_path / "hunt.sqlite"
    output = [
        "hunt",
        str(tmp_path / "drawn.toml"),
        "--minutes",
        "0.05",
        "--workers",
        "1",
        "--output",
        str(path),
    ]
    ended = CliRunner().invoke(campaign, output)
    assert ended.exit_code in (0, 4), ended.output
    assert "the worst:" in ended.output
    assert f"hil-bridge campaign rerun {path} " in ended.output
    with Store.open(path) as store:
        assert "Result of the hunt" in page(store)
