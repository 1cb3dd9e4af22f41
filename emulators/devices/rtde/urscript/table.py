"""Functions that a program may call: name, signature, and whether the emulator models them."""

import ast
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

from emulators.devices.rtde.urscript.values import Value
from protocol.devices.rtde.fields import Number

E_SERIES = 5
"""Major version of the first e-Series."""


class Support(StrEnum):
    """How far the emulator goes with a function."""

    MODELLED = "modelled"
    """It has the effect, or the answer, of the emulated robot."""
    TAGGED = "tagged"
    """It is accepted without effect, and told once a program."""


NO_EFFECT, SAME_ANSWER = "accepted without effect", "always gives the same answer"
"""Treatment of a tagged function without an answer, and of one with an answer."""


class Function(NamedTuple):
    """One function."""

    name: str
    parameters: tuple[str, ...]
    defaults: Mapping[str, Value]
    """Values of parameters that may be left out."""
    call: Callable[..., Any]
    """Called with the task and the values of all parameters; a generator where it waits."""
    support: Support
    waits: bool
    """Whether it may let cycles pass."""
    since: Number = (0, 0, 0)
    """First version of an e-Series controller that has it."""
    since_cb3: Number = (0, 0, 0)
    """The same of a CB3."""

    def is_in(self, version: Sequence[int]) -> bool:
        """Whether a controller of this version has it."""
        since = self.since if version[0] >= E_SERIES else self.since_cb3
        return tuple(version[:3]) >= since

    @property
    def signature(self) -> str:
        """As a manual writes it."""
        parts = (
            f"{name}={self.defaults[name]!r}" if name in self.defaults else name for name in self.parameters
        )
        return f"{self.name}({', '.join(parts)})"


Functions = Mapping[str, Function]


def pure(signature: str, call: Callable[..., Value]) -> Function:
    """Declare a function that depends only on its values."""
    return _made(signature, lambda task, *values: call(*values), Support.MODELLED, False)


def modelled(signature: str, call: Callable[..., Value]) -> Function:
    """Declare a function of its task, for one cycle."""
    return _made(signature, call, Support.MODELLED, False)


def waiting(signature: str, call: Callable[..., Any]) -> Function:
    """Declare a function that may wait: a generator function of its task."""
    return _made(signature, call, Support.MODELLED, True)


def tagged(signature: str, answer: Value = None, detail: str = "") -> Function:
    """Declare a function that is accepted without effect, with a constant answer. `detail` names its treatment."""
    name = signature.partition("(")[0]
    detail = detail or (NO_EFFECT if answer is None else SAME_ANSWER)

    def call(task: Any, *values: Value) -> Value:
        task.report_tagged(name, detail)
        return answer

    return _made(signature, call, Support.TAGGED, False)


def by_name(functions: Iterable[Function]) -> Functions:
    """Return a table of functions, each name once."""
    table: dict[str, Function] = {}
    for function in functions:
        assert function.name not in table, function.name
        table[function.name] = function
    return table


def _made(signature: str, call: Callable[..., Any], support: Support, waits: bool) -> Function:
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
    """Split a list; commas in brackets do not separate."""
    parts, depth, part = [], 0, ""
    for character in text:
        depth += (character in "[(") - (character in "])")
        if character == "," and depth == 0:
            parts.append(part)
            part = ""
        else:
            part += character
    return [*parts, part] if part.strip() else parts
