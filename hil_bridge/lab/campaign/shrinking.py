"""Reduction of a bad run to the fewest faults and settings, and the simplest values, that still reproduce it."""

import json
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

from hil_bridge.lab.campaign.hunting import Runner, TimeIsUp, is_broken
from hil_bridge.lab.campaign.store import Done

DIGITS = (1, 2, 3)
"""Significant digits to which numbers are rounded, fewest first."""
SHRINK_S = 300.0
"""Chosen: time for reducing the worst run, s, in addition to the time of the hunt."""


def shrink(runner: Runner, done: Done, score: Callable[[Done], float]) -> Done:
    """Reduce a run as far as time allows, while it breaks no other promise, or keeps half of its score."""
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
    """Reduce a run within SHRINK_S; return it unchanged if it is not bad at all."""
    if not is_broken(done) and score(done) <= 0.0:
        return done
    runner.until = time.monotonic() + SHRINK_S
    return shrink(runner, done, score)


def smaller(table: str) -> Iterator[str]:
    """Yield simpler variants of an overlay (JSON), the largest reduction first."""
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
    given = fault.get("with", {})
    for key in given if len(given) > 1 else ():
        yield {**fault, "with": {name: value for name, value in given.items() if name != key}}
    for key in ("after_s", "for_s"):
        for rounded in _round(fault.get(key)):
            yield {**fault, key: rounded}
    for key, value in given.items():
        for rounded in _round(value):
            yield {**fault, "with": {**given, key: rounded}}


def _round(value: object) -> Iterator[float]:
    """Yield a number rounded to fewer digits, fewest first."""
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
