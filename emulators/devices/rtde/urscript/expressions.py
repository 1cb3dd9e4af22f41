"""Expressions of a program, compiled to closures: `run(frame)` returns the value.

A frame is a list: the enclosing frame, the task, then the variables. An expression that calls a waiting function
returns a generator instead; its `Part.waits` is true. Python itself never evaluates text of a program.
"""

from collections.abc import Callable, Mapping, Sequence
from types import GeneratorType
from typing import Any

from emulators.devices.rtde.urscript import values
from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.devices.rtde.urscript.limits import CALLS_MAX, DEPTH_MAX, STRING_MAX
from emulators.devices.rtde.urscript.lists import METHODS
from emulators.devices.rtde.urscript.names import SIGNALS, Code, Node, is_pose
from emulators.devices.rtde.urscript.operators import binary
from emulators.devices.rtde.urscript.parts import (
    NUMBERS,
    Frame,
    Part,
    Run,
    always,
    answer,
    charge,
    combined,
    deferred,
)
from emulators.devices.rtde.urscript.table import Functions
from emulators.devices.rtde.urscript.values import PoseValue, Struct, Value


class Unset:
    """Value of a variable before its first assignment."""


UNSET = Unset()


class Returned:
    """Return value of a function, on its path to the caller."""

    __slots__ = ("value",)

    def __init__(self, value: Value) -> None:
        self.value = value


_LISTS = (tuple, PoseValue)
_HEX_MAX = 66
"""Maximum number of hexadecimal digits in a number. Chosen: enough for 256 bits."""


