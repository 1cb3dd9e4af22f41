"""Tuning without runs: space, scores, search on a function, front, comparisons, files."""

import json
import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.control.controllers import CONTROLLERS
from hil_bridge.control.types import Range
from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.criteria import Figures
from hil_bridge.lab.tuning.comparing import Comparison, Finding, describe_comparison, sentence
from hil_bridge.lab.tuning.evaluating import Evaluation, Goal, Job, evaluate, scales_of
from hil_bridge.lab.tuning.front import front, picture
from hil_bridge.lab.tuning.preparing import axes_of, limit_of, load_other_cell, tuned_file, weights_of
from hil_bridge.lab.tuning.reporting import as_json, describe_parameters, fresh_comparison
from hil_bridge.lab.tuning.searching import Search, SearchPlan, begin, search
from hil_bridge.lab.tuning.space import space_of
from hil_bridge.lab.tuning.writing import toml
from hil_bridge.settings.configuration import Config, load_config

EXAMPLES = Path(__file__).parents[2] / "examples" / "tuning"


def pi(**parameters: float) -> Config:
    return load_config(None, {"controller.name": "pi", "controller.parameters": parameters})


# --- the space


def test_built_in_controllers_declare_valid_bounds() -> None:
    for name in CONTROLLERS:
        space = space_of(load_config(None, {"controller.name": name}), ())
        assert space.parameters, name
        for parameter in space.parameters:
            assert parameter.default is not None
            assert parameter.range.low <= parameter.default <= parameter.range.high, (name, parameter.name)


def test_space_uses_configured_and_declared_bounds() -> None:
    space = space_of(pi(integral=0.3), ["integral=0.1:1:log", "proportional", "resolution_mm=0.1:0.2"])
    assert space.names == ("integral", "proportional", "resolution_mm")
    assert [one.range for one in space.parameters] == [
        Range(0.1, 1.0, True),
        Range(0.0, 1.0),
        Range(0.1, 0.2),
    ]
    assert space.start == (0.3, 0.2, 0.125)
    low, high = (space.point([bound[end] for bound in space.bounds]) for end in (0, 1))
    assert low == (0.1, 0.0, 0.1)
    assert high == (1.0, 1.0, 0.2)


