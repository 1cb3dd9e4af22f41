"""Statements of a program, compiled to closures, and the program composed of them.

The closure of a statement returns a signal if it leaves its block: `BREAK`, `CONTINUE`, or a `Returned` value. Any
other result has no meaning. The closure of a statement that waits returns a generator instead.
"""

from collections.abc import Callable, Generator, Sequence
from types import GeneratorType
from typing import Any, NamedTuple, TypeAlias

from emulators.devices.rtde.urscript import values
from emulators.devices.rtde.urscript.expressions import UNSET, Expressions, Returned
from emulators.devices.rtde.urscript.failures import (
    Halted,
    ScriptError,
    ScriptSyntaxError,
    SyntaxFailure,
)
from emulators.devices.rtde.urscript.lists import METHODS
from emulators.devices.rtde.urscript.names import Code, Node, assigned, is_pose, resolve
from emulators.devices.rtde.urscript.parser import parse
from emulators.devices.rtde.urscript.parts import Frame, Part, charge, combined
from emulators.devices.rtde.urscript.table import Functions
from emulators.devices.rtde.urscript.values import Value


class Leaving:
    """Reasons why a statement leaves the enclosing loop."""


BREAK, CONTINUE = Leaving(), Leaving()
_SIGNALS = (Leaving, Returned)
Steps: TypeAlias = Generator[None, None, Part]
_WRONG = (ScriptError, ArithmeticError, ValueError, RecursionError)
"""Exceptions that are errors of the program: its own errors, the errors of Python's arithmetic, and excessive
nesting.
"""


_KEPT = 8
"""Maximum number of compiled programs in the cache. Chosen."""
_newest: dict[tuple[str, int], tuple[Functions, "CompiledProgram"]] = {}
"""Cache of compiled programs by text and table of functions, newest last."""


class CompiledProgram(NamedTuple):
    """Program that can be started any number of times."""

    name: str
    """Name of the program's function; empty if the statements are outside a function."""
    secondary: bool
    """Whether it is a `sec` program, which runs alongside the main program and cannot move the arm."""
    root: Code
    main: Code
    calls: frozenset[str]
    """Names of all functions that the program calls."""


def compile_program(text: str, functions: Functions) -> CompiledProgram:
    """Compile a program. Raises ScriptSyntaxError."""
    steps = compile_in_steps(text, functions)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            program: CompiledProgram = end.value
            return program


def compile_in_steps(text: str, functions: Functions) -> Generator[None, None, CompiledProgram]:
    """Compile a program, one statement per step. Raises ScriptSyntaxError. The newest programs are cached."""
    known = _newest.get(key := (text, id(functions)))
    if known is None:
        try:
            known = functions, (yield from _compiled(text, functions))
        except RecursionError:
            raise ScriptSyntaxError(SyntaxFailure(1, 1, "the program is nested too deeply")) from None
        while len(_newest) >= _KEPT:
            del _newest[next(iter(_newest))]
        _newest[key] = known
    return known[1]


def _compiled(text: str, functions: Functions) -> Generator[None, None, CompiledProgram]:
    root = yield from parse(text)
    codes = resolve(root, functions)
    yield
    for code in codes:
        _compile_defaults(code, functions)
    for code in codes:
        part = yield from Statements(code, functions).block(code.body)
        code.run = part.run
        code.waits = code.waits or part.waits
    calls = frozenset[str]().union(*(code.calls for code in codes))
    statements = root.body.children
    for code in codes:
        del code.body
    if len(statements) == 1 and statements[0].kind in ("def", "sec"):
        name = statements[0].children[0]
        return CompiledProgram(name, statements[0].kind == "sec", root, root.functions[name], calls)
    return CompiledProgram("", False, root, root, calls)


def _compile_defaults(code: Code, functions: Functions) -> None:
    """Compile the defaults of a function's parameters, which are evaluated in the enclosing scope."""
    for name, node in code.default_nodes.items():
        assert code.parent is not None, "a text has no parameters"
        part = Expressions(code.parent, functions).value(node)
        if part.waits:
            raise node.misplaced("a default must not wait")
        code.defaults[name] = part.run