class Expressions:
    """Compiler for the expressions of one function."""

    def __init__(self, code: Code, functions: Functions) -> None:
        self._code, self._functions = code, functions
        self._depth = 0

    def value(self, node: Any) -> Part:
        """Compile the expression of a node. Raises ScriptSyntaxError for an invalid one."""
        self._depth += 1
        if self._depth > DEPTH_MAX:
            raise node.misplaced("the program is nested too deeply")
        compiled: Part = getattr(self, f"_{node.kind}")(node)
        self._depth -= 1
        return compiled

    # --- literals

    def _number(self, node: Node) -> Part:
        text = node.children[0]
        if text[:2] in ("0x", "0X"):
            if len(text) > _HEX_MAX:
                raise node.misplaced("a number is too large")
            number: float = float(int(text, 16)) if len(text) > 9 else int(text, 16)
        else:
            number = int(text) if text.isdecimal() and len(text) < 10 else float(text)
        return always(number)

    def _string(self, node: Node) -> Part:
        text = node.children[0][1:-1]
        if len(text) > STRING_MAX:
            raise node.misplaced("a string is too long")
        return Part(False, lambda frame: text)

    def _true(self, node: Node) -> Part:
        return always(True)

    def _false(self, node: Node) -> Part:
        return always(False)

    def _none(self, node: Node) -> Part:
        return Part(False, lambda frame: None)

    def _list(self, node: Node) -> Part:
        def make(frame: Frame, *parts: Value) -> Value:
            for part in parts:
                if isinstance(part, (tuple, Struct)):
                    charge(frame, parts)
                    return values.checked(parts)
            return parts

        parts = [self.value(child) for child in node.children]
        if parts and all(part.constant.__class__ in NUMBERS for part in parts):
            return always(tuple(part.constant for part in parts))
        return combined(parts, make)

    # --- variables and their parts

    def _name(self, node: Node) -> Part:
        name = node.children[0]
        variable = self._code.find(name)
        if variable is None:
            raise node.refused(f"compile_error_name_not_found:{name}:")
        hops, slot = variable

        def read_own(frame: Frame) -> Any:
            value = frame[slot]
            if value is UNSET:
                raise ScriptError(f"{name} has no value yet")
            return value

        def read_outer(frame: Frame) -> Any:
            for _ in range(hops):
                frame = frame[0]
            value = frame[slot]
            if value is UNSET:
                raise ScriptError(f"{name} has no value yet")
            return value

        def read_next(frame: Frame) -> Any:
            value = frame[0][slot]
            if value is UNSET:
                raise ScriptError(f"{name} has no value yet")
            return value

        return Part(False, (read_own, read_next)[hops] if hops < 2 else read_outer)

    def _place(self, node: Node) -> Part:
        first, *trailers = node.children
        if is_pose(node):
            literal, *trailers = trailers
            part = combined([self.value(child) for child in literal.children], _pose)
        elif first.kind == "name" and (read := SIGNALS.get(first.children[0])) and self._is_signal(first):
            index, *trailers = trailers
            part = self.signal(read, index)
        else:
            part = self.value(first)
        for trailer in trailers:
            part = self._trailer(part, trailer)
        return part

    def _is_signal(self, name: Node) -> bool:
        """Return whether a name denotes an array of signals that no variable of the program hides."""
        return self._code.find(name.children[0]) is None

    def signal(self, function: str, index: Any, *values: Any) -> Part:
        """Compile access to an element of an array of signals as a call."""
        if index.kind != "index" or len(index.children) != 1:
            raise index.refused("a signal takes one index")
        parts = [self.value(child) for child in (*index.children, *values)]
        return answer(parts, self._functions[function].call)

    def _trailer(self, part: Part, trailer: Node) -> Part:
        if trailer.kind == "index":
            for child in trailer.children:
                part = _index(part, self.value(child))
            return part
        name = trailer.children[0]
        if trailer.kind == "member":
            return combined([part], lambda frame, value: values.member(value, name))
        if name not in METHODS:
            parts = [self.value(child) for child in trailer.children[1]]

            def refuse(frame: Frame, *arguments: Value) -> Any:
                """Return a part for any method of a server of `rpc_factory`, so that no text is refused for one."""
                frame[1].report_tagged(f"rpc_factory().{name}")
                raise ScriptError(f"there is no method {name}")

            return combined([part, *parts], refuse)
        arguments = [self.value(child) for child in trailer.children[1]]
        question = METHODS[name].evaluate

        def evaluate(frame: Frame, value: Value, *arguments: Value) -> Value:
            charge(frame, (value, *arguments))
            return question(values.array(value), *arguments)

        if METHODS[name].arguments != len(arguments):
            raise trailer.refused(f"{name} takes {METHODS[name].arguments} arguments")
        return combined([part, *arguments], evaluate)

    def _named(self, node: Node) -> Part:
        """Refuse named arguments in the call of a method."""
        raise node.refused(f"methods take no named arguments, got {node.children[0]}")

    # --- operators

    def _sum(self, node: Node) -> Part:
        first, *rest = node.children
        part = self.value(first)
        for sign, other in zip(rest[::2], rest[1::2], strict=True):
            part = binary(str(sign), part, self.value(other))
        return part

    _product = _comparison = _sum

    def _sign(self, node: Node) -> Part:
        sign, operand = node.children
        negative = sign == "-"
        if negative and operand.kind == "number":
            return always(-self.value(operand).constant)

        def change(frame: Frame, value: Value) -> Value:
            charge(frame, (value,))
            return values.negate(value) if negative else value

        return combined([self.value(operand)], change)

    def _not(self, node: Node) -> Part:
        return combined([self.value(node.children[0])], lambda frame, value: not values.truth(value))

    def _conjunction(self, node: Node) -> Part:
        return self._short_circuit([self.value(child) for child in node.children[::2]], False)

    def _disjunction(self, node: Node) -> Part:
        first, *rest = node.children
        if all(word == "or" for word in rest[::2]):
            return self._short_circuit([self.value(child) for child in (first, *rest[1::2])], True)
        part = self.value(first)
        for word, other in zip(rest[::2], rest[1::2], strict=True):
            pair = [part, self.value(other)]
            part = self._short_circuit(pair, True) if word == "or" else combined(pair, _differ)
        return part

    def _short_circuit(self, parts: Sequence[Part], until: bool) -> Part:
        """Compile `or` or `and`, which skip the second operand if the first one decides the result."""
        if len(parts) == 1:
            return parts[0]
        if any(part.waits for part in parts):

            def wait(frame: Frame) -> Any:
                for part in parts:
                    value = part.run(frame)
                    if value.__class__ is GeneratorType:
                        value = yield from value
                    if values.truth(value) is until:
                        return until
                return not until

            return Part(True, wait)
        runs = [part.run for part in parts]

        def run(frame: Frame) -> bool:
            for part in runs:
                if values.truth(part(frame)) is until:
                    return until
            return not until

        return Part(False, run)

    # --- calls

    def _call(self, node: Node) -> Part:
        name = node.children[0]
        code = self._code.find_function(name)
        if code is not None:
            return self._own_call(code, node)
        if name == "struct":
            return self._struct(node)
        function = self._functions.get(name)
        if function is None:
            raise node.refused(f"compile_error_name_not_found:{name}:", name)
        parts = self.arguments(name, node, function.parameters, function.defaults)
        call = function.call
        if not function.waits:
            return answer(parts, call)
        return deferred(parts, lambda frame, *arguments: call(frame[1], *arguments))

    def arguments(
        self,
        name: str,
        node: Node,
        parameters: Sequence[str],
        defaults: Mapping[str, Any],
    ) -> list[Part]:
        """Compile the arguments of a call in the order of the parameters. Raises ScriptSyntaxError for invalid
        arguments.
        """
        parts: dict[str, Part] = {}
        positions, known = iter(parameters), frozenset(parameters)
        for child in node.children[1]:
            if child.kind == "named":
                parameter = child.children[0]
                part = self.value(child.children[1])
            else:
                parameter = next(positions, "")
                part = self.value(child)
            if parameter not in known or parameter in parts:
                raise node.refused(
                    f"unknown or repeated argument {parameter} of {name}"
                    if parameter
                    else f"{name} takes {len(parameters)} arguments"
                )
            parts[parameter] = part
        for parameter in parameters:
            if parameter not in parts:
                if parameter not in defaults:
                    raise node.refused(f"{name} needs the argument {parameter}")
                parts[parameter] = _default(defaults[parameter])
        return [parts[parameter] for parameter in parameters]

    def _own_arguments(self, code: Code, node: Node) -> list[Part]:
        """Compile the arguments for a call of one of the program's functions. Defaults are evaluated in the
        defining scope.
        """
        assert code.parent is not None, "a function has an enclosing scope"
        hops = self._code.hops_to(code.parent)

        def outwards(run: Run) -> Run:
            def read(frame: Frame) -> Any:
                for _ in range(hops):
                    frame = frame[0]
                return run(frame)

            return read

        defaults = {name: Part(False, outwards(run)) for name, run in code.defaults.items()}
        return self.arguments(code.name, node, code.parameters, defaults)

    def _own_call(self, code: Code, node: Node) -> Part:
        parts = self._own_arguments(code, node)
        enter = self._make_entry(code)

        def run(frame: Frame, *arguments: Value) -> Any:
            inside = enter(frame, arguments)
            task = frame[1]
            try:
                signal = code.run(inside)
            finally:
                task.kept.pop()
                task.depth -= 1
            return signal.value if signal.__class__ is Returned else None

        if not code.waits:
            return combined(parts, run)

        def wait(frame: Frame, *arguments: Value) -> Any:
            inside = enter(frame, arguments)
            task = frame[1]
            try:
                signal = code.run(inside)
                if signal.__class__ is GeneratorType:
                    signal = yield from signal
            finally:
                task.kept.pop()
                task.depth -= 1
            return signal.value if signal.__class__ is Returned else None

        return deferred(parts, wait)

    def _make_entry(self, code: Code) -> Callable[[Frame, Sequence[Value]], Frame]:
        """Return a function that creates the frame of a call and charges the steps of the call."""
        assert code.parent is not None, "a function has an enclosing scope"
        hops, count, outer = self._code.hops_to(code.parent), len(code.parameters), code

        def enter(frame: Frame, arguments: Sequence[Value]) -> Frame:
            task = frame[1]
            task.spend(outer.weight)
            task.depth += 1
            if task.depth > CALLS_MAX:
                task.depth -= 1
                raise ScriptError("function calls are nested too deeply")
            for _ in range(hops):
                frame = frame[0]
            inside = [frame, task, *arguments, *[UNSET] * (len(outer.slots) - count)]
            task.kept.append(inside)
            return inside

        return enter

    def _run(self, node: Node) -> Part:
        """Compile the start of a thread. The value of the expression is the thread's handle."""
        name = node.children[0]
        code = self._code.find_function(name)
        if code is None:
            raise node.refused(f"compile_error_name_not_found:{name}:")
        parts = self._own_arguments(code, node)
        assert code.parent is not None, "a thread has an enclosing scope"
        hops, thread = self._code.hops_to(code.parent), code

        def start(frame: Frame, *arguments: Value) -> int:
            task = frame[1]
            for _ in range(hops):
                frame = frame[0]
            task.spend(thread.weight)
            rest = [UNSET] * (len(thread.slots) - len(arguments))
            handle: int = task.machine.start(thread, frame, [*arguments, *rest])
            return handle

        return combined(parts, start)

    def _struct(self, node: Node) -> Part:
        names, parts = [], []
        for child in node.children[1]:
            if child.kind != "named":
                raise node.refused("members of a struct need names")
            names.append(child.children[0])
            parts.append(self.value(child.children[1]))

        def make(frame: Frame, *arguments: Value) -> Value:
            charge(frame, arguments)
            return values.checked(Struct(dict(zip(names, arguments, strict=True))))

        return combined(parts, make)


def _default(value: Any) -> Part:
    """Return the default of a parameter: a value from the table, or a compiled expression of the program's own
    function.
    """
    return value if isinstance(value, Part) else Part(False, lambda frame: value)


def _pose(frame: Frame, *parts: Value) -> Value:
    return PoseValue(values.vector(parts, 6))


def _index(items: Part, place: Part) -> Part:
    """Compile access to an element."""
    run, at = items.run, place.constant
    if items.waits or at.__class__ is not int or at < 0:
        return combined([items, place], _element)

    def pick(frame: Frame) -> Value:
        value = run(frame)
        return value[at] if value.__class__ in _LISTS and at < len(value) else values.element(value, at)

    return Part(False, pick)


def _element(frame: Frame, value: Value, place: Value) -> Value:
    if value.__class__ in _LISTS and place.__class__ is int and 0 <= place < len(value):
        return value[place]
    return values.element(value, place)


def _differ(frame: Frame, a: Value, b: Value) -> bool:
    return values.truth(a) is not values.truth(b)
