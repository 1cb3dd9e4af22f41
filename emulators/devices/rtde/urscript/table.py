"""Table of the functions that a program may call: name, signature, and whether the emulator models them."""

import ast
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

from emulators.devices.rtde.urscript.values import Value
from protocol.devices.rtde.fields import Number

E_SERIES = 5
"""Major version of the first e-Series."""


class Support(StrEnum):
    """Level of the emulator's support for a function."""

    MODELLED = "modelled"
    """The emulated robot executes the function, or provides its result."""
    TAGGED = "tagged"
    """The function is accepted without effect, and reported once per program."""


NO_EFFECT, SAME_ANSWER = "accepted without effect", "always gives the same answer"
"""Treatment of a tagged function: without a result, and with a result."""


class Function(NamedTuple):
    """Function that a program may call."""

    name: str
    parameters: tuple[str, ...]
    defaults: Mapping[str, Value]
    """Default values of optional parameters."""
    call: Callable[..., Any]
    """Implementation, called with the task and the values of all parameters; a generator if it waits."""
    support: Support
    waits: bool
    """Whether the function may wait for cycles."""
    since: Number = (0, 0, 0)
    """First version of an e-Series controller that provides the function."""
    since_cb3: Number = (0, 0, 0)
    """First version of a CB3 controller that provides the function."""

    def is_in(self, version: Sequence[int]) -> bool:
        """Return whether a controller of this version provides the function."""
        since = self.since if version[0] >= E_SERIES else self.since_cb3
        return tuple(version[:3]) >= since

    @property
    def signature(self) -> str:
        """Signature of the function, as in a manual."""
        parts = (
            f"{name}={self.defaults[name]!r}" if name in self.defaults else name for name in self.parameters
        )
        return f"{self.name}({', '.join(parts)})"


Functions = Mapping[str, Function]


def pure(signature: str, call: Callable[..., Value]) -> Function:
    """Declare a function that depends only on its arguments."""
    return _declare(signature, lambda task, *values: call(*values), Support.MODELLED, False)


def modelled(signature: str, call: Callable[..., Value]) -> Function:
    """Declare a function that completes within one cycle."""
    return _declare(signature, call, Support.MODELLED, False)


def waiting(signature: str, call: Callable[..., Any]) -> Function:
    """Declare a function that may wait: a generator function of its task."""
    return _declare(signature, call, Support.MODELLED, True)


def tagged(signature: str, answer: Value = None, detail: str = "") -> Function:
    """Declare a function that is accepted without effect, with a constant result. `detail` describes the treatment."""
    name = signature.partition("(")[0]
    detail = detail or (NO_EFFECT if answer is None else SAME_ANSWER)

    def call(task: Any, *values: Value) -> Value:
        task.report_tagged(name, detail)
        return answer

    return _declare(signature, call, Support.TAGGED, False)


def by_name(functions: Iterable[Function]) -> Functions:
    """Return a table of functions by name. Names are unique."""
    table: dict[str, Function] = {}
    for function in functions:
        assert function.name not in table, function.name
        table[function.name] = function
    return table


def _declare(signature: str, call: Callable[..., Any], support: Support, waits: bool) -> Function:
    name, _, rest = signature.removesuffix(")").partition("(")
    parameters: list[str] = []
    defaults: dict[str, Value] = {}
    for part in _parts(rest):
        parameter, has_default, default = part.partition("=")
        parameters.append(parameter.strip())
        if has_default:
            value = ast.literal_eval(default)
            defaults[parameter.strip()] = tuple(value) if isinstance(value, list) else value
    return Function(name, tuple(parameters), defaults, call, support, waits)


def _parts(text: str) -> list[str]:
    """Split a list at commas outside brackets."""
    parts, depth, part = [], 0, ""
    for character in text:
        depth += (character in "[(") - (character in "])")
        if character == "," and depth == 0:
            parts.append(part)
            part = ""
        else:
            part += character
    return [*parts, part] if part.strip() else parts
