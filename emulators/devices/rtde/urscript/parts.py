"""Parts of a compiled program, and how they make greater ones."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

from emulators.devices.rtde.urscript.values import PoseValue, Struct, Value, size_of

Frame: TypeAlias = list[Any]
Run: TypeAlias = Callable[[Frame], Any]


class Part(NamedTuple):
    """A compiled expression or statement."""

    waits: bool
    run: Run
    constant: Any = None
    """The number, boolean or list of numbers that it always gives; None for any other."""


NUMBERS = (float, int)
SIZED = (tuple, PoseValue, str, Struct)


def combined(parts: Sequence[Part], apply: Callable[..., Any]) -> Part:
    """Combine expressions: `apply(frame, *values)`."""
    runs = tuple(part.run for part in parts)
    if any(part.waits for part in parts):

        def wait(frame: Frame) -> Any:
            found = yield from values_of_parts(parts, frame)
            return apply(frame, *found)

        return Part(True, wait)
    if len(runs) == 1:
        (only,) = runs
        return Part(False, lambda frame: apply(frame, only(frame)))
    if len(runs) == 2:
        first, second = runs
        return Part(False, lambda frame: apply(frame, first(frame), second(frame)))
    return Part(False, lambda frame: apply(frame, *[run(frame) for run in runs]))


def values_of_parts(parts: Sequence[Part], frame: Frame) -> Any:
    """Return the values of parts that may wait, in order."""
    found: list[Any] = [None] * len(parts)
    kept = frame[1].kept
    kept.append(found)
    try:
        for at, part in enumerate(parts):
            found[at] = (yield from part.run(frame)) if part.waits else part.run(frame)
    finally:
        kept.pop()
    return found


def charge(frame: Frame, given: Sequence[Value]) -> None:
    """Take steps for values that are long."""
    for value in given:
        if value.__class__ in SIZED:
            frame[1].spend(size_of(value))


def always(value: Value) -> Part:
    """Return a part with a constant value."""
    return Part(False, lambda frame: value, value)


def answer(parts: Sequence[Part], call: Callable[..., Any]) -> Part:
    """Return a part that calls a function of the table that does not wait."""

    def act(frame: Frame, *given: Value) -> Any:
        charge(frame, given)
        return call(frame[1], *given)

    if any(part.waits for part in parts) or len(parts) > 1:
        return combined(parts, act)
    if not parts:
        return Part(False, lambda frame: call(frame[1]))
    (only,) = parts
    if (fixed := only.constant).__class__ in NUMBERS:
        return Part(False, lambda frame: call(frame[1], fixed))
    ask = only.run

    def run(frame: Frame) -> Any:
        value = ask(frame)
        if value.__class__ in SIZED:
            frame[1].spend(size_of(value))
        return call(frame[1], value)

    return Part(False, run)
