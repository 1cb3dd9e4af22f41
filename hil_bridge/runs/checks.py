"""Refusals of a run before anything moves, from its configuration and this computer alone.

`run` raises the first of these, `doctor` tells all of them: so that the one cannot pass what the other refuses.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from emulators.cell import Cell
from hil_bridge.clock import VIRTUAL_EPOCH
from hil_bridge.clock.realtime import real_time_thread
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.reach import check_workspace, outermost
from hil_bridge.errors import ConfigError
from hil_bridge.runs import compose
from hil_bridge.runs.pace import metres
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.zeroing import known_wrist


def check(setup: Setup, virtual: bool, now: float) -> Cell[Any, Any] | None:
    """Raise the first of the problems as ConfigError. Gives the emulated cell, powered up `now`, s, for the run to use;
    None where both devices are real.
    """
    cell = None
    for check_one in CHECKS.values():
        if check_one is _cell:
            cell = powered_cell(setup, now)
        else:
            check_one(setup, virtual)
    return cell


def problems(setup: Setup, virtual: bool) -> Iterator[tuple[str, ConfigError]]:
    """Everything that keeps a run with this configuration from beginning, each by the name of the first check that
    tells it.
    """
    texts: set[str] = set()
    for name, check_one in CHECKS.items():
        try:
            check_one(setup, virtual)
        except ConfigError as error:
            if str(error) not in texts:
                yield name, error
            texts.add(str(error))


def check_wires(setup: Setup, virtual: bool) -> None:
    """Raise ConfigError for URLs that make no cell together, or that virtual time cannot wait for."""
    if virtual and not (setup.robot.is_emulated and setup.sensor.is_emulated):
        raise ConfigError("--virtual runs against the emulated cell alone; leave it out to use real ports")
    if setup.sensor.is_emulated and not setup.robot.is_emulated:
        raise ConfigError(
            "a robot without a sensor: the emulated sensor cannot feel what that robot touches; "
            "give --sensor (sensor.url) too"
        )


def _force(setup: Setup, virtual: bool) -> None:
    config = setup.config
    if config.task.force_n >= config.limits.force_limit_n:
        raise ConfigError(
            f"task.force_n (--force-n) of {config.task.force_n:g} N must be below limits.force_limit_n of "
            f"{config.limits.force_limit_n:g} N, or every run would be stopped"
        )


def _tool(setup: Setup, virtual: bool) -> None:
    known_wrist(setup.config)


def _controller(setup: Setup, virtual: bool) -> None:
    """The controller's parameters, and that it is tuned for the control period."""
    _ = setup.loop


def _cell(setup: Setup, virtual: bool) -> None:
    powered_cell(setup, VIRTUAL_EPOCH)


def powered_cell(setup: Setup, now: float) -> Cell[Any, Any] | None:
    """The emulated cell, powered up `now`, s; None where both devices are real.

    Raises ConfigError for the files of the robot's kind, for what the cell holds, and for one that cannot be.
    """
    robot = setup.robot
    if robot.kind.check is not None:
        robot.kind.check(robot.settings)
    if robot.is_emulated or setup.sensor.is_emulated:
        return compose.make_cell(setup, setup.emulated, now)
    return None


def check_program(setup: Setup, virtual: bool = False) -> None:
    """Raise ConfigError with the step's number for a program that cannot be carried out.

    Where the robot is emulated, its start is known, and so whether it reaches the corners of each path.
    """
    program = setup.loop.task
    if not isinstance(program, Program) or not setup.robot.is_emulated:
        return
    config, cell = setup.config, setup.config.cell
    check_workspace(program.row, program.frame, metres(cell.start_position_mm), config.limits)
    for label, place in outermost(program.row, program.frame, metres(cell.start_position_mm)):
        if not compose.holds(setup, place):
            x, y, z = (part * 1e3 for part in place)
            raise ConfigError(
                f"task.step {label}: the robot does not reach {x:.0f} {y:.0f} {z:.0f} mm in its base frame, "
                "at the depth of the start, at the safe height or behind a retract"
            )


def _thread(setup: Setup, virtual: bool) -> None:
    if not virtual:
        with real_time_thread(setup.config.realtime):
            pass


CHECKS: Mapping[str, Callable[[Setup, bool], None]] = {
    "wires": check_wires,
    "force": _force,
    "panel": compose.check_panel,
    "controller": _controller,
    "cell": _cell,
    "program": check_program,
    "realtime": _thread,
    "tool": _tool,
}
"""Each raises ConfigError for a configuration that cannot be run; the second argument says whether in virtual time."""
