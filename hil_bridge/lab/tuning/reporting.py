"""Report of a search as text, as comments in the tuned file, and as JSON."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

from hil_bridge.lab.tuning.comparing import Comparison, Finding
from hil_bridge.lab.tuning.evaluating import Evaluation
from hil_bridge.lab.tuning.searching import Search


def fresh_comparison(state: Search) -> Comparison | None:
    """Compare the best point with the defaults on seeds that the search did not use; None if these runs were not
    executed.
    """
    if state.best is None or state.defaults_fresh is None or not state.finals:
        return None
    name = "the same cell" if state.plan.cells == 1 else f"the same {state.plan.cells} cells"
    return Comparison(f"{name}, fresh seeds", state.best, state.defaults_fresh)


def describe_parameters(state: Search) -> Iterator[str]:
    """Yield the tuned parameters with their default values as text, line by line."""
    if not state.tried:
        yield "interrupted before the first generation of points was complete"
        return
    best, plan = state.best, state.plan
    failed = sum(not one.feasible for one in state.tried)
    seeds = f"{len(plan.seeds)} seeds" + (f" in {plan.cells} cells" if plan.cells > 1 else "")
    yield f"{len(state.tried)} points tried with {seeds} each; {failed} failed a constraint"
    if best is None:
        yield "no point met the constraints with every seed"
        return
    for parameter, value in zip(plan.space.parameters, best.point, strict=True):
        low, high, _ = parameter.range
        at = " (at its bound)" if value in (low, high) else ""
        before = "none" if parameter.default is None else f"{parameter.default:g}"
        yield f"  {parameter.name} = {value:g}{at}, was {before}"


def comments(state: Search, config_name: str) -> Iterator[str]:
    """Yield the comments of the tuned file, which describe its origin."""
    plan = state.plan
    yield f"Tuned by `hil-bridge tune` on {config_name}."
    yield f"Minimised: {', '.join(f'{name} x {weight:g}' for name, weight in plan.weights.items())}."
    if plan.cells > 1:
        yield f"In {plan.cells} cells at once."
    yield f"{len(state.tried)} points, seeds {', '.join(map(str, plan.seeds))}, optimiser's seed {plan.seed}."
    comparison = fresh_comparison(state)
    if comparison is None:
        yield "The search was interrupted: this point was not validated on fresh seeds."
    elif comparison.finding in (Finding.BETTER, Finding.SAVES):
        yield f"On {len(comparison.tuned.runs)} fresh seeds against the defaults: {comparison.finding}."
    else:
        yield f"It does NOT beat the defaults on {len(comparison.tuned.runs)} fresh seeds: {comparison.finding}."


def as_json(state: Search, comparisons: Sequence[Comparison]) -> str:
    """Encode all points with the figures of each run as JSON."""
    plan = state.plan
    best = state.best
    report = {
        "minimised": plan.weights,
        "force_limit_n": plan.force_limit_n,
        "scales": [goal.scales for goal in state.goals],
        "seeds": plan.seeds,
        "fresh_seeds": plan.fresh,
        "parameters": {
            one.name: {"low": one.range.low, "high": one.range.high, "default": one.default}
            for one in plan.space.parameters
        },
        "best": None if best is None else plan.space.table(best.point),
        "defaults": _encode(state, state.defaults),
        "tried": [_encode(state, one) for one in state.tried],
        "finals": [_encode(state, one) for one in state.finals],
        "comparisons": [
            {
                "cell": one.name,
                "finding": one.finding.value,
                "tuned": _encode(state, one.tuned),
                "defaults": _encode(state, one.defaults),
            }
            for one in comparisons
        ],
    }
    return json.dumps(report, indent=1, default=str) + "\n"


def _encode(state: Search, one: Evaluation) -> dict[str, Any]:
    names = state.plan.space.names
    return {
        "point": dict(zip(names, one.point, strict=False)),
        "score": one.score,
        "failures": one.failures,
        "runs": one.runs,
    }
