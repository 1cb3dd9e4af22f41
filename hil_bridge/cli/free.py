"""`hil-bridge free`: lift a tool that a stop left in contact."""

from pathlib import Path

import click

from hil_bridge.cli.devices import url_options
from hil_bridge.console.paths import FILE


@click.command(short_help="Lift off a tool that was left in contact.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@url_options
@click.option(
    "--tool-mass-kg",
    type=click.FloatRange(min=0.0),
    metavar="M",
    help="Mass below the sensor: forces are then reported without its weight.",
)
@click.option(
    "--distance-mm",
    type=click.FloatRange(0.1, 500.0),
    metavar="D",
    help="How far to move away.  [default: task.retract_mm]",
)
@click.option(
    "--back-to",
    metavar="RECORDING",
    type=FILE,
    help="Then return to where this recorded run began, so that the next one begins there too.",
)
def free(
    config_file: Path | None,
    robot: str | None,
    sensor: str | None,
    tool_mass_kg: float | None,
    distance_mm: float | None,
    back_to: Path | None,
) -> None:
    """Lift a tool off, whatever state a stop left it in; stay at the cell while it moves.

    The tool moves against frame.approach in small slow steps, and stops if the force rises. A movement
    sequence that was left open is closed first. The sensor is not zeroed, and no program is run.

    With --back-to it then moves sideways to above the recorded start and down to it, in small steps. It stops at a
    touch. The tool's load must be known, and the orientation stays as it is. The recording must be of a run on this
    kind of robot, and not of an emulated one.
    """
    from hil_bridge.errors import ConfigError
    from hil_bridge.record import read
    from hil_bridge.runs.signals import as_ctrl_c
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.devices import robot_in
    from hil_bridge.site.free import free as free_tool
    from hil_bridge.site.return_path import start_of

    config = load_config(
        config_file, {"robot.url": robot, "sensor.url": sensor, "tool.mass_kg": tool_mass_kg}
    )
    if not (config.robot.url and config.sensor.url):
        raise ConfigError(
            "name the robot and the sensor of the tool: --robot and --sensor, or robot.url and sensor.url"
        )
    goal = None if back_to is None else start_of(read(back_to), robot_in(config).kind.name)
    with as_ctrl_c():
        freed = free_tool(config, distance_mm or max(config.task.retract_mm, 1.0), click.echo, goal)
    click.echo(freed.text)
