"""A program that runs: its threads, cycle by cycle.

In each cycle every thread runs, in the order of their beginning, until it waits: for the next cycle, or for another
thread. Universal Robots' manual gives a thread 2 ms of a cycle; here a bound on steps stands for them.
"""

from collections.abc import Generator
from typing import Any, TypeAlias

from emulators.devices.rtde.urscript.failures import Halted, RuntimeFailure, ScriptError
from emulators.devices.rtde.urscript.host import Host, Socket
from emulators.devices.rtde.urscript.limits import (
    MEMORY_LOOK_STEPS,
    MEMORY_MAX,
    THREADS_MAX,
    THREADS_TOGETHER,
)
from emulators.devices.rtde.urscript.names import Code
from emulators.devices.rtde.urscript.statements import CompiledProgram, frame_of
from emulators.devices.rtde.urscript.table import NO_EFFECT
from emulators.devices.rtde.urscript.values import Struct, Value

Turns: TypeAlias = Generator[Any, None, Any]
_MAIN = 1
"""Handle of the program itself."""


class Task:
    """One thread."""

    def __init__(self, machine: "Machine", name: str, handle: int) -> None:
        self.machine, self.name, self.handle = machine, name, handle
        self.turns: Turns = _nothing()
        self.left = 0
        """Steps that it may still take in this cycle."""
        self.reads = 0
        """Reads of sockets in this cycle."""
        self.depth = 0
        """Functions that have called each other."""
        self.kept: list[list[Any]] = []
        """Frames of its functions, and values of calls that are not complete, the newest last."""
        self.waits_for: Any = None
        """Handle of the thread whose end it waits for."""
        self.rests = False
        """Whether it waits for the next cycle."""

    @property
    def host(self) -> Host:
        """The robot, as functions of the table know it."""
        return self.machine.host

    def spend(self, steps: int) -> None:
        """Take steps of this cycle. Raises ScriptError where none is left."""
        self.left -= steps
        if self.left < 0:
            raise ScriptError("a thread runs too long without waiting: an infinite loop?")

    def report_tagged(self, function: str, detail: str = NO_EFFECT) -> None:
        """Report a call of a function without an effect here; `detail` is its treatment."""
        self.machine.report_tagged(function, detail)


def _nothing() -> Turns:
    yield from ()


class Machine:
    """One program that runs."""

    def __init__(self, program: CompiledProgram, host: Host, steps: int) -> None:
        """Limit the steps of a thread in a cycle to `steps`."""
        self.host, self.name = host, program.name
        self._steps = steps
        self._tasks: list[Task] = []
        self._tagged: set[str] = set()
        self._started = 0
        self._used = 0
        """Steps of all threads in this cycle."""
        self._not_looked = 0
        """Steps since the last look at what the program keeps."""
        self.sockets: dict[str, Socket] = {}
        """Connections that the program has opened, by name."""
        root, main = frame_of(program.root, None, None), program.main
        task = self._add(main.name)
        root[1] = task
        frame = root if main is program.root else frame_of(main, root, task)
        task.kept.append(frame)
        task.turns = _refuse("a program has no parameters") if main.parameters else _turns(main, frame)

    # --- threads

    def _add(self, name: str) -> Task:
        if len(self._tasks) >= THREADS_MAX:
            raise ScriptError("there are too many threads")
        self._started += 1
        task = Task(self, name, self._started)
        task.left = self._steps
        self._tasks.append(task)
        return task

    def start(self, code: Code, outer: Any, given: list[Any]) -> int:
        """Start a thread in this cycle, with its variables, and return its handle."""
        task = self._add(code.name)
        task.kept.append([outer, task, *given])
        task.turns = _turns(code, task.kept[0])
        return task.handle

    def lives(self, handle: Value) -> bool:
        """Whether this is a thread that has not ended."""
        return any(task.handle == handle for task in self._tasks)

    def kill(self, handle: Value) -> None:
        """End a thread; an unknown handle has no effect."""
        for task in self._tasks:
            if task.handle == handle:
                if task.handle == _MAIN:
                    raise Halted
                self._tasks.remove(task)
                return

    def report_tagged(self, function: str, detail: str) -> None:
        """Told once a program."""
        if function not in self._tagged:
            self._tagged.add(function)
            self.host.report_tagged(function, detail)

    # --- time

    def cycle(self) -> bool:
        """One cycle of all threads; False once the program has ended."""
        for task in self._tasks:
            task.rests, task.left, task.reads = False, self._steps, 0
        self._used = 0
        try:
            while self._pass():
                pass
            self._check_memory()
        except Halted:
            self._tasks.clear()
        except ScriptError as error:
            self._tasks.clear()
            self.host.report_failure(RuntimeFailure(error.line, error.text, error.column))
        if not self._tasks:
            self.close()
        return bool(self._tasks)

    def close(self) -> None:
        """End the program's connections after its end or stop."""
        for socket in self.sockets.values():
            socket.hang_up()
        self.sockets.clear()

    def _pass(self) -> bool:
        """Each thread that can runs once; whether any did."""
        ran = False
        for task in tuple(self._tasks):
            waits = task.waits_for is not None and self.lives(task.waits_for)
            if task.rests or waits or task not in self._tasks:
                continue
            ran, task.waits_for, before = True, None, task.left
            self._run(task)
            self._used += before - task.left
            if self._used > self._steps * THREADS_TOGETHER:
                raise ScriptError("all threads together run too long without waiting")
        return ran

    def _check_memory(self) -> None:
        """Raise ScriptError for a program that uses too much memory. Checked once in this many steps."""
        self._not_looked += self._used
        if self._not_looked < MEMORY_LOOK_STEPS:
            return
        self._not_looked, size, known = 0, 0, set[int]()
        waiting: list[Any] = [rows for task in self._tasks for rows in task.kept]
        while waiting:
            value = waiting.pop()
            if isinstance(value, Struct):
                parts: Any = value.members.values()
            elif isinstance(value, (list, tuple, str)):
                parts = value
            else:
                continue
            if id(value) not in known:
                known.add(id(value))
                size += len(parts)
                if size > MEMORY_MAX:
                    raise ScriptError("the program keeps too much")
                if parts.__class__ is not str:
                    waiting += parts

    def _run(self, task: Task) -> None:
        try:
            waits_for = next(task.turns)
        except StopIteration:
            if task.handle == _MAIN:
                raise Halted from None
            if task in self._tasks:
                self._tasks.remove(task)
            return
        if waits_for is None:
            task.rests = True
        else:
            task.waits_for = waits_for


def _turns(code: Code, frame: Any) -> Turns:
    """Return a thread of this code; one that never waits runs at once."""
    frame[1].spend(code.weight)
    signal = code.run(frame)
    if code.waits:
        yield from signal


def _refuse(text: str) -> Turns:
    yield from ()
    raise ScriptError(text)
