"""A bad run made small: the fewest faults, the fewest settings, the simplest values that still show it."""

import json
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

from hil_bridge.lab.campaign.hunting import Runner, Spent, is_broken
from hil_bridge.lab.campaign.store import Done

DIGITS = (1, 2, 3)
"""Digits to which numbers are rounded, the fewest first."""
SHRINK_S = 300.0
"""Chosen: time for making the worst run small, s; it comes after that of the hunt."""


def shrink(runner: Runner, done: Done, worth: Callable[[Done], float]) -> Done:
    """A run that shows the same with less: a broken promise, or half of what makes it bad. As far as time allows."""
    case, best = runner.plan.cases[done.number], done
    least = worth(done) / 2.0

    def shows(other: Done) -> bool:
        if is_broken(done):
            return is_broken(other) and _promises(other) <= _promises(done)
        return worth(other) >= least > 0.0

    while True:
        for table in smaller(best.table):
            try:
                (other,) = runner.done([runner.job(case, table)])
            except Spent:
                return best
            if shows(other):
                best = other
                break
        else:
            return best


def shrink_bad(runner: Runner, done: Done, worth: Callable[[Done], float]) -> Done:
    """The same for a run that is bad at all, with a time of its own; any other stays as it is."""
    if not is_broken(done) and worth(done) <= 0.0:
        return done
    runner.until = time.monotonic() + SHRINK_S
    return shrink(runner, done, worth)


def smaller(table: str) -> Iterator[str]:
    """The values laid over a configuration, each time with a little less, as JSON. The largest steps come first."""
    over: dict[str, Any] = json.loads(table)
    settings, faults = over["config"], over["faults"]
    for place in range(len(faults)):
        yield _text(settings, faults[:place] + faults[place + 1 :])
    for key in settings:
        yield _text({name: value for name, value in settings.items() if name != key}, faults)
    for place, fault in enumerate(faults):
        for less in _smaller_fault(fault):
            yield _text(settings, [*faults[:place], less, *faults[place + 1 :]])
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
    """The same number with fewer digits, the fewest first."""
    if not isinstance(value, float) or value == 0.0 or not math.isfinite(value):
        return
    for digits in DIGITS:
        rounded = float(f"{value:.{digits}g}")
        if rounded == value:
            return
        yield rounded


def _promises(done: Done) -> set[str]:
    """Names of the promises that a run broke."""
    promises = done.figures.get("promises")
    return set(promises) if isinstance(promises, dict) else set()


def _text(settings: dict[str, Any], faults: list[dict[str, Any]]) -> str:
    return json.dumps({"config": settings, "faults": faults}, sort_keys=True)
