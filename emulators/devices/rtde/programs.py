"""Programs that the emulated controller knows by their names, as generators: one turn a cycle.

Any other one is run as it stands, by `urscript`. Our own program is followed statement by statement; see
`protocol.devices.rtde.program`.
"""

import math
import re
from collections.abc import Callable, Generator, Iterator
from operator import sub
from typing import TypeAlias

from emulators.devices.rtde.arm import Brake, Servo
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
    AGE,
    COMMAND,
    FORCE_NAME,
    GAIN,
    LOOKAHEAD,
    NAME,
    POSE,
    SEQUENCE,
    STATE,
    TAKEN,
    TIME,
    Command,
    State,
)
from protocol.devices.rtde.rotation import pose_of

Turns: TypeAlias = Iterator[None]

_WATCHDOG = re.compile(rb'rtde_set_watchdog\("(\w{1,64})", ([0-9.]{1,12}), "(\w{1,8})"\)')
_HOLD = re.compile(rb"age > (\d{1,9})")
_BRAKE = re.compile(rb"stopl\(([0-9.]{1,12})\)")
_NEAR = re.compile(rb"norm\(n\[j\] - q\[j\]\) > ([0-9.]{1,12})")
_ENABLES = re.compile(rb"ft_rtde_input_enable\(\s*(True|False)")
_COMMAND, _SEQUENCE = f"input_int_register_{COMMAND}", f"input_int_register_{SEQUENCE}"
_PLACE = tuple(f"input_double_register_{number}" for number in range(POSE, POSE + 6))
_TUNING = tuple(f"input_double_register_{number}" for number in (TIME, LOOKAHEAD, GAIN))
_TAKEN, _STATE, _AGE = (f"output_int_register_{number}" for number in (TAKEN, STATE, AGE))
_JOINT_PER_METRE = 2.0
"""Assumed: joint deceleration of stopl, rad/s² for each m/s²; that of an arm of half a metre."""


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
        NAME: _ours,
        "rtde_control": _ur_rtde,
        FORCE_NAME: _force,
    }
    if name in known:
        return lambda: Turning(name, known[name](controller, text))
    compiled = compiled_or_told(controller, text)
    return None if compiled is None else lambda: Script(controller, compiled)


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
        self.cycle = self._machine.cycle


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


def _force(controller: Controller, text: bytes) -> Turns:
    """Takes `external_force_torque` for its sensor. It stays so when the program ends (assumed)."""
    found = _ENABLES.search(text)
    enable = found is not None and found[1] == b"True"
    controller.enable_external_force(enable)
    yield
    while b"while True" in text:
        yield


def braking(controller: Controller, deceleration: float) -> Generator[None, None, None]:
    """Brake, rad/s², until the arm stands."""
    while not controller.still:
        controller.order(Brake(deceleration))
        yield


def _ours(controller: Controller, text: bytes) -> Turns:
    """Our own program, statement by statement."""
    read, write = controller.number, controller.write_output
    if watch := _WATCHDOG.search(text):
        controller.watch_input(watch[1].decode(), float(watch[2]), watch[3].decode())
    hold = int(held[1]) if (held := _HOLD.search(text)) else 50
    brake = _JOINT_PER_METRE * (float(braked[1]) if (braked := _BRAKE.search(text)) else 2.0)
    near = float(nearest[1]) if (nearest := _NEAR.search(text)) else math.inf
    last = read(_SEQUENCE)
    joints = controller.arm.target
    on, age = False, 0
    write(_TAKEN, last)
    write(_STATE, State.READY)
    while (command := read(_COMMAND)) != Command.END:
        sequence = read(_SEQUENCE)
        age += 1
        if command == Command.SERVO and sequence != last:
            last, age = sequence, 0
            write(_TAKEN, sequence)
            six = [*map(read, _PLACE)]
            if not all(map(math.isfinite, six)):
                controller.protective_stop("a target that is no number")
                yield
                continue
            solved = controller.solve(pose_of(six), joints)
            if solved is not None and _farthest(solved, joints) <= near:
                joints, on = solved, True
                controller.target_taken()
                write(_STATE, State.SERVOING)
            else:
                write(_STATE, State.REFUSED)
                if on:
                    yield from braking(controller, brake)
                on = False
        write(_AGE, age)
        if on and (command != Command.SERVO or age > hold):
            yield from braking(controller, brake)
            on = False
            write(_STATE, State.STARVED)
        if command != Command.SERVO:
            write(_STATE, State.READY)
        if not on:
            yield
            continue
        servo = servo_order(controller, joints, *map(read, _TUNING))
        if servo is None:
            return
        controller.order(servo)
        for _ in range(servo.cycles):
            yield
    if on:
        yield from braking(controller, brake)
    write(_STATE, State.ENDED)


def _farthest(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    """The largest difference of a joint, rad."""
    largest: float = max(map(abs, map(sub, one, other)))
    return largest


def servo_order(controller: Controller, joints: tuple[float, ...], *tuning: float) -> Servo | None:
    """servoj with t, lookahead and gain; None where the controller takes none of it, which ends a program.

    Source of the ranges: the script manual. Values outside are taken as the nearest end (assumed).
    """
    time, lookahead, gain = tuning
    if not all(map(math.isfinite, (*joints, *tuning))):
        controller.protective_stop("a servo's setting that is no number")
        return None
    a, b, c, d, e, f = joints
    cycles = max(1, round(min(max(time, 0.0), 1.0) / controller.period))
    return Servo((a, b, c, d, e, f), min(max(lookahead, 0.03), 0.2), min(max(gain, 100.0), 2000.0), cycles)
