"""Compiled parts of a program, and their composition.

The closure of a part that may wait returns the part's value, or a generator that waits and then returns the value.
Only a part that actually waits thus costs a generator.
"""

from collections.abc import Callable, Sequence
from types import GeneratorType
from typing import Any, NamedTuple, TypeAlias

from emulators.devices.rtde.urscript.values import PoseValue, Struct, Value, size_of

Frame: TypeAlias = list[Any]
Run: TypeAlias = Callable[[Frame], Any]


class Part(NamedTuple):
    """Compiled expression or statement."""

    waits: bool
    """Whether `run` may return a generator instead of the value."""
    run: Run
    constant: Any = None
    """Value of the part if it is a constant number, boolean or list of numbers; None otherwise."""


NUMBERS = (float, int)
SIZED = (tuple, PoseValue, str, Struct)


def combined(parts: Sequence[Part], apply: Callable[..., Any]) -> Part:
    """Compose expressions to a part that returns `apply(frame, *values)`."""
    runs = tuple(part.run for part in parts)
    if any(part.waits for part in parts):

        def wait(frame: Frame) -> Any:
            results = yield from values_of_parts(parts, frame)
            return apply(frame, *results)

        return Part(True, wait)
    if not runs:
        return Part(False, apply)
    if len(runs) == 1:
        (only,) = runs
        return Part(False, lambda frame: apply(frame, only(frame)))
    if len(runs) == 2:
        first, second = runs
        return Part(False, lambda frame: apply(frame, first(frame), second(frame)))
    return Part(False, lambda frame: apply(frame, *[run(frame) for run in runs]))


def deferred(parts: Sequence[Part], call: Callable[..., Any]) -> Part:
    """Compose expressions to a part that waits in the generator `call(frame, *values)`."""
    if not any(part.waits for part in parts):
        return Part(True, combined(parts, call).run)

    def wait(frame: Frame) -> Any:
        results = yield from values_of_parts(parts, frame)
        return (yield from call(frame, *results))

    return Part(True, wait)


def values_of_parts(parts: Sequence[Part], frame: Frame) -> Any:
    """Return the values of parts, in order. The parts may wait."""
    results: list[Any] = [None] * len(parts)
    kept = frame[1].kept
    kept.append(results)
    try:
        for at, part in enumerate(parts):
            value = part.run(frame)
            results[at] = (yield from value) if value.__class__ is GeneratorType else value
    finally:
        kept.pop()
    return results


def charge(frame: Frame, arguments: Sequence[Value]) -> None:
    """Charge the steps for values whose size is not fixed."""
    for value in arguments:
        if value.__class__ in SIZED:
            frame[1].spend(size_of(value))


def always(value: Value) -> Part:
    """Return a part with a constant value."""
    return Part(False, lambda frame: value, value)


def answer(parts: Sequence[Part], call: Callable[..., Any]) -> Part:
    """Return a part that calls a function of the table. The function never waits."""

    def act(frame: Frame, *arguments: Value) -> Any:
        charge(frame, arguments)
        return call(frame[1], *arguments)

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
