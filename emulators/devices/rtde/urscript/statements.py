"""Statements of a program, compiled into closures, and the program that they make.

A statement's closure gives None, or how it leaves its block: `BREAK`, `CONTINUE`, or a `Returned` value.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from lark import Token, Tree

from emulators.devices.rtde.urscript import values
from emulators.devices.rtde.urscript.expressions import UNSET, Expressions, Returned
from emulators.devices.rtde.urscript.failures import (
    Halted,
    ScriptError,
    ScriptSyntaxError,
    SyntaxFailure,
)
from emulators.devices.rtde.urscript.lists import METHODS
from emulators.devices.rtde.urscript.names import Code, analyse, assigned, is_pose, line_of, nodes
from emulators.devices.rtde.urscript.parser import parse
from emulators.devices.rtde.urscript.parts import Frame, Part, Run, charge, combined
from emulators.devices.rtde.urscript.table import Functions
from emulators.devices.rtde.urscript.values import Value


class Leaving:
    """How a statement leaves the loop around it."""


BREAK, CONTINUE = Leaving(), Leaving()
_WRONG = (ScriptError, ArithmeticError, ValueError, RecursionError)
"""A program's faults: those that are known as such, those of Python's arithmetic, and too deep a nesting."""


class CompiledProgram(NamedTuple):
    """A program that can be started any number of times."""

    name: str
    """Of its function; empty for statements without one."""
    secondary: bool
    """`sec`: runs beside a program, and cannot move the arm."""
    root: Code
    main: Code
    calls: frozenset[str]
    """Names of all functions that it calls."""


@lru_cache(maxsize=8)
def _compiled(text: str, tables: tuple[Any, ...]) -> CompiledProgram:
    functions = tables[0].table
    tree = parse(text)
    root = analyse(tree, functions)
    calls = _compile(root, functions)
    block = root.body
    only = block.children[0] if len(block.children) == 1 else None
    if isinstance(only, Tree) and only.data in ("def", "sec"):
        name = str(only.children[0])
        return CompiledProgram(name, only.data == "sec", root, root.functions[name], calls)
    return CompiledProgram("", False, root, root, calls)


class _Key:
    """A table of functions, hashed by its identity."""

    def __init__(self, table: Functions) -> None:
        self.table = table

    def __hash__(self) -> int:
        return id(self.table)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.table is self.table


def compile_program(text: str, functions: Functions) -> CompiledProgram:
    """The program of a text. Raises ScriptSyntaxError. The newest programs are kept."""
    try:
        return _compiled(text, (_Key(functions),))
    except RecursionError:
        raise ScriptSyntaxError(SyntaxFailure(1, 1, "the program is nested too deeply")) from None


def _compile(root: Code, functions: Functions) -> frozenset[str]:
    """Compile a text's functions; the names of all that they call."""
    codes = [root]
    for code in codes:
        codes += code.functions.values()
    for code in codes:
        if code.parent is not None:
            outer = Expressions(code.parent, functions)
            for parameter in code.tree.children[1].children:  # type: ignore[union-attr]
                name, *default = parameter.children  # type: ignore[union-attr]
                if default:
                    part = outer.value(default[0])
                    if part.waits:
                        raise ScriptSyntaxError(
                            SyntaxFailure(line_of(parameter), 1, "a default must not wait")
                        )
                    code.defaults[str(name)] = part.run
    for code in codes:
        part = Statements(code, functions).block(code.body)
        code.run = part.run if part.waits or not code.waits else _as_generator(part.run)
        code.waits = code.waits or part.waits
    return frozenset[str]().union(*(code.calls for code in codes))


def _as_generator(run: Run) -> Run:
    def wait(frame: Frame) -> Any:
        yield from ()
        return run(frame)

    return wait


