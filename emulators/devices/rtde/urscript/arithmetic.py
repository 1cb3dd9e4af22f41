"""Functions on numbers, lists and strings."""

import math
from typing import Any

from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.devices.rtde.urscript.limits import LENGTH_MAX
from emulators.devices.rtde.urscript.table import Function, modelled, pure
from emulators.devices.rtde.urscript.values import (
    Struct,
    Value,
    array,
    checked,
    checked_string,
    integer,
    is_matrix,
    number,
    rows,
    size_of,
    string,
    text_of,
    truth,
)

_BITS = 32


def _norm(value: Value) -> Value:
    if value.__class__ is float:
        return abs(value)
    if isinstance(value, tuple):
        return math.hypot(*map(number, value))
    return abs(number(value))


def _normalize(value: Value) -> Value:
    parts = [number(part) for part in array(value)]
    length = math.hypot(*parts)
    if length == 0.0:
        raise ScriptError("a vector of length 0 has no direction")
    return tuple(part / length for part in parts)


def _power(base: Value, exponent: Value) -> Value:
    result = math.pow(number(base), number(exponent))
    is_integer = isinstance(base, int) and isinstance(exponent, int) and exponent >= 0
    return int(result) if is_integer and abs(result) < 2**31 else result


def _make_list(task: Any, length: Value, initial: Value, capacity: Value) -> Value:
    count = integer(length)
    if not 0 <= count <= LENGTH_MAX:
        raise ScriptError("a list is too large")
    task.spend(count * (1 + (size_of(initial) if isinstance(initial, (tuple, Struct)) else 0)))
    return checked((initial,) * count)


def _bits(value: Value) -> Value:
    bits = integer(value)
    return tuple(bool(bits >> bit & 1) for bit in range(_BITS))


def _integer(value: Value) -> Value:
    items = array(value)
    if len(items) > _BITS:
        raise ScriptError(f"a number has {_BITS} bits")
    result = sum(1 << bit for bit, part in enumerate(items) if truth(part))
    return result - 2**_BITS if result >= 2 ** (_BITS - 1) else result


def _length(value: Value) -> Value:
    if isinstance(value, str):
        return len(value)
    return len(array(value))


def _size(value: Value) -> Value:
    """Return the number of rows and columns of a matrix."""
    if is_matrix(value):
        items = array(value)
        return len(items), len(array(items[0]))
    return _length(value)


def _transpose(value: Value) -> Value:
    return tuple(zip(*rows(value), strict=True))


def _inverse_matrix(task: Any, value: Value) -> Value:
    """Invert a matrix by Gauss-Jordan elimination with partial pivoting."""
    left = rows(value)
    count = len(left)
    if count != len(left[0]):
        raise ScriptError("only a square matrix has an inverse")
    task.spend(count**3)
    work = [[*row, *(float(at == column) for column in range(count))] for at, row in enumerate(left)]
    for at in range(count):
        best = max(range(at, count), key=lambda row: abs(work[row][at]))
        if abs(work[best][at]) < 1e-300:
            raise ScriptError("the matrix has no inverse")
        work[at], work[best] = work[best], work[at]
        pivot = work[at][at]
        work[at] = [part / pivot for part in work[at]]
        for row in range(count):
            factor = work[row][at]
            if row != at and factor:
                work[row] = [part - factor * other for part, other in zip(work[row], work[at], strict=True)]
    return tuple(tuple(row[count:]) for row in work)


def _random(task: Any) -> Value:
    share: float = task.host.random()
    return share


# --- strings


def _text(value: Value) -> str:
    return value if isinstance(value, str) else text_of(value)


def _cat(first: Value, second: Value) -> Value:
    return checked_string(_text(first) + _text(second))


def _at(text: Value, place: Value) -> Value:
    characters, at = string(text), integer(place)
    if not 0 <= at < len(characters):
        raise ScriptError(f"there is no character {at} in a string of {len(characters)}")
    return characters[at]


def _sub(text: Value, place: Value, length: Value) -> Value:
    characters, at = string(text), integer(place)
    count = len(characters) if length is None else integer(length)
    if not 0 <= at <= len(characters) or count < 0:
        raise ScriptError(f"there is no substring from {at} in a string of {len(characters)}")
    return characters[at : at + count]


def _find(text: Value, target: Value, start: Value) -> Value:
    return string(text).find(string(target), max(integer(start), 0))


def _to_number(text: Value) -> Value:
    digits = string(text).strip()
    if len(digits) < 10 and digits.removeprefix("-").isdecimal():
        return int(digits)
    try:
        return float(digits) if len(digits) < 64 and "_" not in digits else _no_number(digits)
    except ValueError:
        return _no_number(digits)


def _no_number(text: str) -> float:
    raise ScriptError(f"{text[:40]!r} is not a number")


def _assert(task: Any, value: Value) -> Value:
    if not truth(value):
        raise ScriptError("assertion failed")
    return None


def _numeric(call: Any) -> Any:
    return lambda *arguments: call(*map(number, arguments))


ARITHMETIC: tuple[Function, ...] = (
    *(
        pure(f"{name}(f)", _numeric(getattr(math, name)))
        for name in ("acos", "asin", "atan", "ceil", "cos", "floor", "sin", "sqrt", "tan")
    ),
    pure("atan2(x, y)", _numeric(math.atan2)),
    pure("d2r(d)", _numeric(math.radians)),
    pure("r2d(r)", _numeric(math.degrees)),
    pure("log(b, f)", lambda base, value: math.log(number(value)) / math.log(number(base))),
    pure("pow(base, exponent)", _power),
    pure("norm(a)", _norm),
    pure("normalize(v)", _normalize),
    modelled("random()", _random),
    modelled("assert(condition)", _assert),
    pure("binary_list_to_integer(l)", _integer),
    pure("integer_to_binary_list(x)", _bits),
    pure("get_list_length(v)", _length),
    pure("length(v)", _length),
    pure("size(v)", _size),
    modelled("make_list(length, initial_value, capacity=0)", _make_list),
    modelled("inv(m)", _inverse_matrix),
    pure("transpose(m)", _transpose),
    pure("str_at(src, index)", _at),
    pure("str_cat(op1, op2)", _cat),
    pure("str_empty(str)", lambda text: not string(text)),
    pure("str_find(src, target, start_from=0)", _find),
    pure("str_len(str)", lambda text: len(string(text))),
    pure("str_sub(src, index, len=None)", _sub),
    pure("to_num(str)", _to_number),
    pure("to_str(val)", _text),
)
