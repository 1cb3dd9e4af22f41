"""`hil-bridge emulate force-source`: simulate the force sensor of a robot controller by means of the contact model."""

from pathlib import Path

import click

from hil_bridge.cli.completion import complete, surfaces
from hil_bridge.console.paths import FILE


@click.command(name="force-source", short_help="Give a robot controller the force of an emulated surface.")
@click.argument("url", metavar="rtde+tcp://HOST")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.option(
    "--surface",
    metavar="KIND",
    shell_complete=complete(surfaces),
    help="Kind of the surface: soft-body, or one from a plug-in.  [default: [cell.surface]]",
)
@click.option("--duration", "duration_s", type=click.FloatRange(min=0.0, min_open=True), metavar="S")
@click.option(
    "--limit-n",
    type=click.FloatRange(min=0.0, min_open=True),
    default=200.0,
    show_default=True,
    metavar="F",
    help="Stop at a larger force.",
)
@click.option(
    "--keep-program", is_flag=True, help="Upload no program: the controller already accepts the force."
)
def force_source(
    url: str,
    config_file: Path | None,
    surface: str | None,
    duration_s: float | None,
    limit_n: float,
    keep_program: bool,
) -> None:
    """Read the pose of a Universal Robots controller and write the force of the surface to it.

    The surface is that of [cell.surface] in CONFIG.toml. The controller may be a real one, its maker's simulator, or
    `hil-bridge emulate robot --robot rtde`. Its running program is stopped at the start, unless --keep-program is
    given. Ctrl-C resets the force and exits.
    """
    from hil_bridge.device_commands.rtde.force_source import ForceOptions
    from hil_bridge.device_commands.rtde.force_source_run import run_source
    from hil_bridge.devices.kinds import robot_of
    from hil_bridge.errors import ConfigError
    from hil_bridge.settings.configuration import load_config

    kind, _ = robot_of(url)
    if kind.name != "rtde":
        raise ConfigError(f"{url!r}: a {kind.name} accepts no external force; give rtde+tcp://HOST")
    config = load_config(config_file, {"cell.surface_kind": surface})
    click.echo(run_source(url, config, ForceOptions(limit_n, not keep_program), duration_s))
