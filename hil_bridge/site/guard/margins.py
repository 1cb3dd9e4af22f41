"""Margins between the quantities of an observation and the values at which each of them alone would stop a run, by
bisection.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from hil_bridge.control import Phase, Stop
from hil_bridge.errors.causes import Cause
from hil_bridge.site.guard.asking import LoopQuery, Situation


class Margin(NamedTuple):
    """Margin between a quantity and the value at which it alone would stop the run."""

    name: str
    unit: str
    value: float
    limit: float
    """Largest value that does not stop the run."""

    @property
    def share(self) -> float:
        """Ratio of value to limit."""
        return self.value / self.limit

    @property
    def text(self) -> str:
        """Description of the margin."""
        left, unit = self.limit - self.value, f" {self.unit}" if self.unit else ""
        room = f"{number(left)} left" if left >= 0 else f"{number(-left)} too much"
        return f"{number(self.value)}{unit}, stops beyond {number(self.limit)}{unit}: {room}"


def number(value: float) -> str:
    """Format a value rounded for display."""
    return f"{round(value, 6):.6g}"


class _Quantity(NamedTuple):
    """Quantity that stops a run if it is large enough."""

    name: str
    unit: str
    causes: tuple[Cause, ...]
    value: Callable[[LoopQuery, Situation], float]
    largest: float
    """Largest value in the search."""
    make: Callable[[Situation, float], Situation]
    """Returns an undisturbed situation in which the quantity has this value."""


def _field(name: str) -> Callable[[LoopQuery, Situation], float]:
    return lambda ask, situation: getattr(situation, name)


def _put(name: str, calm: Situation, value: Any) -> Situation:
    change: dict[str, Any] = {name: value}
    return dataclasses.replace(calm, **change)


def _lagging_situation(calm: Situation, value: float) -> Situation:
    assert calm.commanded_mm is not None
    return dataclasses.replace(calm, depth_mm=calm.commanded_mm - value)


def _largest_force(ask: LoopQuery, situation: Situation) -> float:
    force = ask.force(situation)
    return max(abs(force), abs(force if situation.peak_n is None else situation.peak_n))


def _pull(ask: LoopQuery, situation: Situation) -> float:
    return max(0.0, -ask.force(situation))


def _resultant(ask: LoopQuery, situation: Situation) -> float:
    return _largest_force(ask, situation) if situation.resultant_n is None else situation.resultant_n


def _apart(ask: LoopQuery, situation: Situation) -> float:
    return 0.0 if situation.witness_n is None else abs(situation.witness_n - ask.force(situation))


def _disagreeing_situation(calm: Situation, value: float) -> Situation:
    """Return a situation in which the sensor measures no force and the robot measures this force, N."""
    return dataclasses.replace(calm, force_n=0.0, witness_n=value)


def _lag(ask: LoopQuery, situation: Situation) -> float:
    return 0.0 if situation.depth_mm is None else abs(ask.commanded_mm(situation) - situation.depth_mm)


def _simple(name: str, unit: str, cause: Cause, key: str, largest: float) -> _Quantity:
    return _Quantity(name, unit, (cause,), _field(key), largest, partial(_put, key))


_QUANTITIES = (
    _Quantity("force", "N", (Cause.FORCE,), _largest_force, 1e6, partial(_put, "peak_n")),
    _Quantity("pull", "N", (Cause.PULL,), _pull, 1e6, lambda calm, value: _put("force_n", calm, -value)),
    _Quantity("resultant", "N", (Cause.RESULTANT_FORCE,), _resultant, 1e6, partial(_put, "resultant_n")),
    _Quantity("witness", "N", (Cause.WITNESS,), _apart, 1e6, _disagreeing_situation),
    _simple("moment", "N·m", Cause.MOMENT, "moment_nm", 1e6),
    _simple("age", "ms", Cause.FORCE_TOO_OLD, "age_ms", 1e6),
    _simple("unchanged", "ms", Cause.SAME_COUNTS, "unchanged_ms", 1e6),
    _simple("still", "ms", Cause.NO_NEW_FRAME, "still_ms", 1e6),
    _simple("unanswered", "mm", Cause.UNANSWERED, "unanswered_mm", 1e6),
    _Quantity("following", "mm", (Cause.FOLLOWING,), _lag, 1e6, _lagging_situation),
    _simple("jump", "mm", Cause.JUMP, "moved_mm", 1e6),
    _simple("tilt", "°", Cause.TILT, "tilt_deg", 180.0),
    _simple("gap", "ms", Cause.DEADLINE, "gap_ms", 1e6),
)
"""Quantities that apply while a run continues."""
_RISE = _Quantity(
    "force",
    "N",
    (Cause.BEHIND, Cause.RETRACT_OVER, Cause.RETRACT_RISE, Cause.RETRACT_STAYS),
    _resultant,
    1e6,
    lambda calm, value: dataclasses.replace(calm, resultant_n=value),
)
"""Quantities that apply during a retraction."""


def margins(ask: LoopQuery, situation: Situation) -> Iterator[Margin]:
    """Return the margin between each quantity and the value at which it alone would stop the run. All other
    quantities are undisturbed.
    """
    if situation.phase is Phase.RETRACT:
        lowest = _resultant(ask, situation) if situation.lowest_n is None else situation.lowest_n
        calm = dataclasses.replace(situation, peak_n=0.0, force_n=0.0, lowest_n=lowest)
        quantities: tuple[_Quantity, ...] = (_RISE,)
    else:
        calm = Situation(
            situation.phase,
            commanded_mm=ask.commanded_mm(situation),
            cycle_ms=situation.cycle_ms,
            start_m=situation.start_m,
        )
        quantities = _QUANTITIES
    for quantity in quantities:
        value = quantity.value(ask, situation)
        limit = _limit(ask, calm, quantity)
        if limit is not None and math.isfinite(value):
            yield Margin(quantity.name, quantity.unit, value, limit)


def _limit(ask: LoopQuery, calm: Situation, quantity: _Quantity) -> float | None:
    """Return the value of this quantity above which the loop stops, by bisection, or None if the loop never stops
    or always stops.
    """

    def stops(value: float) -> bool:
        verdict = ask(quantity.make(calm, value)).verdict
        return isinstance(verdict, Stop) and verdict.reason.cause in quantity.causes

    low, high = 0.0, quantity.largest
    if stops(low) or not stops(high):
        return None
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        if stops(middle):
            high = middle
        else:
            low = middle
    return high