def test_integers_stay_integers() -> None:
    space = space_of(load_config(None, {"controller.name": "predictive"}), ["window"])
    assert space.parameters[0].whole
    assert space.table(space.point([7.4])) == {"window": 7}


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ("gain=0:1", "pi has no parameter 'gain'"),
        ("tuned_at_n_m", "pi declares no bounds for it; give tuned_at_n_m=LOW:HIGH"),
        ("integral=1", "must be NAME=LOW:HIGH"),
        ("integral=0.1:x", "must be NAME=LOW:HIGH"),
        ("integral=1:0.1", "invalid bounds 1:0.1"),
        ("integral=0:1:log", "bounds with :log must be greater than 0"),
        ("integral=0:1:lin", "must be NAME=LOW:HIGH"),
    ],
)
def test_invalid_bounds_are_refused(vary: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        space_of(pi(), [vary])


# --- scores

GOAL = Goal({"rise_s": 1.0, "overshoot_percent": 1.0}, 20.0, {"rise_s": 2.0, "overshoot_percent": 5.0})


def ended(
    rise_s: float | None, overshoot: float = 5.0, outcome: str = "completed", force: float = 11.0
) -> Figures:
    return {"outcome": outcome, "rise_s": rise_s, "overshoot_percent": overshoot, "force_true_max_n": force}


def test_defaults_score_one_and_failed_runs_score_worst() -> None:
    assert GOAL.score(ended(2.0)) == pytest.approx(1.0)
    assert evaluate(GOAL, (), [ended(2.0), ended(2.0)]).score == pytest.approx(1.0)
    one, two = (evaluate(GOAL, (), [ended(1.0), *[ended(1.0, outcome="stopped")] * k]) for k in (1, 2))
    assert not one.feasible
    assert 1e3 < one.score < two.score
    assert GOAL.failure(ended(1.0, force=20.1)) == "a true force of 20.1 N"
    assert GOAL.failure(ended(None)) == "no rise_s"
    assert GOAL.failure(ended(1.0, outcome="stopped")) == "stopped"


def test_lucky_seed_does_not_win_search() -> None:
    steady = evaluate(GOAL, (), [ended(1.0), ended(1.0)])
    lucky = evaluate(GOAL, (), [ended(0.5), ended(1.5)])
    assert steady.mean("rise_s") == lucky.mean("rise_s")
    assert steady.score < lucky.score


def test_scales_have_a_floor() -> None:
    assert scales_of({"rise_s": 1.0, "overshoot_percent": 1.0}, [ended(2.0, 0.0)]) == {
        "rise_s": 2.0,
        "overshoot_percent": 1.0,
    }


# --- the search


def bowl(jobs: Sequence[Job]) -> list[Figures]:
    """Return synthetic figures of runs: best at integral = 0.9, infeasible above 1.2, with noise by seed."""
    figures = []
    for job in jobs:
        integral = json.loads(job.parameters).get("integral", 0.4)
        rise = 1.0 + (integral - 0.9) ** 2 + 0.01 * (job.seed % 3)
        figures.append(ended(rise, outcome="stopped" if integral > 1.2 else "completed"))
    return figures


def search_plan(budget: int = 150) -> SearchPlan:
    return SearchPlan(space_of(pi(), ["integral"]), {"rise_s": 1.0}, 20.0, (1, 2), budget, seed=1)


def searched(budget: int = 150) -> Search:
    state = begin([pi()], search_plan(budget), bowl)
    search(state, bowl)
    return state


def test_search_finds_best_within_budget() -> None:
    runs = 0

    def counted(jobs: Sequence[Job]) -> list[Figures]:
        nonlocal runs
        runs += len(jobs)
        return bowl(jobs)

    state = begin([pi()], search_plan(), counted)
    search(state, counted)
    assert runs <= 150
    assert state.best is not None
    assert state.best.point[0] == pytest.approx(0.9, abs=0.05)
    assert any(not one.feasible for one in state.tried)
    comparison = fresh_comparison(state)
    assert comparison is not None
    assert comparison.finding is Finding.BETTER
    assert not {*state.plan.seeds} & {*state.plan.fresh}
    assert [one.point for one in searched().tried] == [one.point for one in state.tried]


def test_point_must_be_feasible_in_every_cell() -> None:
    """The second cell has a harder surface, on which the force is unstable above 0.6."""

    def two_cells(jobs: Sequence[Job]) -> list[Figures]:
        result = []
        for job, figures in zip(jobs, bowl(jobs), strict=True):
            hard = json.loads(job.config)["cell"]["surface"]["stiffness_n_m"] > 9000.0
            too_much = json.loads(job.parameters).get("integral", 0.4) > 0.6
            result.append({**figures, "outcome": "stopped"} if hard and too_much else figures)
        return result

    search_plan = SearchPlan(
        space_of(pi(), ["integral"]), {"rise_s": 1.0}, 20.0, (1, 2), 300, seed=1, cells=2
    )
    hard = load_config(None, {"controller.name": "pi", "cell.surface.stiffness_n_m": 10_000.0})
    state = begin([pi(), hard], search_plan, two_cells)
    search(state, two_cells)
    assert state.best is not None
    assert 0.5 < state.best.point[0] <= 0.6
    assert len(state.best.runs) == 2 * len(search_plan.fresh)
    assert len(state.best.cells) == 2
    assert "In 2 cells at once." in tuned_file({}, pi(), state, None)


def test_search_budget_too_small_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"--budget 20: a search with 2 seeds needs at least 28 runs"):
        search_plan(20)


def test_search_without_feasible_point_has_no_best() -> None:
    def fails(jobs: Sequence[Job]) -> list[Figures]:
        return [ended(1.0, outcome="stopped" if json.loads(job.parameters) else "completed") for job in jobs]

    state = begin([pi()], search_plan(40), fails)
    search(state, fails)
    assert state.best is None
    assert "no point met the constraints with every seed" in list(describe_parameters(state))


def test_interrupted_search_keeps_best_point() -> None:
    calls = 0

    def interrupted(jobs: Sequence[Job]) -> list[Figures]:
        nonlocal calls
        calls += 1
        if calls == 4:
            raise KeyboardInterrupt
        return bowl(jobs)

    state = begin([pi()], search_plan(), interrupted)
    with pytest.raises(KeyboardInterrupt):
        search(state, interrupted)
    assert state.best is not None
    text = tuned_file({}, pi(), state, None)
    assert "interrupted: this point was not validated on fresh seeds" in text
    assert tomllib.loads(text)["controller"]["parameters"]["integral"] == state.best.point[0]


# --- use of the result


def point(x: float, y: float, outcome: str = "completed") -> Evaluation:
    return evaluate(GOAL, (x, y), [ended(x, y, outcome)])


