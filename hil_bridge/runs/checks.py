"""Refusals of a run before anything moves, from its configuration and this computer alone.

`run` raises the first of these, `doctor` tells all of them: so that the one cannot pass what the other refuses.
"""

from collections.abc import Callable, Iterator, Mapping

from hil_bridge.clock import VIRTUAL_EPOCH
from hil_bridge.clock.realtime import real_time_thread
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.reach import check_workspace, outermost
from hil_bridge.devices.kinds import ROBOTS, emulated_sensor
from hil_bridge.errors import ConfigError
from hil_bridge.runs.compose import check_panel, holds, make_cell
from hil_bridge.runs.pace import control_loop, metres, paced
from hil_bridge.runs.zeroing import known_wrist
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.kinds import robot_kind, settings_of


def check(config: Config, virtual: bool) -> None:
    """Raise the first of the problems as ConfigError."""
    for _, error in problems(config, virtual):
        raise error


def problems(config: Config, virtual: bool) -> Iterator[tuple[str, ConfigError]]:
    """Everything that keeps a run with this configuration from beginning, by the name of its check."""
    for name, check_one in CHECKS.items():
        try:
            check_one(config, virtual)
        except ConfigError as error:
            yield name, error


def check_wires(config: Config, virtual: bool) -> None:
    """Raise ConfigError for URLs that make no cell together, or that virtual time cannot wait for."""
    if virtual and (config.robot.url or config.sensor.url):
        raise ConfigError("--virtual runs against the emulated cell alone; leave it out to use real ports")
    if config.robot.url and not config.sensor.url:
        raise ConfigError(
            "a robot without a sensor: the emulated sensor cannot feel what that robot touches; "
            "give --sensor (sensor.url) too"
        )


def _force(config: Config, virtual: bool) -> None:
    if config.task.force_n >= config.limits.force_limit_n:
        raise ConfigError(
            f"task.force_n (--force-n) of {config.task.force_n:g} N must be below limits.force_limit_n of "
            f"{config.limits.force_limit_n:g} N, or every run would be stopped"
        )


def _tool(config: Config, virtual: bool) -> None:
    known_wrist(config)


def _controller(config: Config, virtual: bool) -> None:
    """The controller's parameters, and that it is tuned for the control period."""
    control_loop(paced(config))


def _cell(config: Config, virtual: bool) -> None:
    """The files of the robot's kind, and of an emulated cell what it holds and whether it can be at all."""
    robot = robot_kind(config)
    if robot.check is not None:
        robot.check(settings_of(config, robot))
    if not (config.robot.url and config.sensor.url):
        make_cell(
            config, ROBOTS.kind(config.robot.emulated), emulated_sensor(config.sensor.emulated), VIRTUAL_EPOCH
        )


def check_program(config: Config, virtual: bool = False) -> None:
    """Raise ConfigError with the step's number for a program that cannot be carried out.

    Where the robot is emulated, its start is known, and so whether it reaches the corners of each path.
    """
    program = control_loop(paced(config)).task
    if not isinstance(program, Program) or config.robot.url:
        return
    cell = config.cell
    check_workspace(program.row, program.frame, metres(cell.start_position_mm), config.limits)
    for label, place in outermost(program.row, program.frame, metres(cell.start_position_mm)):
        if not holds(config, place):
            x, y, z = (part * 1e3 for part in place)
            raise ConfigError(
                f"task.step {label}: the robot does not reach {x:.0f} {y:.0f} {z:.0f} mm in its base frame, "
                "at the depth of the start, at the safe height or behind a retract"
            )


def _thread(config: Config, virtual: bool) -> None:
    if not virtual:
        with real_time_thread(config.realtime):
            pass


CHECKS: Mapping[str, Callable[[Config, bool], None]] = {
    "wires": check_wires,
    "force": _force,
    "panel": check_panel,
    "controller": _controller,
    "cell": _cell,
    "program": check_program,
    "realtime": _thread,
    "tool": _tool,
}
"""Each raises ConfigError for a configuration that cannot be run; the second argument says whether in virtual time."""
