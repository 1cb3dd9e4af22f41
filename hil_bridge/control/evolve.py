"""A frozen state with some fields changed: `dataclasses.replace` for what runs in every control cycle."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar

State = TypeVar("State")

_MAKERS: dict[tuple[type[Any], tuple[str, ...]], Callable[..., Any]] = {}
"""How each class is made anew with these fields changed: as many as there are calls of `evolve` in the code."""


def evolve(state: State, **changes: object) -> State:
    """The same dataclass with these fields changed. Several times as quick as `replace`, for it looks the fields up
    but once; TypeError for a name that is no field.
    """
    which = type(state), tuple(changes)
    make = _MAKERS.get(which)
    if make is None:
        make = _MAKERS[which] = _maker(*which)
    evolved: State = make(state, *changes.values())
    return evolved


def _maker(kind: Any, changed: tuple[str, ...]) -> Callable[..., Any]:
    names = [field.name for field in fields(kind) if field.init]
    if unknown := set(changed).difference(names):
        raise TypeError(f"{kind.__name__} has no field {', '.join(sorted(unknown))}")
    arguments = ", ".join(name if name in changed else f"state.{name}" for name in names)
    make: Callable[..., Any] = eval(
        f"lambda {', '.join(('state', *changed))}: kind({arguments})", {"__name__": __name__, "kind": kind}
    )
    return make
