"""Reduction of a bad run to the fewest faults and settings, and the simplest values, that still reproduce the
problem.
"""

import json
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

from hil_bridge.lab.campaign.hunting import Runner, TimeIsUp, is_broken
from hil_bridge.lab.campaign.store import Done

DIGITS = (1, 2, 3)
"""Numbers of significant digits to which a value is rounded, fewest first."""
SHRINK_S = 300.0
"""Time for reducing the worst run, s, in addition to the time of the hunt. Chosen."""


def shrink(runner: Runner, done: Done, score: Callable[[Done], float]) -> Done:
    """Reduce a run as far as time allows, and return the simplest run that still reproduces the problem.

    If the run broke a promise, a simpler run must break a promise too, and no other. Otherwise, it must keep at
    least half of the score.
    """
    case, best = runner.plan.cases[done.number], done
    least = score(done) / 2.0

    def reproduces(other: Done) -> bool:
        if is_broken(done):
            return is_broken(other) and _promises(other) <= _promises(done)
        return score(other) >= least > 0.0

    while True:
        for table in smaller(best.table):
            try:
                (other,) = runner.done([runner.job(case, table)])
            except TimeIsUp:
                return best
            if reproduces(other):
                best = other
                break
        else:
            return best


def shrink_bad(runner: Runner, done: Done, score: Callable[[Done], float]) -> Done:
    """Reduce a run within SHRINK_S. A run that broke no promise and has no positive score is returned unchanged."""
    if not is_broken(done) and score(done) <= 0.0:
        return done
    runner.until = time.monotonic() + SHRINK_S
    return shrink(runner, done, score)


def smaller(table: str) -> Iterator[str]:
    """Yield simpler variants of an overlay (JSON), beginning with the largest reduction."""
    over: dict[str, Any] = json.loads(table)
    settings, faults = over["config"], over["faults"]
    for place in range(len(faults)):
        yield _text(settings, faults[:place] + faults[place + 1 :])
    for key in settings:
        yield _text({name: value for name, value in settings.items() if name != key}, faults)
    for place, fault in enumerate(faults):
        for simpler in _smaller_fault(fault):
            yield _text(settings, [*faults[:place], simpler, *faults[place + 1 :]])
    for key, value in settings.items():
        for rounded in _round(value):
            yield _text({**settings, key: rounded}, faults)


def _smaller_fault(fault: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for key in ("after_s", "for_s", "when", "with"):
        if key in fault:
            yield {name: value for name, value in fault.items() if name != key}
    parameters = fault.get("with", {})
    for key in parameters if len(parameters) > 1 else ():
        yield {**fault, "with": {name: value for name, value in parameters.items() if name != key}}
    for key in ("after_s", "for_s"):
        for rounded in _round(fault.get(key)):
            yield {**fault, key: rounded}
    for key, value in parameters.items():
        for rounded in _round(value):
            yield {**fault, "with": {**parameters, key: rounded}}


def _round(value: object) -> Iterator[float]:
    """Yield a number rounded to increasing numbers of digits."""
    if not isinstance(value, float) or value == 0.0 or not math.isfinite(value):
        return
    for digits in DIGITS:
        rounded = float(f"{value:.{digits}g}")
        if rounded == value:
            return
        yield rounded


def _promises(done: Done) -> set[str]:
    """Return the names of the promises that a run broke."""
    promises = done.figures.get("promises")
    return set(promises) if isinstance(promises, dict) else set()


def _text(settings: dict[str, Any], faults: list[dict[str, Any]]) -> str:
    return json.dumps({"config": settings, "faults": faults}, sort_keys=True)
