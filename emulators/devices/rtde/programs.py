"""Programs that the emulated controller knows by their names, as generators: one turn a cycle.

Any other one is run as it stands, by `urscript`: our own, too, whose registers are known for a judge of clients.
"""

from collections.abc import Callable, Iterator
from typing import TypeAlias

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.running import Program
from emulators.devices.rtde.script_host import ControllerHost
from emulators.devices.rtde.ur_rtde import UrRtde, register_offset
from emulators.devices.rtde.urscript import (
    FUNCTIONS,
    CompiledProgram,
    Machine,
    RuntimeFailure,
    ScriptSyntaxError,
    compile_program,
)
from emulators.orders import Act, HeardOrder
from protocol.devices.rtde.program import (
    COMMAND,
    FORCE_NAME,
    NAME,
    POSE,
    SEQUENCE,
    Command,
)

Turns: TypeAlias = Iterator[None]

_COMMAND, _SEQUENCE = f"input_int_register_{COMMAND}", f"input_int_register_{SEQUENCE}"
_PLACE = tuple(f"input_double_register_{number}" for number in range(POSE, POSE + 6))


_END = object()


class Turning:
    """A program that is a generator."""

    def __init__(self, name: str, turns: Turns) -> None:
        self.name = name
        self._turns = turns

    def cycle(self) -> bool:
        """One turn; False at its end, and where it fails: a value that no arithmetic takes ends a program."""
        try:
            return next(self._turns, _END) is not _END
        except (ArithmeticError, ValueError):
            return False

    def close(self) -> None:
        """It holds nothing."""


def is_known(name: str) -> bool:
    """Whether a program of this name is followed, and not only played without effect."""
    return name in (NAME, "rtde_control", FORCE_NAME)


def intent(controller: Controller, name: str, text: bytes) -> Callable[[tuple[str, ...]], HeardOrder | None]:
    """The order of inputs to a program of this text, whether it plays or not; None for nothing that moves."""
    if name == "rtde_control":
        return UrRtde(controller, register_offset(text)).intent
    if name == NAME:
        return lambda names: _our_intent(controller, names)
    return lambda names: None


def _our_intent(controller: Controller, names: tuple[str, ...]) -> HeardOrder | None:
    read = controller.number
    if _COMMAND not in names or read(_COMMAND) != Command.SERVO:
        return None
    x, y, z = map(read, _PLACE[:3])
    words, reach_m = "servo to a pose", controller.profile.max_target_step_mm * 1e-3
    return HeardOrder(controller.now, Act.MOTION, words, controller.plays, (x, y, z), reach_m=reach_m)


def program(controller: Controller, name: str, text: bytes) -> Callable[[], Program] | None:
    """Makes the program of a text when its time comes. None for a text that is no program, which is told."""
    known: dict[str, Callable[[Controller, bytes], Turns]] = {
        "rtde_control": _ur_rtde,
    }
    if name in known:
        return lambda: Turning(name, known[name](controller, text))
    compiled = compiled_or_told(controller, text)
    return None if compiled is None else lambda: Script(controller, compiled)


def start_text(controller: Controller, name: str, text: bytes) -> None:
    """Start the program of a text, where the controller takes programs. A text that is none is told."""
    words = f"program {name}" if name else f"script {text[:64].decode('utf-8', 'replace')}"
    controller.told(Act.PROGRAM, words, controller.takes_programs, not is_known(name))
    make = program(controller, name, text)
    if make is not None:
        controller.intent = intent(controller, name, text)
        controller.start_program(make)


def compiled_or_told(controller: Controller, text: bytes) -> CompiledProgram | None:
    """The program of a text; None for one that is none, which is told."""
    try:
        return compile_program(text.decode("utf-8", "replace"), FUNCTIONS)
    except ScriptSyntaxError as error:
        ControllerHost(controller).tell_failure(error.failure)
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
    if compiled.main.waits:
        failure = RuntimeFailure(1, "a secondary program must not move the arm, or wait")
        ControllerHost(controller).tell_failure(failure)
        return
    Script(controller, compiled).cycle()


def _ur_rtde(controller: Controller, text: bytes) -> Turns:
    return UrRtde(controller, register_offset(text)).turns()
