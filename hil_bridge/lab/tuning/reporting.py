"""Report of a search: lines for people, comments of the file, and JSON."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

from hil_bridge.lab.tuning.comparing import Comparison, Finding
from hil_bridge.lab.tuning.evaluating import Worth
from hil_bridge.lab.tuning.searching import Search


def fresh_comparison(state: Search) -> Comparison | None:
    """The best against the defaults on seeds that the search did not see; None before it has come to that."""
    if state.best is None or state.defaults_fresh is None or not state.finals:
        return None
    name = "the same cell" if state.wanted.cells == 1 else f"the same {state.wanted.cells} cells"
    return Comparison(f"{name}, fresh seeds", state.best, state.defaults_fresh)


def describe_parameters(state: Search) -> Iterator[str]:
    """The parameters that were found, beside the defaults."""
    if not state.tried:
        yield "interrupted before the first generation of points was done"
        return
    best, wanted = state.best, state.wanted
    failed = sum(not one.feasible for one in state.tried)
    seeds = f"{len(wanted.seeds)} seeds" + (f" in {wanted.cells} cells" if wanted.cells > 1 else "")
    yield f"{len(state.tried)} points tried with {seeds} each; {failed} failed a constraint"
    if best is None:
        yield "no point met the constraints with every seed"
        return
    for parameter, value in zip(wanted.space.parameters, best.point, strict=True):
        low, high, _ = parameter.range
        at = " (at its bound)" if value in (low, high) else ""
        before = "none" if parameter.default is None else f"{parameter.default:g}"
        yield f"  {parameter.name} = {value:g}{at}, was {before}"


def comments(state: Search, config_name: str) -> Iterator[str]:
    """Comments of the tuned file: how it came about."""
    wanted = state.wanted
    yield f"Tuned by `hil-bridge tune` on {config_name}."
    yield f"Minimised: {', '.join(f'{name} x {weight:g}' for name, weight in wanted.weights.items())}."
    if wanted.cells > 1:
        yield f"In {wanted.cells} cells at once."
    yield f"{len(state.tried)} points, seeds {', '.join(map(str, wanted.seeds))}, optimiser's seed {wanted.seed}."
    comparison = fresh_comparison(state)
    if comparison is None:
        yield "The search was interrupted: this point has not met fresh seeds."
    elif comparison.finding in (Finding.BETTER, Finding.SAVES):
        yield f"On {len(comparison.tuned.runs)} fresh seeds against the defaults: {comparison.finding}."
    else:
        yield f"It does NOT beat the defaults on {len(comparison.tuned.runs)} fresh seeds: {comparison.finding}."


def as_json(state: Search, comparisons: Sequence[Comparison]) -> str:
    """All points with the figures of each run."""
    wanted = state.wanted
    best = state.best
    found = {
        "minimised": wanted.weights,
        "force_limit_n": wanted.force_limit_n,
        "scales": [goal.scales for goal in state.goals],
        "seeds": wanted.seeds,
        "fresh_seeds": wanted.fresh,
        "parameters": {
            one.name: {"low": one.range.low, "high": one.range.high, "default": one.default}
            for one in wanted.space.parameters
        },
        "best": None if best is None else wanted.space.table(best.point),
        "defaults": _worth(state, state.defaults),
        "tried": [_worth(state, one) for one in state.tried],
        "finals": [_worth(state, one) for one in state.finals],
        "comparisons": [
            {
                "cell": one.name,
                "finding": one.finding.value,
                "tuned": _worth(state, one.tuned),
                "defaults": _worth(state, one.defaults),
            }
            for one in comparisons
        ],
    }
    return json.dumps(found, indent=1, default=str) + "\n"


def _worth(state: Search, one: Worth) -> dict[str, Any]:
    names = state.wanted.space.names
    return {
        "point": dict(zip(names, one.point, strict=False)),
        "score": one.score,
        "failures": one.failures,
        "runs": one.runs,
    }
