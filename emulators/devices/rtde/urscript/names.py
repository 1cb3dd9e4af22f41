"""The functions of a text, which variable a name means, and which functions may wait: known before a program runs.

Scopes are lexical. A name that a function assigns without `local` or `global` is that of an enclosing function where
one has it; else it is the function's own. Source: the script manual on scoping rules. Assumed: it does not matter
whether the enclosing function has assigned it yet.
"""

from collections.abc import Callable
from typing import Any

from emulators.devices.rtde.urscript.failures import ScriptSyntaxError, SyntaxFailure
from emulators.devices.rtde.urscript.table import Functions
from emulators.devices.rtde.urscript.tokens import Token

FIRST = 2
"""Slots before the variables of a frame: the enclosing frame, and the task."""
SIGNALS = {"digital_in": "get_digital_in", "digital_out": "get_digital_out"}
"""Arrays of signals, and the functions that read them: `digital_out[1] = True`, as python-urx 0.11.0 writes."""


class Node:
    """A statement, an expression, or a part of one."""

    __slots__ = ("children", "kind", "token")

    def __init__(self, kind: str, token: Token, children: list[Any]) -> None:
        """`children` are nodes, and texts of tokens."""
        self.kind, self.token, self.children = kind, token, children

    @property
    def line(self) -> int:
        """1 is the first one."""
        return self.token[2]

    def refused(self, text: str, function: str = "") -> ScriptSyntaxError:
        """Return the error of a text that does not compile here; `function` is not known."""
        return ScriptSyntaxError(SyntaxFailure(self.token[2], self.token[3], text, function))

    def misplaced(self, text: str) -> ScriptSyntaxError:
        """Return the error of a line that does not compile."""
        return ScriptSyntaxError(SyntaxFailure(self.line, 1, text))


class Code:
    """A function or a thread of a program, or the text itself."""

    body: Node
    """The block of its statements."""

    def __init__(self, name: str, parent: "Code | None") -> None:
        self.name, self.parent = name, parent
        self.root: Code = self if parent is None else parent.root
        """The text."""
        self.parameters: list[str] = []
        self.default_nodes: dict[str, Node] = {}
        self.defaults: dict[str, Callable[[list[Any]], Any]] = {}
        self.slots: dict[str, int] = {}
        self.functions: dict[str, Code] = {}
        self.globals: set[str] = set()
        self.assigned: dict[str, None] = {}
        """Names that it assigns without `local` or `global`, in their order."""
        self.calls: set[str] = set()
        self.waits = False
        self.weight = 1
        """Steps that one run of its body takes, loops left out."""
        self.run: Callable[[list[Any]], Any] = _not_compiled

    def slot(self, name: str) -> int:
        """Return the index of a variable of its own."""
        return self.slots.setdefault(name, FIRST + len(self.slots))

    def find(self, name: str) -> tuple[int, int] | None:
        """How many frames out a variable is, and its place there; None if there is none of this name."""
        if name in self.globals:
            return self.hops_to(self.root), self.root.slots[name]
        hops, code = 0, self
        while name not in code.slots:
            if code.parent is None:
                return None
            hops, code = hops + 1, code.parent
        return hops, code.slots[name]

    def find_function(self, name: str) -> "Code | None":
        """Return the function of a name, visible from here."""
        code: Code | None = self
        while code is not None and name not in code.functions:
            code = code.parent
        return None if code is None else code.functions[name]

    def hops_to(self, outer: "Code") -> int:
        """How many frames out an enclosing one's is."""
        hops, code = 0, self
        while code is not outer:
            assert code.parent is not None, "it encloses this one"
            hops, code = hops + 1, code.parent
        return hops


def _not_compiled(frame: list[Any]) -> Any:
    raise AssertionError("it is compiled before it runs")


def resolve(root: Code, functions: Functions) -> list[Code]:
    """All functions of a text, an enclosing one before those inside it, each with its variables."""
    codes = [root]
    for code in codes:
        for name in code.assigned:
            if code.find(name) is None:
                code.slot(name)
        codes += code.functions.values()
    _find_waiting(codes, functions)
    return codes


def assigned(place: Any) -> str | None:
    """Return the variable that an assignment changes, completely or in part."""
    while place.kind == "place":
        place = place.children[0]
    return place.children[0] if place.kind == "name" else None


def is_pose(place: Node) -> bool:
    """Whether a place begins with a literal such as `p[x, y, z, rx, ry, rz]`."""
    first, trailer, *_ = place.children
    return first.kind == "name" and first.children[0] == "p" and len(trailer.children) == 6


def _find_waiting(codes: list[Code], functions: Functions) -> None:
    """Mark what waits: by a function of the table, or by one of the program that waits."""
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
