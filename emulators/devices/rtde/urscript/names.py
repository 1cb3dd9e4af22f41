"""Which variable a name means, and which functions may wait: found before a program runs.

Scopes are lexical. A name that a function assigns without `local` or `global` is that of an enclosing function where
one has it; else it is the function's own. Source: the script manual on scoping rules. Assumed: it does not matter
whether the enclosing function has assigned it yet.
"""

from collections.abc import Callable, Iterator
from typing import Any

from lark import Token, Tree

from emulators.devices.rtde.urscript.table import Functions

FIRST = 2
"""Slots before the variables of a frame: the enclosing frame, and the task."""
_DEFINITIONS = frozenset({"def", "thread", "sec"})
SIGNALS = {"digital_in": "get_digital_in", "digital_out": "get_digital_out"}
"""Arrays of signals, and the functions that read them: `digital_out[1] = True`, as python-urx 0.11.0 writes."""
_WAITING_STATEMENTS = frozenset({"join"})


class Code:
    """A function or a thread of a program, or the text itself."""

    def __init__(self, name: str, parent: "Code | None", tree: Tree[Token]) -> None:
        self.name, self.parent, self.tree = name, parent, tree
        self.parameters: list[str] = []
        self.defaults: dict[str, Callable[[list[Any]], Any]] = {}
        self.slots: dict[str, int] = {}
        self.functions: dict[str, Code] = {}
        self.globals: set[str] = set()
        self.calls: set[str] = set()
        self.waits = False
        self.weight = 1
        """Steps that one run of its body takes, loops left out."""
        self.run: Callable[[list[Any]], Any] = _not_compiled

    @property
    def body(self) -> Tree[Token]:
        """The block of its statements."""
        block = self.tree if self.tree.data == "block" else self.tree.children[-1]
        assert isinstance(block, Tree), "a block"
        return block

    @property
    def root(self) -> "Code":
        """The text."""
        return self if self.parent is None else self.parent.root

    def slot(self, name: str) -> int:
        """The place of a variable of its own."""
        return self.slots.setdefault(name, FIRST + len(self.slots))

    def find(self, name: str) -> tuple[int, int] | None:
        """How many frames out a variable is, and its place there; None where there is none of this name."""
        if name in self.globals:
            return self.hops_to(self.root), self.root.slots[name]
        hops, code = 0, self
        while name not in code.slots:
            if code.parent is None:
                return None
            hops, code = hops + 1, code.parent
        return hops, code.slots[name]

    def find_function(self, name: str) -> "Code | None":
        """The function of a name, seen from here."""
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


def nodes(tree: Tree[Token]) -> Iterator[Tree[Token]]:
    """A tree's nodes, functions inside left out but for their own node."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        if node is tree or node.data not in _DEFINITIONS:
            waiting += [child for child in reversed(node.children) if isinstance(child, Tree)]


def analyse(text: Tree[Token], functions: Functions) -> Code:
    """The text's code, with all functions in it."""
    block = text.children[-1]
    assert isinstance(block, Tree), "a block"
    root = Code("", None, block)
    for node in text.iter_subtrees():
        if node.data == "declare" and node.children[0] == "global":
            root.slot(str(node.children[1]))
    codes: list[Code] = []
    _collect(root, codes)
    _find_waiting(codes, functions)
    return root


def _collect(code: Code, codes: list[Code]) -> None:
    """Names of one function, then of those inside it."""
    codes.append(code)
    inside: list[Code] = []
    for node in nodes(code.body):
        kind = node.data
        code.weight += 1
        if kind in _DEFINITIONS:
            inner = Code(str(node.children[0]), code, node)
            code.functions[inner.name] = inner
            inside.append(inner)
        elif kind == "declare":
            name = str(node.children[1])
            if node.children[0] == "global":
                code.globals.add(name)
            else:
                code.slot(name)
        elif kind == "call":
            code.calls.add(str(node.children[0]))
        elif kind in _WAITING_STATEMENTS:
            code.waits = True
    for node in nodes(code.body):
        if (
            node.data != "assign"
            or not (place := assigned(node))
            or (place in SIGNALS and not is_whole(node))
        ):
            continue
        if code.find(place) is None:
            code.slot(place)
    for inner in inside:
        parameters = inner.tree.children[1]
        assert isinstance(parameters, Tree), "parameters"
        for parameter in parameters.children:
            assert isinstance(parameter, Tree), "a parameter"
            inner.parameters.append(str(parameter.children[0]))
            inner.slot(inner.parameters[-1])
        _collect(inner, codes)


def assigned(node: Tree[Token]) -> str | None:
    """The variable that an assignment changes, also in part."""
    place: Any = node.children[0]
    while isinstance(place, Tree) and place.data == "place":
        place = place.children[0]
    return str(place.children[0]) if isinstance(place, Tree) and place.data == "name" else None


def is_whole(node: Tree[Token]) -> bool:
    """Whether an assignment changes the whole of its variable."""
    place = node.children[0]
    return isinstance(place, Tree) and place.data == "name"


def first_token(node: Any) -> Token | None:
    """The first token of a node; None where it has none."""
    waiting = [node]
    while waiting:
        node = waiting.pop()
        if isinstance(node, Token):
            return node
        waiting += reversed(node.children)
    return None


def line_of(node: Any) -> int:
    """Line of a node's first token; 1 where it has none."""
    token = first_token(node)
    return (token.line if token else None) or 1


def is_pose(node: Tree[Token]) -> bool:
    """Whether a place begins with a literal such as `p[x, y, z, rx, ry, rz]`."""
    first, trailer, *_ = node.children
    assert isinstance(first, Tree), "an atom"
    assert isinstance(trailer, Tree), "a place has trailers"
    return first.data == "name" and first.children[0] == "p" and len(trailer.children) == 6


def _find_waiting(codes: list[Code], functions: Functions) -> None:
    """Mark what waits: by a function of the table, or by one of the program that waits."""
    for code in codes:
        code.waits = code.waits or any(
            name in functions and functions[name].waits and code.find_function(name) is None
            for name in code.calls
        )
    callers: dict[int, list[Code]] = {}
    for code in codes:
        for name in code.calls:
            if (function := code.find_function(name)) is not None:
                callers.setdefault(id(function), []).append(code)
    news = [code for code in codes if code.waits]
    while news:
        for code in callers.get(id(news.pop()), ()):
            if not code.waits:
                code.waits = True
                news.append(code)
