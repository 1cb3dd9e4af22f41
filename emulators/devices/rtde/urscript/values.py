"""Values of a program and their arithmetic.

A list is a tuple, since programs pass lists by value. A pose is a list of six numbers with a distinct type. A
number beyond 32 bits is a float.
"""

import math
import operator
from collections.abc import Callable, Sequence
from typing import TypeAlias

from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.devices.rtde.urscript.limits import LENGTH_MAX, NESTING_MAX, STRING_MAX

Value: TypeAlias = "int | float | str | tuple[Value, ...] | Struct | None"
"""Value of a program. Python treats a boolean as an integer. A thread is represented by its handle."""
_LARGEST = 2**31
_NUMBERS = (float, int)
_CHARACTERS = 64
"""Number of characters that are charged as one element. Chosen."""


class PoseValue(tuple[Value, ...]):
    """x y z, m, and a rotation vector, rad."""

    __slots__ = ()


class Struct:
    """Named values. Immutable: a change creates another struct."""

    __slots__ = ("members",)

    def __init__(self, members: dict[str, Value]) -> None:
        self.members = members

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Struct) and self.members == other.members

    def __hash__(self) -> int:
        return hash(tuple(self.members))


def kind(value: Value) -> str:
    """Return the name of a value's type, for messages."""
    match value:
        case bool():
            return "a boolean"
        case int() | float():
            return "a number"
        case str():
            return "a string"
        case PoseValue():
            return "a pose"
        case tuple():
            return "a list"
        case None:
            return "None"
        case _:
            return "a struct"


# --- bounds


def checked(value: Value) -> Value:
    """Return a new list or struct unless it exceeds the limits. Raises ScriptError."""
    _measure(value, 0, 0)
    return value


def _measure(value: Value, count: int, depth: int) -> int:
    if isinstance(value, Struct):
        parts: Sequence[Value] = tuple(value.members.values())
    elif isinstance(value, tuple):
        parts = value
    else:
        return count
    count += len(parts)
    if count > LENGTH_MAX or depth >= NESTING_MAX:
        raise ScriptError("a list is too large")
    for part in parts:
        if isinstance(part, (tuple, Struct)):
            count = _measure(part, count, depth + 1)
    return count


def size_of(value: "tuple[Value, ...] | str | Struct") -> int:
    """Return the number of characters or elements of a value, including nested ones: the work of one traversal.

    Characters of a string in a list count less, because they are copied at once.
    """
    if isinstance(value, tuple):
        parts: Sequence[Value] = value
    elif isinstance(value, str):
        return len(value)
    else:
        parts = tuple(value.members.values())
    size = len(parts)
    for part in parts:
        if part.__class__ in _NUMBERS:
            continue
        if isinstance(part, str):
            size += len(part) // _CHARACTERS
        elif isinstance(part, (tuple, Struct)):
            size += size_of(part)
    return size


def checked_string(text: str) -> str:
    """Return a new string unless it exceeds the limit. Raises ScriptError."""
    if len(text) > STRING_MAX:
        raise ScriptError("a string is too long")
    return text


# --- conversions


def number(value: Value) -> int | float:
    """Return a number. A boolean is not a number. Raises ScriptError."""
    if value.__class__ is float or value.__class__ is int:
        return value
    raise ScriptError(f"expected a number, got {kind(value)}")


def integer(value: Value) -> int:
    """Return an integer. A float without a fraction is also accepted. Raises ScriptError."""
    if value.__class__ is int:
        return value
    result: float = number(value)
    if result.is_integer():
        return int(result)
    raise ScriptError("expected an integer")


def string(value: Value) -> str:
    if isinstance(value, str):
        return value
    raise ScriptError(f"expected a string, got {kind(value)}")


def array(value: Value) -> tuple[Value, ...]:
    """Return a list or a pose. Raises ScriptError for anything else."""
    if isinstance(value, tuple):
        return value
    raise ScriptError(f"expected a list, got {kind(value)}")


def vector(value: Value, size: int) -> tuple[float, ...]:
    """Return a list with this many numbers. Raises ScriptError for anything else."""
    items = array(value)
    if len(items) != size:
        raise ScriptError(f"expected a list of {size} numbers, got {len(items)}")
    for part in items:
        if part.__class__ is not float:
            number(part)
    return tuple(items)  # type: ignore[arg-type]


def truth(value: Value) -> bool:
    """Return the truth value of a condition. A number is true unless it is 0."""
    if value.__class__ is bool:
        return value
    if isinstance(value, (int, float)):
        return value != 0
    raise ScriptError(f"a condition must be a boolean, not {kind(value)}")


def text_of(value: Value) -> str:
    """Format a value as `to_str` and `textmsg` do. Assumed: floats have six digits."""
    return checked_string(_text(value))


def _text(value: Value) -> str:
    if isinstance(value, float):
        return format(value + 0.0, ".6g")  # without the sign of a zero
    if isinstance(value, tuple):
        return f"{'p' * isinstance(value, PoseValue)}[{', '.join(map(_text, value))}]"
    if isinstance(value, Struct):
        return f"struct({', '.join(f'{name}={_text(part)}' for name, part in value.members.items())})"
    return str(value)


# --- arithmetic


def _check_size(result: int | float) -> int | float:
    if isinstance(result, int) and not -_LARGEST <= result < _LARGEST:
        return float(result)
    return result


