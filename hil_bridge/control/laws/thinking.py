"""Thinking time of a policy: the time from an observation until its action takes effect.

Meanwhile the previous action continues. The policy observes again when its action takes effect.
"""

import math
import random
from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeAlias

from msgspec import Struct

from protocol.marks import SettingError


class RecordedTimes(Struct, frozen=True):
    """Thinking times of a recorded run."""

    by_time: dict[float, float]
    """Thinking time by the time of the decision: ms, by s on the run's clock."""


Thinking: TypeAlias = float | Mapping[str, float] | Literal["measured"] | RecordedTimes
"""Thinking time, ms: a number, a range `{"from": 5.0, "to": 30.0}` from which each decision draws, `"measured"` for
the wall-clock time that the policy takes, or the times of a recording.
"""
MEASURED: Literal["measured"] = "measured"
RANGE_KEYS = {"from", "to"}
SLACK_S = 1e-9
"""Largest time by which a cycle may begin before an action is due and still apply it, s: rounding errors of times."""


class Thought(Struct, frozen=True):
    """Action that has not taken effect yet."""

    action: tuple[float, ...]
    due: float
    """Time at which the action takes effect, s on the run's clock."""


class Mind(Struct, frozen=True):
    """State of a policy that thinks."""

    action: tuple[float, ...] = ()
    """Action in effect; empty before the first one, while the tool holds its position."""
    thought: Thought | None = None
    """Action that is still to come; None if the policy takes no time."""


def check_thinking(thinking: Thinking) -> None:
    """Raise SettingError for an invalid thinking time."""
    match thinking:
        case str():
            valid = thinking == MEASURED
        case Mapping():
            valid = set(thinking) == RANGE_KEYS and all(map(_is_time, thinking.values()))
            valid = valid and thinking["from"] <= thinking["to"]
        case RecordedTimes():
            valid = True
        case _:
            valid = _is_time(thinking)
    if not valid:
        raise SettingError(
            "thinking_ms", f'must be a number from 0, a range {{from, to}} or "{MEASURED}", got {thinking!r}'
        )


def _is_time(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value) and value >= 0.0


def think(
    mind: Mind, now: float, decide: Callable[[], tuple[tuple[float, ...], float]]
) -> tuple[Mind, float | None]:
    """Return the state after a cycle, and the thinking time if the policy decides in this cycle, ms.

    `decide` returns the action for the present observation, and the time that the policy takes for it, ms.
    """
    thought = mind.thought
    if thought is not None and now < thought.due - SLACK_S:
        return mind, None
    action = mind.action if thought is None else thought.action
    chosen, takes_ms = decide()
    if takes_ms == 0.0:
        return Mind(chosen), takes_ms
    return Mind(action, Thought(chosen, now + takes_ms * 1e-3)), takes_ms


def thinking_time(thinking: Thinking, seed: int, now: float) -> float:
    """Return the thinking time of the decision at a time, ms. `thinking` must not be `"measured"`.

    It is a pure function, so that a replay repeats it. Raises ValueError if a recording contains no decision at this
    time.
    """
    match thinking:
        case Mapping():
            share = random.Random(f"{seed} {now!r}").random()
            return thinking["from"] + (thinking["to"] - thinking["from"]) * share
        case RecordedTimes():
            if now not in thinking.by_time:
                raise ValueError(f"the recording contains no thinking time at {now} s")
            return thinking.by_time[now]
        case _:
            return float(thinking)
