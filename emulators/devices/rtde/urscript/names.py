"""Static analysis before a program runs: its functions, the scope of each variable, and the functions that may
wait.

Scopes are lexical. A name that a function assigns without `local` or `global` belongs to an enclosing function that
has a variable of this name, otherwise to the function itself. Source: the script manual on scoping rules. Assumed:
it does not matter whether the enclosing function has already assigned the variable.
"""

from collections.abc import Callable
from typing import Any

from emulators.devices.rtde.urscript.failures import ScriptSyntaxError, SyntaxFailure
from emulators.devices.rtde.urscript.table import Functions
from emulators.devices.rtde.urscript.tokens import Token

FIRST = 2
"""Number of slots before the variables of a frame: the enclosing frame and the task."""
SIGNALS = {"digital_in": "get_digital_in", "digital_out": "get_digital_out"}
"""Arrays of signals and the functions that read them: `digital_out[1] = True`, as written by python-urx 0.11.0."""


class Node:
    """Statement, expression, or part of one."""

    __slots__ = ("children", "kind", "token")

    def __init__(self, kind: str, token: Token, children: list[Any]) -> None:
        """Create a node. `children` are nodes and token texts."""
        self.kind, self.token, self.children = kind, token, children

    @property
    def line(self) -> int:
        """Line number, starting at 1."""
        return self.token[2]

    def refused(self, text: str, function: str = "") -> ScriptSyntaxError:
        """Return the error for a program that does not compile at this node.

        `function` is the name of the unknown function, if that is the reason.
        """
        return ScriptSyntaxError(SyntaxFailure(self.token[2], self.token[3], text, function))

    def misplaced(self, text: str) -> ScriptSyntaxError:
        """Return the error for a line in a wrong position."""
        return ScriptSyntaxError(SyntaxFailure(self.line, 1, text))


class Code:
    """Function or thread of a program, or the program itself."""

    body: Node
    """Block with the statements of this code."""

    def __init__(self, name: str, parent: "Code | None") -> None:
        self.name, self.parent = name, parent
        self.root: Code = self if parent is None else parent.root
        """Code of the complete program."""
        self.parameters: list[str] = []
        self.default_nodes: dict[str, Node] = {}
        self.defaults: dict[str, Callable[[list[Any]], Any]] = {}
        self.slots: dict[str, int] = {}
        self.functions: dict[str, Code] = {}
        self.globals: set[str] = set()
        self.assigned: dict[str, None] = {}
        """Names that this code assigns without `local` or `global`, in order."""
        self.calls: set[str] = set()
        self.waits = False
        self.weight = 1
        """Number of steps for one execution of the body, without loops."""
        self.run: Callable[[list[Any]], Any] = _not_compiled

    def slot(self, name: str) -> int:
        """Return the index of a variable in the frame, after adding it if it is new."""
        return self.slots.setdefault(name, FIRST + len(self.slots))

    def find(self, name: str) -> tuple[int, int] | None:
        """Return the location of a variable: how many frames outwards it is, and its index there. None if there is
        no such variable.
        """
        if name in self.globals:
            return self.hops_to(self.root), self.root.slots[name]
        hops, code = 0, self
        while name not in code.slots:
            if code.parent is None:
                return None
            hops, code = hops + 1, code.parent
        return hops, code.slots[name]

    def find_function(self, name: str) -> "Code | None":
        """Return the function with this name that is visible here, or None."""
        code: Code | None = self
        while code is not None and name not in code.functions:
            code = code.parent
        return None if code is None else code.functions[name]

    def hops_to(self, outer: "Code") -> int:
        """Return how many frames outwards the frame of an enclosing function is."""
        hops, code = 0, self
        while code is not outer:
            assert code.parent is not None, "it encloses this one"
            hops, code = hops + 1, code.parent
        return hops


def _not_compiled(frame: list[Any]) -> Any:
    raise AssertionError("it is compiled before it runs")


def resolve(root: Code, functions: Functions) -> list[Code]:
    """Return all functions of a program with their variables. An enclosing function precedes its nested functions."""
    codes = [root]
    for code in codes:
        for name in code.assigned:
            if code.find(name) is None:
                code.slot(name)
        codes += code.functions.values()
    _find_waiting(codes, functions)
    return codes


def assigned(place: Any) -> str | None:
    """Return the name of the variable that an assignment changes, completely or in part."""
    while place.kind == "place":
        place = place.children[0]
    return place.children[0] if place.kind == "name" else None


def is_pose(place: Node) -> bool:
    """Return whether a node begins a pose literal such as `p[x, y, z, rx, ry, rz]`."""
    first, trailer, *_ = place.children
    return first.kind == "name" and first.children[0] == "p" and len(trailer.children) == 6


def _find_waiting(codes: list[Code], functions: Functions) -> None:
    """Mark all code that may wait: calls of waiting functions of the table, and functions that contain such a call."""
    callers: dict[int, list[Code]] = {}
    for code in codes:
        for name in code.calls:
            if (inner := code.find_function(name)) is not None:
                callers.setdefault(id(inner), []).append(code)
            elif name in functions and functions[name].waits:
                code.waits = True
    news = [code for code in codes if code.waits]
    while news:
        for code in callers.get(id(news.pop()), ()):
            if not code.waits:
                code.waits = True
                news.append(code)
