"""Execution of a program: its threads, cycle by cycle.

In each cycle every thread runs, in the order of creation, until it waits for the next cycle or for another thread.
Universal Robots' manual gives a thread 2 ms of a cycle. Here, a limit on steps replaces this time.
"""

from collections.abc import Generator
from types import GeneratorType
from typing import Any, TypeAlias

from emulators.devices.rtde.urscript.failures import Halted, RuntimeFailure, ScriptError
from emulators.devices.rtde.urscript.host import Host, Socket
from emulators.devices.rtde.urscript.limits import (
    MEMORY_CHECK_STEPS,
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
"""Handle of the main thread."""


class Task:
    """Thread of a program."""

    def __init__(self, machine: "Machine", name: str, handle: int) -> None:
        self.machine, self.name, self.handle = machine, name, handle
        self.host: Host = machine.host
        """Robot that the functions of the table access."""
        self.turns: Turns = _nothing()
        self.left = 0
        """Number of steps left in this cycle."""
        self.reads = 0
        """Number of socket reads in this cycle."""
        self.depth = 0
        """Nesting depth of function calls."""
        self.kept: list[list[Any]] = []
        """Frames of the thread's functions and values of unfinished calls, newest last."""
        self.waits_for: Any = None
        """Handle of the thread that this thread joins."""
        self.is_waiting = False
        """Whether the thread waits for the next cycle."""

    def spend(self, steps: int) -> None:
        """Charge steps of this cycle. Raises ScriptError if no steps are left."""
        self.left -= steps
        if self.left < 0:
            raise ScriptError("a thread runs too long without waiting: an infinite loop?")

    def report_tagged(self, function: str, detail: str = NO_EFFECT) -> None:
        """Report a call of a function that has no effect in the emulator. `detail` describes how the call was
        treated.
        """
        self.machine.report_tagged(function, detail)


def _nothing() -> Turns:
    yield from ()


class Machine:
    """Running program."""

    def __init__(self, program: CompiledProgram, host: Host, steps: int) -> None:
        """Create a machine. `steps` is the step budget of a thread per cycle."""
        self.host, self.name = host, program.name
        self._steps = steps
        self._tasks: list[Task] = []
        self._tagged: set[str] = set()
        self._started = 0
        self._used = 0
        """Number of steps that all threads have used in this cycle."""
        self._unchecked_steps = 0
        """Number of steps since the last check of the program's memory."""
        self.sockets: dict[str, Socket] = {}
        """Connections opened by the program, by name."""
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

    def start(self, code: Code, outer: Any, values: list[Any]) -> int:
        """Start a thread with its variables in this cycle. Return the thread's handle."""
        task = self._add(code.name)
        task.kept.append([outer, task, *values])
        task.turns = _turns(code, task.kept[0])
        return task.handle

    def is_running(self, handle: Value) -> bool:
        """Return whether a handle belongs to a running thread."""
        return any(task.handle == handle for task in self._tasks)

    def kill(self, handle: Value) -> None:
        """End a thread. No effect for an unknown handle."""
        for task in self._tasks:
            if task.handle == handle:
                if task.handle == _MAIN:
                    raise Halted
                self._tasks.remove(task)
                return

    def report_tagged(self, function: str, detail: str) -> None:
        """Report a call without effect, at most once per program."""
        if function not in self._tagged:
            self._tagged.add(function)
            self.host.report_tagged(function, detail)

    # --- time

    def cycle(self) -> bool:
        """Run all threads for one cycle. Return False once the program has ended."""
        for task in self._tasks:
            task.is_waiting, task.left, task.reads = False, self._steps, 0
        self._used = 0
        try:
            while self._run_ready():
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
        """Close the program's connections after it has ended or was stopped."""
        for socket in self.sockets.values():
            socket.hang_up()
        self.sockets.clear()

    def _run_ready(self) -> bool:
        """Run each ready thread once. Return whether any thread ran."""
        ran = False
        for task in tuple(self._tasks):
            waits = task.waits_for is not None and self.is_running(task.waits_for)
            if task.is_waiting or waits or task not in self._tasks:
                continue
            ran, task.waits_for, before = True, None, task.left
            self._run(task)
            self._used += before - task.left
            if self._used > self._steps * THREADS_TOGETHER:
                raise ScriptError("all threads together run too long without waiting")
        return ran

    def _check_memory(self) -> None:
        """Raise ScriptError for a program that uses too much memory. The check takes place only after a number of
        steps.
        """
        self._unchecked_steps += self._used
        if self._unchecked_steps < MEMORY_CHECK_STEPS:
            return
        self._unchecked_steps, size, known = 0, 0, set[int]()
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
                    raise ScriptError("the program uses too much memory")
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
            task.is_waiting = True
        else:
            task.waits_for = waits_for


def _turns(code: Code, frame: Any) -> Turns:
    """Return a generator that executes this code in a thread. Code that never waits runs at once."""
    frame[1].spend(code.weight)
    signal = code.run(frame)
    if signal.__class__ is GeneratorType:
        yield from signal


def _refuse(text: str) -> Turns:
    yield from ()
    raise ScriptError(text)