class Statements:
    """Compiler for the statements of one function."""

    def __init__(self, code: Code, functions: Functions) -> None:
        self._code = code
        self._expressions = Expressions(code, functions)
        self._loops = 0

    def block(self, node: Node) -> Steps:
        """Compile a sequence of statements, one per step."""
        parts, lines = [], []
        for child in node.children:
            if child.kind not in ("def", "thread", "sec", "label"):
                part = getattr(self, f"_{child.kind}")(child)
                parts.append((yield from part) if child.kind in ("if", "while") else part)
                lines.append(child.line)
                yield
        runs = tuple(part.run for part in parts)
        if not any(part.waits for part in parts):

            def run(frame: Frame) -> Any:
                at = 0
                try:
                    for at, statement in enumerate(runs):  # noqa: B007 (the line of an error)
                        signal = statement(frame)
                        if signal is not None and signal.__class__ in _SIGNALS:
                            return signal
                except _WRONG as error:
                    raise _failed(error, lines[at]) from None
                return None

            return Part(False, run)

        def wait(frame: Frame) -> Any:
            at = 0
            try:
                for at, statement in enumerate(runs):  # noqa: B007 (the line of an error)
                    signal = statement(frame)
                    if signal is not None:
                        if signal.__class__ is GeneratorType:
                            signal = yield from signal
                        if signal.__class__ in _SIGNALS:
                            return signal
            except _WRONG as error:
                raise _failed(error, lines[at]) from None
            return None

        return Part(True, wait)

    # --- flow

    def _if(self, node: Node) -> Steps:
        children, otherwise = list(node.children), None
        if len(children) % 2:
            otherwise = yield from self.block(children.pop())
        branches = []
        for condition, block in zip(children[::2], children[1::2], strict=True):
            branches.append((self._expressions.value(condition), (yield from self.block(block))))
        runs = [(condition.run, block.run) for condition, block in branches]
        rest = otherwise.run if otherwise is not None else lambda frame: None
        if any(condition.waits for condition, _ in branches):

            def wait(frame: Frame) -> Any:
                for condition, block in runs:
                    holds = condition(frame)
                    if holds.__class__ is GeneratorType:
                        holds = yield from holds
                    if values.truth(holds):
                        signal = block(frame)
                        break
                else:
                    signal = rest(frame)
                return (yield from signal) if signal.__class__ is GeneratorType else signal

            return Part(True, wait)

        def run(frame: Frame) -> Any:
            for condition, block in runs:
                holds = condition(frame)
                if holds is True or (holds is not False and values.truth(holds)):
                    return block(frame)
            return rest(frame)

        waits = any(block.waits for _, block in branches) or (otherwise is not None and otherwise.waits)
        return Part(waits, run)

    def _while(self, node: Node) -> Steps:
        test, body, weight = node.children
        condition = self._expressions.value(test)
        self._loops += 1
        block = yield from self.block(body)
        self._loops -= 1
        ask, do = condition.run, block.run
        if condition.waits or block.waits:

            def wait(frame: Frame) -> Any:
                task = frame[1]
                while True:
                    task.spend(weight)
                    holds = ask(frame)
                    if holds.__class__ is GeneratorType:
                        holds = yield from holds
                    if not values.truth(holds):
                        return None
                    signal = do(frame)
                    if signal.__class__ is GeneratorType:
                        signal = yield from signal
                    if signal is not None:
                        if signal is BREAK:
                            return None
                        if signal is not CONTINUE:
                            return signal

            return Part(True, wait)

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

    def _break(self, node: Node) -> Part:
        return self._leave(node, BREAK)

    def _continue(self, node: Node) -> Part:
        return self._leave(node, CONTINUE)

    def _leave(self, node: Node, signal: Leaving) -> Part:
        if not self._loops:
            raise node.misplaced("there is no loop to leave")
        return Part(False, lambda frame: signal)

    def _return(self, node: Node) -> Part:
        if not node.children:
            return Part(False, lambda frame: Returned(None))
        return combined([self._expressions.value(node.children[0])], lambda frame, value: Returned(value))

    def _halt(self, node: Node) -> Part:
        def run(frame: Frame) -> Any:
            raise Halted

        return Part(False, run)

    # --- variables

    def _declare(self, node: Node) -> Part:
        name, *value = node.children
        if not value:
            return Part(False, lambda frame: None)
        return self._put(name, self._expressions.value(value[0]))

    def _assign(self, node: Node) -> Part:
        place = node.children[0]
        name = assigned(place)
        if name is None or (place.kind == "place" and is_pose(place)):
            raise node.misplaced("cannot assign to this expression")
        if name == "digital_out" and self._code.find(name) is None and len(place.children) == 2:
            return self._expressions.signal("set_digital_out", place.children[1], node.children[1])
        value = self._expressions.value(node.children[1])
        if place.kind == "name":
            return self._put(name, value)
        store = self._store(name)
        first, *trailers = place.children
        keys: list[Part] = []
        path: list[str | None] = []
        """Name of each member on the path to the target; None for an element, whose index is the next key."""
        for trailer in trailers:
            if trailer.kind == "method":
                raise node.misplaced("cannot assign to a call")
            if trailer.kind == "member":
                path.append(trailer.children[0])
            else:
                keys += [self._expressions.value(child) for child in trailer.children]
                path += [None] * len(trailer.children)

        def change(frame: Frame, old: Value, new: Value, *places: Value) -> None:
            charge(frame, (old, new))
            store(frame, _changed(old, path, places, new))

        return combined([self._expressions.value(first), value, *keys], change)

    def _put(self, name: str, value: Part) -> Part:
        """Compile the assignment of a value to a variable."""
        variable, run = self._code.find(name), value.run
        if value.waits or variable is None or variable[0]:
            return combined([value], self._store(name))
        _, slot = variable

        def put(frame: Frame) -> None:
            frame[slot] = run(frame)

        return Part(False, put)

    def _store(self, name: str) -> Callable[[Frame, Value], None]:
        variable = self._code.find(name)
        assert variable is not None, "what is assigned has a place"
        hops, slot = variable

        def store_own(frame: Frame, value: Value) -> None:
            frame[slot] = value

        def store_outer(frame: Frame, value: Value) -> None:
            for _ in range(hops):
                frame = frame[0]
            frame[slot] = value

        return store_outer if hops else store_own

    # --- others

    def _expression(self, node: Node) -> Part:
        place = node.children[0]
        part = self._expressions.value(place)
        if place.kind == "place" and (change := self._change_list(place)) is not None:
            return change
        return part

    def _change_list(self, place: Node) -> Part | None:
        """Compile `list.append(x)` as a statement. Return None if the call changes nothing."""
        first, *trailers = place.children
        if len(trailers) != 1 or first.kind != "name":
            return None
        (call,) = trailers
        if call.kind != "method":
            return None
        method = METHODS.get(call.children[0])
        arguments = call.children[1]
        name = first.children[0]
        if method is None or method.change is None or len(arguments) != method.arguments:
            return None
        if self._code.find(name) is None:
            return None
        store, act, evaluate = self._store(name), method.change, method.evaluate

        def change(frame: Frame, items: Value, *arguments: Value) -> None:
            before = values.array(items)
            charge(frame, (before, *arguments))
            evaluate(before, *arguments)
            store(frame, act(before, *arguments))

        return combined(
            [self._expressions.value(first), *(self._expressions.value(child) for child in arguments)], change
        )

    def _join(self, node: Node) -> Part:
        part = self._expressions.value(node.children[0])

        def wait(frame: Frame) -> Any:
            handle = part.run(frame)
            if handle.__class__ is GeneratorType:
                handle = yield from handle
            task = frame[1]
            while task.machine.is_running(handle):
                yield handle

        return Part(True, wait)

    def _kill(self, node: Node) -> Part:
        return combined(
            [self._expressions.value(node.children[0])],
            lambda frame, handle: frame[1].machine.kill(handle),
        )

    def _critical(self, node: Node) -> Part:
        """Compile a critical section.

        Threads switch only when they wait, so every sequence of statements without a wait is a critical section.
        Assumed: a thread that waits inside lets the other threads run. Universal Robots' C++ client library moves
        inside a critical section for the duration of a trajectory, and reads its socket in another thread.
        """
        return Part(False, lambda frame: None)


def _failed(error: Exception, line: int) -> ScriptError:
    """Return the program's error, with the line number of the innermost statement."""
    if isinstance(error, ScriptError):
        error.line = error.line or line
        return error
    deep = isinstance(error, RecursionError)
    failure = ScriptError("function calls are nested too deeply" if deep else f"arithmetic: {error}")
    failure.line = line
    return failure


def _changed(old: Value, path: Sequence[str | None], keys: Sequence[Value], new: Value) -> Value:
    """Return a value in which the element or member at the end of the path is replaced."""
    if not path:
        return new
    name, *rest = path
    if name is not None:
        return values.with_member(old, name, _changed(values.member(old, name), rest, keys, new))
    place, *later = keys
    inner = _changed(values.element(old, place), rest, later, new) if rest else new
    return values.with_element(old, place, inner)


def frame_of(code: Code, outer: Any, task: Any) -> Frame:
    """Return a frame in which no variable is set."""
    return [outer, task, *[UNSET] * len(code.slots)]
