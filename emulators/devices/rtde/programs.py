"""Programs of the emulated controller: URScript text, and the commands that it may use."""

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
_INPUT_FUNCTIONS = ("read_input_", "socket_read_")
"""Names of the functions that read a client's orders."""


def start_text(
    controller: Controller, name: str, text: bytes, answer: Callable[[bool], object] = lambda started: None
) -> None:
    """Start the program in a text if the controller accepts programs. `answer` receives whether it starts.

    A text that does not compile is reported and changes nothing: a running program continues. A client may
    therefore send `f()` after `def f(): ... end`. The definition runs as a program of its own. The call is a
    separate text, in which f is not defined. Source: ros-industrial/universal_robot, pull request 165, tried on
    controllers 1.5, 1.8, 3.0 and 3.1.
    """
    description = f"program {name}" if name else f"script {text[:64].decode('utf-8', 'replace')}"
    order = ReceivedOrder(controller.now, Act.PROGRAM, description, controller.state.takes_programs)
    stops = controller.player.uploads.stops

    def work() -> Iterator[None]:
        compiled = yield from _compile_or_report(controller, text)
        if compiled is None:
            answer(False)
            return
        controller.orders.tell(order._replace(moves=_moves_by_itself(compiled)))
        is_streaming_program = controller.motions.by_registers = compiled.name == NAME
        uploads = controller.player.uploads
        is_rehearsed = _depends_on_client(compiled) and not is_streaming_program
        uploads.rehearse = Rehearsal(controller, compiled).cycle if is_rehearsed else nothing
        in_time = order.taken and uploads.stops == stops
        answer(controller.start_program(lambda: Script(controller, compiled), in_time))

    controller.player.uploads.add(work())


def _depends_on_client(compiled: CompiledProgram) -> bool:
    """Return whether a program depends on its client's data."""
    return any(name.startswith(_INPUT_FUNCTIONS) for name in compiled.calls)


def _moves_by_itself(compiled: CompiledProgram) -> bool:
    """Return whether the start of a program is an order of motion. A program that depends on its client's data
    waits for the data first.
    """
    return not _MOVES.isdisjoint(compiled.calls) and not _depends_on_client(compiled)


def _compile_or_report(controller: Controller, text: bytes) -> Generator[None, None, CompiledProgram | None]:
    """Compile a text in steps; report it and return None if it does not compile."""
    functions, uploads = functions_of(controller.version), controller.player.uploads
    try:
        compiled = yield from compile_in_steps(text.decode("utf-8", "replace"), functions)
        uploads.defined = compiled.name
        return compiled
    except ScriptSyntaxError as error:
        failure = error.failure
        ControllerHost(controller).report_failure(failure)
        if failure.function and text.strip() == f"{uploads.defined}()".encode():
            description = f"a call of {failure.function}() after its definition, which runs by itself"
            controller.report_order(Act.CONTACT, description, False)
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
    """Running URScript program."""

    def __init__(self, controller: Controller, compiled: CompiledProgram) -> None:
        self._machine = Machine(compiled, ControllerHost(controller), controller.profile.script_steps)
        self.name = compiled.name
        self.cycle, self.close = self._machine.cycle, self._machine.close


def run_secondary(controller: Controller, text: bytes) -> None:
    """Run a secondary program alongside the running one, within one cycle. It cannot move the arm."""
    controller.counts["secondary programs"] += 1

    def work() -> Iterator[None]:
        compiled = yield from _compile_or_report(controller, text)
        if compiled is None:
            return
        if compiled.main.waits:
            failure = RuntimeFailure(1, "a secondary program must not move the arm, or wait")
            ControllerHost(controller).report_failure(failure)
            return
        Script(controller, compiled).cycle()

    controller.player.uploads.add(work())
