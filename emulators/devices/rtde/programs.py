"""Programs of the emulated controller: text in URScript, and what it may order."""

from collections.abc import Callable, Generator, Iterator

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.rehearsal import Rehearsal
from emulators.devices.rtde.script_host import ControllerHost
from emulators.devices.rtde.uploads import nothing
from emulators.devices.rtde.urscript import (
    FUNCTIONS,
    CompiledProgram,
    Machine,
    RuntimeFailure,
    ScriptSyntaxError,
    compile_in_steps,
    functions_of,
)
from emulators.orders import Act, ReceivedOrder
from protocol.devices.rtde.program import NAME

_MOVES = frozenset({"movej", "movel", "movep", "movec", "servoj", "servoc", "speedj", "speedl"})
_ASKS = ("read_input_", "socket_read_")
"""Functions with these names get the orders of a client."""


def start_text(
    controller: Controller, name: str, text: bytes, answer: Callable[[bool], object] = lambda started: None
) -> None:
    """Start the program of a text, where the controller takes programs; `answer` is told whether it starts.

    A text that does not compile is reported and changes nothing: what runs continues. So a client may send `f()` behind
    `def f(): ... end`. The definition plays by itself; the call is a text of its own, in which f is not defined.
    Source: ros-industrial/universal_robot, pull request 165, tried on controllers 1.5, 1.8, 3.0 and 3.1.
    """
    words = f"program {name}" if name else f"script {text[:64].decode('utf-8', 'replace')}"
    order = ReceivedOrder(controller.now, Act.PROGRAM, words, controller.state.takes_programs)
    stops = controller.player.uploads.stops

    def work() -> Iterator[None]:
        compiled = yield from _compiled_or_reported(controller, text)
        if compiled is None:
            answer(False)
            return
        controller.orders.tell(order._replace(moves=_moves_by_itself(compiled)))
        ours = controller.motions.by_registers = compiled.name == NAME
        uploads = controller.player.uploads
        asks = _asks(compiled) and not ours
        uploads.rehearse = Rehearsal(controller, compiled).cycle if asks else nothing
        in_time = order.taken and uploads.stops == stops
        answer(controller.start_program(lambda: Script(controller, compiled), in_time))

    controller.player.uploads.add(work())


def _asks(compiled: CompiledProgram) -> bool:
    """Whether a program goes by what a client sends it."""
    return any(name.startswith(_ASKS) for name in compiled.calls)


def _moves_by_itself(compiled: CompiledProgram) -> bool:
    """Whether its start is an order of motion. One that goes by what a client sends waits for that first."""
    return not _MOVES.isdisjoint(compiled.calls) and not _asks(compiled)


def _compiled_or_reported(
    controller: Controller, text: bytes
) -> Generator[None, None, CompiledProgram | None]:
    """Compile a text in steps; None for one that does not compile, which is reported."""
    functions, uploads = functions_of(controller.version), controller.player.uploads
    try:
        compiled = yield from compile_in_steps(text.decode("utf-8", "replace"), functions)
        uploads.defined = compiled.name
        return compiled
    except ScriptSyntaxError as error:
        failure = error.failure
        ControllerHost(controller).report_failure(failure)
        if failure.function and text.strip() == f"{uploads.defined}()".encode():
            words = f"a call of {failure.function}() behind its definition, which plays by itself"
            controller.report_order(Act.CONTACT, words, False)
        elif failure.function in FUNCTIONS:
            version = ".".join(map(str, controller.version[:3]))
            controller.report_order(
                Act.UNREADABLE, f"URScript {failure.function}(), which {version} does not have", False
            )
        elif failure.function:
            thing = f"URScript {failure.function}()"
            controller.unmodelled.touch(thing, "not known: the text does not compile")
            controller.report_order(Act.REFUSED, f"{thing}, which is not known here", False)
        else:
            controller.report_order(Act.UNREADABLE, f"a program with an error: {failure.text}", False)
        return None


class Script:
    """A program in URScript that plays."""

    def __init__(self, controller: Controller, compiled: CompiledProgram) -> None:
        self._machine = Machine(compiled, ControllerHost(controller), controller.profile.script_steps)
        self.name = compiled.name
        self.cycle, self.close = self._machine.cycle, self._machine.close


def run_secondary(controller: Controller, text: bytes) -> None:
    """Run a program beside another one, within one cycle; it cannot move the arm."""
    controller.counts["secondary programs"] += 1

    def work() -> Iterator[None]:
        compiled = yield from _compiled_or_reported(controller, text)
        if compiled is None:
            return
        if compiled.main.waits:
            failure = RuntimeFailure(1, "a secondary program must not move the arm, or wait")
            ControllerHost(controller).report_failure(failure)
            return
        Script(controller, compiled).cycle()

    controller.player.uploads.add(work())