def test_front_contains_nondominated_points() -> None:
    tried = [point(1, 9), point(2, 5), point(3, 6), point(4, 1), point(0.1, 0.1, "stopped")]
    assert [one.point for one in front(tried, "rise_s", "overshoot_percent")] == [(1, 9), (2, 5), (4, 1)]
    axes = ("rise_s", "overshoot_percent")
    svg = picture(tried, tried[0], tried[1], axes, "svg")
    assert svg == picture(tried, tried[0], tried[1], axes, "svg")
    assert b"<svg" in svg


@pytest.mark.parametrize(
    ("tuned", "defaults", "finding"),
    [
        ([1.0, 1.1, 1.2], [2.0, 2.1, 2.2], Finding.BETTER),
        ([2.0, 2.1, 2.2], [1.0, 1.1, 1.2], Finding.WORSE),
        ([1.0, 2.0, 3.0], [2.0, 1.0, 3.1], Finding.ALIKE),
        ([1.0, None, 1.0], [2.0, 2.0, 2.0], Finding.FAILS),
        ([1.0, 1.0, 1.0], [None, 2.0, 2.0], Finding.SAVES),
        ([None, 1.0, 1.0], [None, 2.0, 2.0], Finding.NEITHER),
        ([None, None, 1.0], [None, 2.0, 2.0], Finding.MORE),
        ([None, 1.0, 1.0], [None, None, 2.0], Finding.LESS),
    ],
)
def test_difference_needs_significant_scores(tuned: list[Any], defaults: list[Any], finding: Finding) -> None:
    one, two = (evaluate(GOAL, (), [ended(rise) for rise in rises]) for rises in (tuned, defaults))
    comparison = Comparison("hard", one, two)
    assert comparison.finding is finding
    assert f"hard, 3 seeds: {finding}" in next(iter(describe_comparison(comparison, ["rise_s"])))
    better = finding in (Finding.BETTER, Finding.SAVES)
    assert sentence([comparison]).startswith(
        "the tuned parameters beat the defaults: better in 1 of 1" if better
        else "the tuned parameters do NOT beat the defaults everywhere: better in 0 of 1"
    )  # fmt: skip


def test_tuned_file_round_trips(tmp_path: Path) -> None:
    state = searched()
    values = {"run": {"duration_s": 3.0}, "cell": {"surface": {"stiffness_n_m": 2000.0}}, "faults": []}
    path = tmp_path / "tuned.toml"
    path.write_text(tuned_file(values, pi(integral=0.4), state, Path("cell.toml")), encoding="utf-8")
    config = load_config(path, {})
    assert state.best is not None
    assert config.controller.name == "pi"
    assert config.controller.parameters == {"integral": state.best.point[0]}
    assert config.cell.surface.stiffness_n_m == 2000.0
    assert "fresh seeds against the defaults: better" in path.read_text(encoding="utf-8")
    assert toml({"a": 1, "b": {"c": {"d e": "x"}}}, ["why"]) == '# why\n\na = 1\n\n[b.c]\n"d e" = "x"\n'


def test_json_has_every_run() -> None:
    state = searched()
    result = json.loads(as_json(state, []))
    assert len(result["tried"]) == len(state.tried)
    assert result["best"] == {"integral": state.best.point[0]} if state.best else None
    assert len(result["defaults"]["runs"]) == 2


def test_invalid_figures_and_weights_are_refused() -> None:
    for wrong in ("rise", "rise_s=x", "rise_s=0", "outcome"):
        with pytest.raises(ConfigError, match="--minimise"):
            weights_of([wrong])
    for limit in (math.nan, math.inf, 0.0, -3.0):
        with pytest.raises(ConfigError, match="--force-limit: must be greater than 0"):
            limit_of(pi(), limit)
    with pytest.raises(ConfigError, match="--trade"):
        axes_of("rise_s")
    assert axes_of(None) == ("rise_s", "overshoot_percent")


def test_examples_share_one_controller() -> None:
    tuned = load_config(EXAMPLES / "cell.toml", {"controller.name": "pi"})
    for path in EXAMPLES.glob("*.toml"):
        config = load_other_cell(path, tuned)
        assert (config.controller.name, config.run.duration_s) == ("pi", tuned.run.duration_s)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_non_finite_figure_fails_run(bad: float) -> None:
    goal = Goal({"rms_error_n": 1.0}, 20.0, {"rms_error_n": 1.0})
    assert goal.score({"outcome": "completed", "rms_error_n": 0.5, "force_true_max_n": 12.0}) == 0.5
    assert goal.failure({"outcome": "completed", "rms_error_n": bad}) == f"rms_error_n is {bad}"
    assert goal.failure({"outcome": "completed", "rms_error_n": 0.5, "force_true_max_n": bad})
