"""Binary operators of a program."""

import operator
from collections.abc import Callable, Mapping
from typing import Any

from emulators.devices.rtde.urscript import values
from emulators.devices.rtde.urscript.parts import NUMBERS, SIZED, Frame, Part, combined
from emulators.devices.rtde.urscript.values import Value

_COMPARISONS: Mapping[str, Callable[[Value, Value], Value]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": lambda a, b: values.compare(operator.lt, a, b),
    ">": lambda a, b: values.compare(operator.gt, a, b),
    "<=": lambda a, b: values.compare(operator.le, a, b),
    ">=": lambda a, b: values.compare(operator.ge, a, b),
}
_OPERATIONS: Mapping[str, Callable[[Value, Value], Value]] = {
    "+": values.add,
    "-": values.subtract,
    "*": values.multiply,
    "/": values.divide,
    "%": values.modulo,
    **_COMPARISONS,
}
_DIRECT: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": values.quotient,
    "%": values.modulo,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
}
_FLOATS = (float,)


def binary(sign: str, left: Part, right: Part) -> Part:
    """Compile a binary operation. Operations on two floats, and comparisons of two numbers, use Python's operators
    directly.
    """
    operation, direct = _OPERATIONS[sign], _DIRECT[sign]
    kinds = NUMBERS if sign in _COMPARISONS or sign == "/" else _FLOATS

    def apply(frame: Frame, a: Value, b: Value) -> Value:
        if a.__class__ in SIZED or b.__class__ in SIZED:
            frame[1].spend(_work(a, b))
        return operation(a, b)

    if left.waits or right.waits:
        return combined([left, right], apply)
    first, second, fixed = left.run, right.run, right.constant

    def run(frame: Frame) -> Any:
        a, b = first(frame), second(frame)
        if a.__class__ in kinds and b.__class__ in kinds:
            return direct(a, b)
        return apply(frame, a, b)

    def run_with_fixed(frame: Frame) -> Any:
        a = first(frame)
        if a.__class__ in kinds:
            return direct(a, fixed)
        return apply(frame, a, fixed)

    return Part(False, run_with_fixed if fixed.__class__ in kinds else run)


def _work(a: Value, b: Value) -> int:
    """Return the number of steps charged for an operation on lists, matrices, structs or strings."""
    sizes = [values.size_of(value) for value in (a, b) if isinstance(value, (tuple, str, values.Struct))]
    if not values.is_matrix(a):
        return max(sizes)
    return max(sizes[0], 1) * max(sizes[-1], 1) if len(sizes) > 1 else sizes[0]
