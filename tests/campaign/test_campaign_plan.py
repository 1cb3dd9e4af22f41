"""Campaign file: the resulting plan, and a one-line error for every mistake."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.criteria import Criterion, find_unmet
from hil_bridge.lab.campaign.digest import worst_first
from hil_bridge.lab.campaign.plan import code_version, seeds_of
from hil_bridge.lab.campaign.plan_file import PlanErrors, read_plan
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.record.analysis.figures import meaning_rows
from tools.pages import placed, table

EXAMPLES = Path(__file__).parents[2] / "examples" / "campaigns"
HEAD = '[campaign]\nseeds = [1, 2]\n[campaign.criteria]\noutcome = "completed"\n'
STOP = '[[campaign.fault]]\non = "robot"\nfault = "emergency-stop"\nphase = ["approach", "track"]\n'


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(text)
    return path


def test_plan_combines_matrix_faults_and_seeds(tmp_path: Path) -> None:
    matrix = '[campaign.matrix]\ntask.force_n = [8.0, 10.0]\n"robot.emulated" = ["s3", "rtde"]\n'
    plan = read_plan(written(tmp_path, HEAD + matrix + STOP))
    assert plan.name == "study"
    assert [(case.cell, case.fault, case.phase) for case in plan.cases][:3] == [
        ("task.force_n 8.0, robot.emulated s3", "none", ""),
        ("task.force_n 8.0, robot.emulated s3", "robot: emergency-stop", "approach"),
        ("task.force_n 8.0, robot.emulated s3", "robot: emergency-stop", "track"),
    ]
    assert len(plan.cases) == 4 * 3
    assert plan.count == 24
    code = code_version()
    assert len({case.key(code, seed) for case, seed in plan.runs()}) == 24


def test_matrix_axis_of_tables_sets_several_settings(tmp_path: Path) -> None:
    matrix = '[campaign.matrix]\nforce = [{ label = "soft", task.force_n = 5.0, run.duration_s = 2.0 }]\n'
    (case,) = read_plan(written(tmp_path, HEAD + matrix)).cases
    assert case.cell == "force soft"
    assert '"force_n":5.0' in case.config
    assert '"duration_s":2.0' in case.config


def test_seeds_rotate_evenly_through_cases(tmp_path: Path) -> None:
    matrix = '[campaign.matrix]\ntask.force_n = [8.0, 9.0, 10.0]\n"robot.emulated" = ["s3", "rtde"]\n'
    drop = '[[campaign.fault]]\non = "wire"\nfault = "drop-ack"\n'  # nine cases of twelve can be
    head = HEAD.replace("seeds = [1, 2]", "seeds = { from = 5, to = 24 }\ncases_per_seed = 2")
    plan = read_plan(written(tmp_path, head + matrix + drop))
    runs = list(plan.runs())
    assert (plan.count, len(runs), len(set(runs))) == (40, 40, 40)
    turns = Counter(case for case, _ in runs)
    assert set(turns) == set(plan.possible)
    assert sorted(turns.values()) == [4] * 5 + [5] * 4
    assert plan.identity != replace(plan, cases_per_seed=0).identity
    # A seed has the same cases whatever other seeds there are.
    alone = read_plan(tmp_path / "study.toml", seeds_of("7"))
    assert alone.identity == plan.identity
    assert list(alone.runs()) == [(case, seed) for case, seed in runs if seed == 7]


@pytest.mark.parametrize("text", ["", "3:2", "-1:2", "a", "1:2:3", "1:99999999"])
def test_invalid_seeds_text_is_refused(text: str) -> None:
    assert seeds_of("3:5") == (3, 4, 5)
    with pytest.raises(ValueError, match=r"seeds|invalid literal"):
        seeds_of(text)


def test_plan_combines_file_and_own_configuration(tmp_path: Path) -> None:
    (tmp_path / "cell.toml").write_text("[task]\nforce_n = 7.0\nspeed_mm_s = 4.0\n")
    text = HEAD.replace("seeds", 'config = "cell.toml"\nseeds') + "[config.task]\nforce_n = 6.0\n"
    (case,) = read_plan(written(tmp_path, text)).cases
    assert '"force_n":6.0' in case.config
    assert '"speed_mm_s":4.0' in case.config


def test_unsupported_fault_is_kept_as_impossible(tmp_path: Path) -> None:
    matrix = '[campaign.matrix]\n"robot.emulated" = ["s3", "rtde"]\n'
    drop = '[[campaign.fault]]\non = "wire"\nfault = "drop-ack"\n'
    plan = read_plan(written(tmp_path, HEAD + matrix + drop))
    assert [bool(case.impossible) for case in plan.cases] == [False, False, False, True]
    assert len(plan.possible) == 3


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("", ["the table [campaign] is missing"]),
        (HEAD + "[more]\n", ["more is not a table of a campaign; known: campaign, config"]),
        (HEAD.replace("seeds", "seed"), ["campaign.seed is not a setting", "campaign.seeds must be a list"]),
        (
            HEAD.replace("seeds = [1, 2]\n", ""),
            ["campaign.seeds must be a list of whole numbers from 0, or { from = 1, to = 50 }"],
        ),
        (HEAD.replace("[1, 2]", "[1, 1]"), ["campaign.seeds contains a seed twice"]),
        (
            HEAD.replace("seeds", "cases_per_seed = 2\nseeds"),
            ["campaign.cases_per_seed is more than the 1 cases"],
        ),
        (HEAD.replace("seeds", "cases_per_seed = 0.5\nseeds"), ["campaign.cases_per_seed must be a whole"]),
        (HEAD.replace("[1, 2]", "{ from = 3, to = 2 }"), ["campaign.seeds must be a list"]),
        (
            HEAD.replace("outcome", "outcomes"),
            ["campaign.criteria.outcomes is not a figure; known: outcome"],
        ),
        (HEAD.replace('"completed"', '"done"'), ["campaign.criteria.outcome must be one or a list of"]),
        (
            HEAD + "rise_s = { under = 1 }\n",
            ["campaign.criteria.rise_s has an unknown key 'under'; known: below, above"],
        ),
        (
            HEAD + "rise_s = { below = nan }\n",
            ["campaign.criteria.rise_s below must be a number, got nan"],
        ),
        (HEAD + "retracted = 1\n", ["campaign.criteria.retracted must be true or false"]),
        (HEAD + '[campaign.matrix]\n"task.force" = [1.0]\n', ["task.force is not a setting"]),
        (HEAD + '[campaign.matrix]\n"task.force_n" = 1.0\n', ["campaign.matrix.task.force_n must be a list"]),
        (HEAD + '[campaign.matrix]\n"run.seed" = [1]\n', ["campaign.matrix.run.seed cannot be an axis"]),
        (HEAD + '[config.robot]\nurl = "tcp://host:1"\n', ["robot.url: a campaign runs on"]),
        (
            HEAD + STOP.replace("emergency-stop", "hiccup"),
            ["campaign.fault.1: ", "campaign.fault.2: "],
        ),
        (HEAD.replace("seeds", 'config = "nowhere.toml"\nseeds'), ["campaign.config: cannot read"]),
    ],
)
def test_plan_errors_are_reported_before_first_run(tmp_path: Path, text: str, lines: list[str]) -> None:
    with pytest.raises(PlanErrors) as raised:
        read_plan(written(tmp_path, text))
    problems = raised.value.problems
    assert len(problems) == len(lines)
    for problem, line in zip(problems, lines, strict=True):
        assert line in problem
        assert problem.startswith(str(tmp_path / "study.toml"))
        assert "\n" not in problem


LARGE = "guard"
"""Large example, also read by tests/campaign/test_campaign_runs.py."""


@pytest.mark.full
@pytest.mark.parametrize("name", sorted({path.stem for path in EXAMPLES.glob("*.toml")} - {LARGE}))
def test_example_files_are_valid_plans(name: str) -> None:
    plan = read_plan(EXAMPLES / f"{name}.toml")
    assert plan.count >= 100
    assert not [case for case in plan.cases if case.impossible and case.fault == "none"]


def test_documented_plan_is_valid(tmp_path: Path) -> None:
    text = (EXAMPLES.parents[1] / "docs" / "reference" / "campaigns.md").read_text(encoding="utf-8")
    (tmp_path / "cell.toml").write_text("[task]\nspeed_mm_s = 4.0\n")
    plan = read_plan(written(tmp_path, text.partition("```toml\n")[2].partition("```")[0]))
    assert plan.name == "two forces"
    assert (len(plan.cases), len(plan.possible), len(plan.seeds)) == (12, 12, 50)
    assert placed(text, {"figures": table(("figure", "words", "meaning", "good"), meaning_rows())}) == text


def test_invalid_toml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is not valid TOML"):
        read_plan(written(tmp_path, "[campaign"))


@pytest.mark.parametrize(
    ("figure", "bound", "figures", "met"),
    [
        ("outcome", ["completed", "stopped"], {"outcome": "stopped"}, True),
        ("outcome", "completed", {"outcome": "stopped"}, False),
        ("rise_s", {"below": 1.0}, {"rise_s": 1.0}, False),
        ("rise_s", {"at_most": 1.0}, {"rise_s": 1.0}, True),
        ("rise_s", {"above": 0.0, "below": 1.0}, {"rise_s": -1.0}, False),
        ("rise_s", {"below": 1.0}, {"rise_s": None}, None),
        ("rise_s", {"below": 1.0, "outcomes": ["completed"]}, {"rise_s": 2.0, "outcome": "stopped"}, None),
        ("retracted", True, {"retracted": False}, False),
        (
            "retracted",
            {"is": True, "outcomes": ["completed"]},
            {"retracted": False, "outcome": "stopped"},
            None,
        ),
        ("retracted", {"is": True}, {"retracted": False}, False),
        ("struck", 0, {"struck": 0}, True),
    ],
)
def test_criterion_judges(figure: str, bound: Any, figures: Any, met: bool | None) -> None:
    assert Criterion(figure, bound).judge(figures) is met


def test_bug_fails_every_run() -> None:
    assert find_unmet([], {"outcome": "error"}) == ["no bug"]


def test_oversized_matrix_is_refused(tmp_path: Path) -> None:
    axes = "".join(f"task.number_{n} = {[*range(1000)]}\n" for n in range(9))
    with pytest.raises(PlanErrors, match="makes more than 100000 cells"):
        read_plan(written(tmp_path, HEAD + "[campaign.matrix]\n" + axes))


@pytest.mark.parametrize("text", [f"{2**63}", f"0:{10**30}"])
def test_seeds_not_in_results_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="invalid seeds"):
        seeds_of(text)


def test_plan_reads_primary_figures(tmp_path: Path) -> None:
    matrix = "[campaign.matrix]\ntask.force_n = [8.0, 10.0]\n"
    primary = '[[campaign.primary]]\ntitle = "step"\ncase = "{}"\nfigure = "{}"\n'
    text = HEAD + matrix + primary
    plan = read_plan(written(tmp_path, text.format("task.force_n 8.0", "step_settle_s")))
    (one,) = plan.primary
    assert (one.title, one.case, one.figure) == ("step", "task.force_n 8.0", "step_settle_s")
    with Store.begin(tmp_path / "study.sqlite", plan) as store:
        assert store.plan().primary == plan.primary
    for case, figure, message in (
        ("task.force_n 9.0", "step_settle_s", "'task.force_n 9.0' is not the label of a case"),
        ("task.force_n 8.0", "outcome", "'outcome' is not a number of a run"),
    ):
        with pytest.raises(PlanErrors, match=message):
            read_plan(written(tmp_path, text.format(case, figure)))
    with pytest.raises(PlanErrors, match="must be tables with title, case and figure"):
        read_plan(written(tmp_path, HEAD + '[[campaign.primary]]\ntitle = "step"\n'))


def test_failed_runs_begin_with_largest_excess() -> None:
    criteria = (Criterion("rms_error_n", {"below": 1.5}), Criterion("retracted", True))
    runs = [
        Done(
            f"{rms}",
            0,
            1,
            "completed",
            "",
            ("rms",),
            {"rms_error_n": rms, "force_true_max_n": force},
            1.0,
            "",
        )
        for rms, force in ((2.53, 30.0), (2.79, 20.0), (1.6, 90.0))
    ]
    assert [run.key for run in worst_first(criteria, runs)] == ["2.79", "2.53", "1.6"]


def test_plan_code_depends_on_source_of_its_plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    law = (
        "from dataclasses import dataclass\nfrom typing import ClassVar\n"
        "@dataclass(frozen=True)\nclass Steady:\n"
        "    name: ClassVar[str] = 'steady-law'\n    sample_ms: ClassVar[float] = 4.0\n"
        "    def initial(self): return None\n"
        "    def step(self, state, measurement, reference): return None, None\n"
    )
    info = tmp_path / "steady-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: steady\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[hil_bridge.controllers]\nsteady-law = steady_module:Steady\n")
    (tmp_path / "steady_module.py").write_text(law)
    monkeypatch.syspath_prepend(str(tmp_path))
    own = read_plan(written(tmp_path, HEAD))
    plan = read_plan(written(tmp_path, HEAD + '[config.controller]\nname = "steady-law"\n'))
    assert (own.plugins, plan.plugins) == ((), ("steady_module",))
    before = plan.code
    assert own.code == code_version() != before
    (tmp_path / "steady_module.py").write_text(law + "# changed\n")
    code_version.cache_clear()
    assert own.code == code_version()
    assert plan.code not in (before, own.code)