def add(a: Value, b: Value) -> Value:
    if a.__class__ in _NUMBERS and b.__class__ in _NUMBERS:
        return _check_size(a + b)
    return _each(operator.add, a, b)


def subtract(a: Value, b: Value) -> Value:
    if a.__class__ in _NUMBERS and b.__class__ in _NUMBERS:
        return _check_size(a - b)
    return _each(operator.sub, a, b)


def multiply(a: Value, b: Value) -> Value:
    """Multiply two values: matrices by the matrix product, lists element by element."""
    if a.__class__ in _NUMBERS and b.__class__ in _NUMBERS:
        return _check_size(a * b)
    if is_matrix(a) and isinstance(b, tuple):
        return _matrix_product(array(a), b)
    return _each(operator.mul, a, b)


def divide(a: Value, b: Value) -> Value:
    if a.__class__ in _NUMBERS and b.__class__ in _NUMBERS:
        return quotient(number(a), number(b))
    return _each(quotient, a, b)


def modulo(a: Value, b: Value) -> Value:
    return _each(_remainder, a, b)


def quotient(a: float, b: float) -> float:
    """Divide two values. Raises ScriptError for a division by zero."""
    if b == 0:
        raise ScriptError("a division by zero")
    return a / b


def _remainder(a: int | float, b: int | float) -> int | float:
    """Return the remainder with the sign of the dividend, as in C (assumed)."""
    if b == 0:
        raise ScriptError("a division by zero")
    result = math.fmod(a, b)
    return int(result) if isinstance(a, int) and isinstance(b, int) else result


def negate(a: Value) -> Value:
    if isinstance(a, tuple):
        return _like(a, tuple(negate(part) for part in a))
    return _check_size(-number(a))


def _each(operation: Callable[[float, float], float], a: Value, b: Value) -> Value:
    """Apply an operation to numbers, to lists of equal length element by element, or to a list and a number."""
    if isinstance(a, tuple):
        if isinstance(b, tuple):
            if len(a) != len(b):
                raise ScriptError(f"lists of {len(a)} and {len(b)} elements do not match")
            parts = tuple(_each(operation, p, q) for p, q in zip(a, b, strict=True))
            return PoseValue(parts) if isinstance(b, PoseValue) else _like(a, parts)
        return _like(a, tuple(_each(operation, p, b) for p in a))
    if isinstance(b, tuple):
        return _like(b, tuple(_each(operation, a, q) for q in b))
    return _check_size(operation(number(a), number(b)))


def _like(model: tuple[Value, ...], parts: tuple[Value, ...]) -> tuple[Value, ...]:
    return PoseValue(parts) if isinstance(model, PoseValue) else parts


# --- matrices


def is_matrix(value: Value) -> bool:
    """Return whether a value is a list of lists."""
    return isinstance(value, tuple) and bool(value) and isinstance(value[0], tuple)


def rows(value: Value) -> list[list[float]]:
    """Return the numbers of a matrix."""
    matrix = [[number(part) for part in array(row)] for row in array(value)]
    if not matrix or any(len(row) != len(matrix[0]) for row in matrix):
        raise ScriptError("the rows of a matrix must have equal lengths")
    return matrix


def _matrix_product(a: tuple[Value, ...], b: tuple[Value, ...]) -> Value:
    left = rows(a)
    if is_matrix(b):
        right = rows(b)
        _fit(len(left[0]), len(right))
        columns = list(zip(*right, strict=True))
        return tuple(tuple(_dot(row, column) for column in columns) for row in left)
    other = vector(b, len(b))
    _fit(len(left[0]), len(other))
    return tuple(_dot(row, other) for row in left)


def _fit(columns: int, count: int) -> None:
    if columns != count:
        raise ScriptError(f"a matrix of {columns} columns does not match {count} rows")


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return _check_size(sum(p * q for p, q in zip(a, b, strict=True)))


# --- comparisons


def compare(operation: Callable[[float, float], bool], a: Value, b: Value) -> bool:
    """Compare two numbers by an operator."""
    return operation(number(a), number(b))


# --- parts


def element(value: Value, place: Value) -> Value:
    """Return an element of a list, a pose or a string."""
    items = array(value)
    at = integer(place)
    if not 0 <= at < len(items):
        raise ScriptError(f"there is no element {at} in a list of {len(items)}")
    return items[at]


def with_element(value: Value, place: Value, new: Value) -> Value:
    """Return the list with one element replaced. The length does not change."""
    items = array(value)
    at = integer(place)
    if not 0 <= at < len(items):
        raise ScriptError(f"there is no element {at} in a list of {len(items)}")
    parts = _like(items, (*items[:at], new, *items[at + 1 :]))
    return checked(parts) if isinstance(new, (tuple, Struct)) else parts


def member(value: Value, name: str) -> Value:
    """Return a member of a struct."""
    if not isinstance(value, Struct) or name not in value.members:
        raise ScriptError(f"there is no member {name} in {kind(value)}")
    return value.members[name]


def with_member(value: Value, name: str, new: Value) -> Value:
    """Return the struct with the value of an existing member replaced."""
    member(value, name)
    assert isinstance(value, Struct), "it has a member"
    return checked(Struct({**value.members, name: new}))
