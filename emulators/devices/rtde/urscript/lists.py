"""Methods of lists, such as `list.append(x)`. A method that changes the list assigns it again.

Source: the script manual on lists, since PolyScope 5.15. The limits are chosen.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.devices.rtde.urscript.values import Value, array, checked, integer

List: TypeAlias = tuple[Value, ...]


class Method(NamedTuple):
    """Method of a list."""

    arguments: int
    evaluate: Callable[..., Value]
    """Returns the value of a call, given the list and the arguments."""
    change: Callable[..., List] | None = None
    """Returns the list after a call; None if the method does not change the list."""


def _inside(items: List, place: Value, end: int) -> int:
    at = integer(place)
    if not 0 <= at < end:
        raise ScriptError(f"there is no position {at} in a list of {len(items)}")
    return at


def _last(items: List) -> Value:
    if not items:
        raise ScriptError("the list is empty")
    return items[-1]


def _insert(items: List, place: Value, value: Value) -> List:
    at = _inside(items, place, len(items) + 1)
    return _list((*items[:at], value, *items[at:]))


def _remove(items: List, place: Value) -> List:
    at = _inside(items, place, len(items))
    return items[:at] + items[at + 1 :]


def _slice(items: List, begin: Value, end: Value) -> List:
    first, last = integer(begin), integer(end)
    if not 0 <= first <= last <= len(items):
        raise ScriptError(f"there is no slice {first} to {last} in a list of {len(items)}")
    return items[first:last]


def _list(items: List) -> List:
    return array(checked(items))


def _nothing(*arguments: Value) -> Value:
    return None


METHODS: Mapping[str, Method] = {
    "append": Method(1, _nothing, lambda items, value: _list((*items, value))),
    "clear": Method(0, _nothing, lambda items: ()),
    "extend": Method(1, _nothing, lambda items, more: _list((*items, *array(more)))),
    "insert": Method(2, _nothing, _insert),
    "length": Method(0, len),
    "pop": Method(0, _last, lambda items: items[:-1]),
    "remove": Method(1, _nothing, _remove),
    "slice": Method(2, _slice),
}