class Statements:
    """Compiles the statements of one function."""

    def __init__(self, code: Code, functions: Functions) -> None:
        self._code = code
        self._expressions = Expressions(code, functions)
        self._loops = 0

    def block(self, node: Any) -> Part:
        """A row of statements."""
        parts, lines = [], []
        for child in node.children:
            if child.data not in ("def", "thread", "sec", "label"):
                parts.append(getattr(self, f"_{child.data}")(child))
                lines.append(line_of(child))
        runs = tuple(part.run for part in parts)
        if not any(part.waits for part in parts):

            def run(frame: Frame) -> Any:
                at = 0
                try:
                    for at, statement in enumerate(runs):  # noqa: B007 (the line of an error)
                        signal = statement(frame)
                        if signal is not None:
                            return signal
                except _WRONG as error:
                    raise _failed(error, lines[at]) from None
                return None

            return Part(False, run)

        def wait(frame: Frame) -> Any:
            at = 0
            try:
                for at, part in enumerate(parts):  # noqa: B007 (the line of an error)
                    signal = (yield from part.run(frame)) if part.waits else part.run(frame)
                    if signal is not None:
                        return signal
            except _WRONG as error:
                raise _failed(error, lines[at]) from None
            return None

        return Part(True, wait)

    # --- flow

    def _if_(self, node: Tree[Token]) -> Part:
        children = list(node.children[1:])
        otherwise: Part | None = None
        last = children[-1]
        if isinstance(last, Tree) and last.data == "otherwise":
            otherwise = self.block(last.children[0])
            children.pop()
        branches = [
            (self._expressions.value(condition), self.block(block))
            for condition, block in zip(children[::2], children[1::2], strict=True)
        ]
        every = [part for branch in branches for part in branch] + ([otherwise] if otherwise else [])
        if any(part.waits for part in every):

            def wait(frame: Frame) -> Any:
                for condition, block in branches:
                    value = (yield from condition.run(frame)) if condition.waits else condition.run(frame)
                    if value is True or (value is not False and values.truth(value)):
                        return (yield from block.run(frame)) if block.waits else block.run(frame)
                if otherwise is not None:
                    return (yield from otherwise.run(frame)) if otherwise.waits else otherwise.run(frame)
                return None

            return Part(True, wait)
        runs = [(condition.run, block.run) for condition, block in branches]
        rest = otherwise.run if otherwise is not None else lambda frame: None

        def run(frame: Frame) -> Any:
            for condition, block in runs:
                holds = condition(frame)
                if holds is True or (holds is not False and values.truth(holds)):
                    return block(frame)
            return rest(frame)

        return Part(False, run)

    def _while_(self, node: Tree[Token]) -> Part:
        _, asked, body = node.children
        condition = self._expressions.value(asked)
        self._loops += 1
        block = self.block(body)
        self._loops -= 1
        weight = sum(1 for _ in nodes(node))
        if condition.waits or block.waits:

            def wait(frame: Frame) -> Any:
                task = frame[1]
                while True:
                    task.spend(weight)
                    value = (yield from condition.run(frame)) if condition.waits else condition.run(frame)
                    if not values.truth(value):
                        return None
                    signal = (yield from block.run(frame)) if block.waits else block.run(frame)
                    if signal is not None:
                        if signal is BREAK:
                            return None
                        if signal is not CONTINUE:
                            return signal

            return Part(True, wait)
        ask, do = condition.run, block.run

        def run(frame: Frame) -> Any:
            task = frame[1]
            while values.truth(ask(frame)):
                task.spend(weight)
                signal = do(frame)
                if signal is not None:
                    if signal is BREAK:
                        return None
                    if signal is not CONTINUE:
                        return signal
            return None

        return Part(False, run)

    def _break_(self, node: Tree[Token]) -> Part:
        return self._leave(node, BREAK)

    def _continue_(self, node: Tree[Token]) -> Part:
        return self._leave(node, CONTINUE)

    def _leave(self, node: Tree[Token], signal: Leaving) -> Part:
        if not self._loops:
            raise ScriptSyntaxError(SyntaxFailure(line_of(node), 1, "there is no loop to leave"))
        return Part(False, lambda frame: signal)

    def _return_(self, node: Tree[Token]) -> Part:
        _, *value = node.children
        if not value:
            return Part(False, lambda frame: Returned(None))
        return combined([self._expressions.value(value[0])], lambda frame, value: Returned(value))

    def _halt(self, node: Tree[Token]) -> Part:
        def run(frame: Frame) -> Any:
            raise Halted

        return Part(False, run)

    # --- variables

    def _declare(self, node: Tree[Token]) -> Part:
        if len(node.children) < 3:
            return Part(False, lambda frame: None)
        store = self._storing(str(node.children[1]))
        return combined([self._expressions.value(node.children[2])], store)

    def _assign(self, node: Tree[Token]) -> Part:
        place = node.children[0]
        name = assigned(node)
        assert isinstance(place, Tree), "a place"
        if name is None or (place.data == "place" and is_pose(place)):
            raise ScriptSyntaxError(SyntaxFailure(line_of(node), 1, "nothing can be assigned to this"))
        if name == "digital_out" and self._code.find(name) is None and len(place.children) == 2:
            return self._expressions.signal("set_digital_out", place.children[1], node.children[1])
        store, value = self._storing(name), self._expressions.value(node.children[1])
        if place.data == "name":
            return combined([value], store)
        first, *trailers = place.children
        keys: list[Part] = []
        path: list[str | None] = []
        """Names of members; None for an element, whose place is the next key."""
        for trailer in trailers:
            assert isinstance(trailer, Tree), "a trailer"
            if trailer.data == "method":
                raise ScriptSyntaxError(SyntaxFailure(line_of(node), 1, "nothing can be assigned to a call"))
            if trailer.data == "member":
                path.append(str(trailer.children[0]))
            else:
                keys += [self._expressions.value(child) for child in trailer.children]
                path += [None] * len(trailer.children)

        def change(frame: Frame, old: Value, new: Value, *places: Value) -> None:
            charge(frame, (old, new))
            store(frame, _changed(old, path, places, new))

        return combined([self._expressions.value(first), value, *keys], change)

    def _storing(self, name: str) -> Callable[[Frame, Value], None]:
        found = self._code.find(name)
        assert found is not None, "what is assigned has a place"
        hops, slot = found

        def store_own(frame: Frame, value: Value) -> None:
            frame[slot] = value

        def store_outer(frame: Frame, value: Value) -> None:
            for _ in range(hops):
                frame = frame[0]
            frame[slot] = value

        return store_outer if hops else store_own

    # --- others

    def _expression(self, node: Tree[Token]) -> Part:
        place = node.children[0]
        assert isinstance(place, Tree), "an expression"
        part = self._expressions.value(place)
        if place.data == "place" and (change := self._changing(place)) is not None:
            return change
        return combined([part], lambda frame, value: None)

    def _changing(self, place: Tree[Token]) -> Part | None:
        """`list.append(x)` as a statement; None for a call that changes nothing."""
        first, *trailers = place.children
        if len(trailers) != 1 or not isinstance(first, Tree) or first.data != "name":
            return None
        (call,) = trailers
        if not isinstance(call, Tree) or call.data != "method":
            return None
        method = METHODS.get(str(call.children[0]))
        arguments = call.children[1].children  # type: ignore[union-attr]
        name = str(first.children[0])
        if method is None or method.change is None or len(arguments) != method.arguments:
            return None
        if self._code.find(name) is None:
            return None
        store, act, asks = self._storing(name), method.change, method.ask

        def change(frame: Frame, items: Value, *given: Value) -> None:
            found = values.array(items)
            charge(frame, (found, *given))
            asks(found, *given)
            store(frame, act(found, *given))

        return combined(
            [self._expressions.value(first), *(self._expressions.value(child) for child in arguments)], change
        )

    def _join(self, node: Tree[Token]) -> Part:
        part = self._expressions.value(node.children[0])

        def wait(frame: Frame) -> Any:
            handle = (yield from part.run(frame)) if part.waits else part.run(frame)
            task = frame[1]
            while task.machine.lives(handle):
                yield handle

        return Part(True, wait)

    def _kill(self, node: Tree[Token]) -> Part:
        return combined(
            [self._expressions.value(node.children[0])],
            lambda frame, handle: frame[1].machine.kill(handle),
        )

    def _critical(self, node: Tree[Token]) -> Part:
        """Threads change over only where they wait, so that each row of statements is a critical section.

        Assumed: one that waits inside lets the others run. Universal Robots' C++ client library moves inside one for
        as long as a trajectory takes, and reads its socket in another.
        """
        return Part(False, lambda frame: None)


def _failed(error: Exception, line: int) -> ScriptError:
    """The program's fault, with the line of the innermost statement."""
    if isinstance(error, ScriptError):
        error.line = error.line or line
        return error
    deep = isinstance(error, RecursionError)
    failure = ScriptError("too many functions have called each other" if deep else f"arithmetic: {error}")
    failure.line = line
    return failure


def _changed(old: Value, path: Sequence[str | None], keys: Sequence[Value], new: Value) -> Value:
    """The value with another one at the end of the path."""
    if not path:
        return new
    name, *rest = path
    if name is not None:
        return values.with_member(old, name, _changed(values.member(old, name), rest, keys, new))
    place, *later = keys
    inner = _changed(values.element(old, place), rest, later, new) if rest else new
    return values.with_element(old, place, inner)


def frame_of(code: Code, outer: Any, task: Any) -> Frame:
    """An empty frame."""
    return [outer, task, *[UNSET] * len(code.slots)]
