"""One evaluation of the same rule base by the fuzzy libraries, run in an environment of their own.

Reads a rule base and inputs as JSON from standard input, writes to standard output what each library answered and
how long each answer took. Nothing of hil-bridge is imported here. The libraries interpolate memberships between
levels as `hil_bridge.control.laws.fuzzy` does on its continuous surface, with the minimum as AND and implication, the
maximum as aggregation and the centre of gravity.
"""

import json
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any


def scikit_fuzzy(
    base: dict[str, Any],
) -> tuple[Callable[[float, float], float], Callable[[float, float], float]]:
    """Evaluation as its users write it, and what it says by the centre of gravity of the levels alone.

    The library takes the centre of the area below the aggregated membership, straight lines between the levels; a
    sum over the levels is asked of the same aggregated membership for the comparison, untimed.
    """
    import numpy as np
    from skfuzzy import control  # type: ignore[import-not-found]
    from skfuzzy.control.controlsystem import CrispValueCalculator  # type: ignore[import-not-found]

    universe = np.array(base["levels"], dtype=float)
    inputs = [control.Antecedent(universe, name) for name in ("error", "change")]
    output = control.Consequent(universe, "output")
    for variable in (*inputs, output):
        for name, degrees in base["terms"].items():
            variable[name] = np.array(degrees)
    error, change = inputs
    rules = [control.Rule(error[e] & change[c], output[o]) for e, c, o in base["rules"]]
    simulation = control.ControlSystemSimulation(control.ControlSystem(rules))

    def evaluate(error_level: float, change_level: float) -> float:
        simulation.input["error"] = error_level
        simulation.input["change"] = change_level
        simulation.compute()
        return float(simulation.output["output"])

    def over_levels(error_level: float, change_level: float) -> float:
        evaluate(error_level, change_level)
        fine, membership, _ = CrispValueCalculator(output, simulation).find_memberships()
        heights = np.interp(universe, fine, membership)
        return float(heights @ universe / heights.sum())

    return evaluate, over_levels


def simpful(base: dict[str, Any]) -> tuple[Callable[[float, float], float], Callable[[float, float], float]]:
    """Evaluation with one integration point a level, its fastest and the same sum as ours."""
    from simpful import (  # type: ignore[import-not-found]
        FuzzySet,
        FuzzySystem,
        LinguisticVariable,
    )

    levels = base["levels"]
    system = FuzzySystem(show_banner=False, verbose=False)
    for name in ("error", "change", "output"):
        sets = [
            FuzzySet(points=[list(point) for point in zip(levels, degrees, strict=True)], term=term)
            for term, degrees in base["terms"].items()
        ]
        variable = LinguisticVariable(sets, universe_of_discourse=[levels[0], levels[-1]])
        system.add_linguistic_variable(name, variable)
    system.add_rules(
        [f"IF (error IS {e}) AND (change IS {c}) THEN (output IS {o})" for e, c, o in base["rules"]]
    )

    def evaluate(error_level: float, change_level: float) -> float:
        system.set_variable("error", error_level)
        system.set_variable("change", change_level)
        answer = system.Mamdani_inference(["output"], subdivisions=len(levels))
        return float(answer["output"])

    return evaluate, evaluate


LIBRARIES = {"scikit-fuzzy": scikit_fuzzy, "simpful": simpful}


def main() -> None:
    """Ask every library for every input."""
    base = json.load(sys.stdin)
    inputs = [tuple(pair) for pair in base["inputs"]]
    results = {}
    for name, make in LIBRARIES.items():
        evaluate, over_levels = make(base)
        evaluate(0.5, -0.5)  # what is done once only stays outside
        times_ns = []
        for error, change in inputs:
            began = time.perf_counter_ns()
            evaluate(error, change)
            times_ns.append(time.perf_counter_ns() - began)
        answers = [over_levels(*pair) for pair in inputs]
        results[name] = {"version": version(name), "times_ns": times_ns, "answers": answers}
    json.dump(results, sys.stdout)


if __name__ == "__main__":
    main()
