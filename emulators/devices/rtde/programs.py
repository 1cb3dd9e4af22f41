"""Programs of the emulated controller: text in URScript, and what it may order."""

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.rehearsal import Rehearsal
from emulators.devices.rtde.script_host import ControllerHost
from emulators.devices.rtde.urscript import (
    FUNCTIONS,
    CompiledProgram,
    Machine,
    RuntimeFailure,
    ScriptSyntaxError,
    compile_program,
    functions_of,
)
from emulators.orders import Act
from protocol.devices.rtde.program import NAME

_MOVES = frozenset({"movej", "movel", "movep", "movec", "servoj", "servoc", "speedj", "speedl"})
_ASKS = ("read_input_", "socket_read_")
"""Functions with these names get the orders of a client."""


def start_text(controller: Controller, name: str, text: bytes) -> None:
    """Start the program of a text, where the controller takes programs.

    A text that does not compile is reported and changes nothing: what runs goes on. So a client may send `f()` behind
    `def f(): ... end`. The definition plays by itself; the call is a text of its own, in which f is not defined.
    Source: ros-industrial/universal_robot, pull request 165, tried on controllers 1.5, 1.8, 3.0 and 3.1.
    """
    compiled = compiled_or_told(controller, text)
    if compiled is None:
        return
    controller.defined = compiled.name
    words = f"program {name}" if name else f"script {text[:64].decode('utf-8', 'replace')}"
    controller.told(Act.PROGRAM, words, controller.takes_programs, _moves_by_itself(compiled))
    ours = controller.motions.by_registers = compiled.name == NAME
    asks = _asks(compiled) and not ours
    controller.rehearse = Rehearsal(controller, compiled).cycle if asks else _nothing
    controller.start_program(lambda: Script(controller, compiled))


def _nothing() -> None:
    """A program that goes by no inputs orders nothing behind a stop."""


def _asks(compiled: CompiledProgram) -> bool:
    """Whether a program goes by what a client sends it."""
    return any(name.startswith(_ASKS) for name in compiled.calls)


def _moves_by_itself(compiled: CompiledProgram) -> bool:
    """Whether its start is an order of motion. One that goes by what a client sends waits for that first."""
    return not _MOVES.isdisjoint(compiled.calls) and not _asks(compiled)


def compiled_or_told(controller: Controller, text: bytes) -> CompiledProgram | None:
    """The program of a text; None for one that does not compile, which is reported."""
    functions = functions_of(controller.version)
    try:
        return compile_program(text.decode("utf-8", "replace"), functions)
    except ScriptSyntaxError as error:
        failure = error.failure
        ControllerHost(controller).tell_failure(failure)
        if failure.function and text.strip() == f"{controller.defined}()".encode():
            words = f"a call of {failure.function}() behind its definition, which plays by itself"
            controller.told(Act.CONTACT, words, False)
        elif failure.function in FUNCTIONS:
            version = ".".join(map(str, controller.version[:3]))
            controller.told(
                Act.UNREADABLE, f"URScript {failure.function}(), which {version} does not have", False
            )
        elif failure.function:
            thing = f"URScript {failure.function}()"
            controller.unmodelled.touch(thing, "not known: the text does not compile")
            controller.told(Act.REFUSED, f"{thing}, which is not known here", False)
        else:
            controller.told(Act.UNREADABLE, f"a program with an error: {failure.text}", False)
        return None


class Script:
    """A program in URScript that plays."""

    def __init__(self, controller: Controller, compiled: CompiledProgram) -> None:
        self._machine = Machine(compiled, ControllerHost(controller), controller.profile.script_steps)
        self.name = compiled.name
        self.cycle, self.close = self._machine.cycle, self._machine.close


def run_secondary(controller: Controller, text: bytes) -> None:
    """A program that runs beside another one, within this cycle, and cannot move the arm."""
    controller.counts["secondary programs"] += 1
    compiled = compiled_or_told(controller, text)
    if compiled is None:
        return
    controller.defined = compiled.name
    if compiled.main.waits:
        failure = RuntimeFailure(1, "a secondary program must not move the arm, or wait")
        ControllerHost(controller).tell_failure(failure)
        return
    Script(controller, compiled).cycle()
