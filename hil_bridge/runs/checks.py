"""Checks of a run before any motion, which need only the configuration and this computer.

`run` raises the first problem, and `doctor` reports all of them, so that both agree.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from emulators.cell import Cell
from hil_bridge.clock import VIRTUAL_EPOCH
from hil_bridge.clock.realtime import real_time_thread
from hil_bridge.control.program.reach import check_workspace, outermost
from hil_bridge.errors import ConfigError, StepError
from hil_bridge.runs import compose
from hil_bridge.runs.pace import metres
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.zeroing import known_wrist


class Start(NamedTuple):
    """Conditions under which a run starts."""

    virtual: bool
    """Whether the run uses virtual time."""
    now: float = VIRTUAL_EPOCH
    """Time at which the emulated cell is powered up, s."""


def check(setup: Setup, virtual: bool, now: float) -> Cell[Any, Any] | None:
    """Raise the first problem as ConfigError. Return the emulated cell for the run, powered up at `now`, s; None if
    both devices are real.
    """
    for check_one in CHECKS.values():
        check_one(setup, Start(virtual, now))
    return setup.cell


def problems(setup: Setup, virtual: bool) -> Iterator[tuple[str, ConfigError]]:
    """Return all problems that prevent a run with this configuration, by the name of the first check that reports
    each.
    """
    texts: set[str] = set()
    for name, check_one in CHECKS.items():
        try:
            check_one(setup, Start(virtual))
        except ConfigError as error:
            if str(error) not in texts:
                yield name, error
            texts.add(str(error))


def _robot_url(setup: Setup, start: Start) -> None:
    if not setup.robot.is_emulated:
        setup.robot.wires()


def _sensor_url(setup: Setup, start: Start) -> None:
    if not setup.sensor.is_emulated:
        setup.sensor.wires()


def check_wires(setup: Setup, start: Start) -> None:
    """Raise ConfigError if the URLs do not form a cell, or do not work in virtual time."""
    if start.virtual and not (setup.robot.is_emulated and setup.sensor.is_emulated):
        raise ConfigError(
            f"--virtual runs against the emulated cell alone; rehearse with --robot {setup.robot.kind.name} "
            f"--sensor {setup.sensor.kind.name} too, or leave it out to use real ports"
        )
    if setup.sensor.is_emulated and not setup.robot.is_emulated:
        raise ConfigError(
            "a robot without a sensor: the emulated sensor cannot measure the contact of a real robot; "
            "give --sensor (sensor.url) too"
        )


def _panel(setup: Setup, start: Start) -> None:
    compose.check_panel(setup, start.virtual)


def _force(setup: Setup, start: Start) -> None:
    config = setup.config
    if config.task.force_n >= config.limits.force_limit_n:
        raise ConfigError(
            f"task.force_n (--force-n) of {config.task.force_n:g} N must be below limits.force_limit_n of "
            f"{config.limits.force_limit_n:g} N, or every run would be stopped"
        )


def _tool(setup: Setup, start: Start) -> None:
    known_wrist(setup.config)


def _controller(setup: Setup, start: Start) -> None:
    """Check the controller's parameters, and whether it is tuned for the control period."""
    _ = setup.loop


def _power_up(setup: Setup, start: Start) -> None:
    """Power up the emulated cell, if a device is emulated.

    Raises ConfigError for invalid files of the robot's kind, invalid contents of the cell, or an invalid cell.
    """
    robot = setup.robot
    if robot.kind.check is not None:
        robot.kind.check(robot.settings)
    if robot.is_emulated or setup.sensor.is_emulated:
        setup.cell = compose.make_cell(setup, start.now)


def check_program(setup: Setup, start: Start | None = None) -> None:
    """Raise ConfigError, with the number of the step, for a program that cannot be carried out.

    The start of an emulated robot is known, so its reach is checked at the corners of each path.
    """
    program = setup.loop.program
    if not setup.robot.is_emulated:
        return
    config, cell = setup.config, setup.config.cell
    check_workspace(program.row, program.frame, metres(cell.start_position_mm), config.limits)
    for label, place in outermost(program.row, program.frame, metres(cell.start_position_mm)):
        if not compose.can_hold(setup, place):
            x, y, z = (part * 1e3 for part in place)
            raise StepError(
                f"the robot does not reach {x:.0f} {y:.0f} {z:.0f} mm in its base frame, "
                "at the depth of the start, at the safe height or behind a retract",
                label,
            )


def _thread(setup: Setup, start: Start) -> None:
    if not start.virtual:
        with real_time_thread(setup.config.realtime):
            pass


CHECKS: Mapping[str, Callable[[Setup, Start], None]] = {
    "robot.url": _robot_url,
    "sensor.url": _sensor_url,
    "wires": check_wires,
    "force": _force,
    "panel": _panel,
    "controller": _controller,
    "cell": _power_up,
    "program": check_program,
    "realtime": _thread,
    "tool": _tool,
}
"""Checks by name. Each check raises ConfigError for a configuration that cannot be run."""
