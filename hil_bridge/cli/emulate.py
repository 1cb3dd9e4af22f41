"""`hil-bridge emulate`: the devices alone, for a bridge or any other client in another process."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from hil_bridge.cli.completion import complete, robots, sensors, surfaces
from hil_bridge.cli.devices import link_profile_option, refuse_link_profile
from hil_bridge.cli.setting_options import over, set_option
from hil_bridge.console.paths import FILE


@click.command(short_help="Serve the emulated cell, its robot or its sensor.")
@click.argument("what", type=click.Choice(["cell", "robot", "sensor"]))
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.option(
    "--robot",
    metavar="KIND",
    shell_complete=complete(robots),
    help="Kind of the robot.  [default: robot.emulated, s3]",
)
@click.option(
    "--sensor",
    metavar="KIND",
    shell_complete=complete(sensors),
    help="Kind of the sensor.  [default: sensor.emulated, jr3]",
)
@click.option(
    "--surface",
    metavar="KIND",
    shell_complete=complete(surfaces),
    help="Kind of the surface: soft-body, or one from a plug-in.",
)
@click.option("--robot-port", metavar="URL", help="Where the robot listens.  [default: by its kind]")
@click.option(
    "--sensor-port",
    metavar="URL",
    help="Where the sensor listens.  [default: by its kind]",
)
@link_profile_option
@click.option("--panel", metavar="URL", help="Where `hil-bridge panel` reaches it: tcp-listen://127.0.0.1:0.")
@click.option(
    "--web", is_flag=True, help="Show the robot's panel on a page in the browser, on this machine alone."
)
@click.option(
    "--web-port", type=click.IntRange(0, 65535), metavar="N", help="Its port.  [default: one that is free]"
)
@set_option
@click.option("--seed", type=int, help="Seed of every random draw in the devices.")
@click.option("--json", "as_json", is_flag=True, help="Print where they listen as one line of JSON.")
def emulate(
    what: str,
    config_file: Path | None,
    robot: str | None,
    sensor: str | None,
    surface: str | None,
    robot_port: str | None,
    sensor_port: str | None,
    link_profile: str | None,
    panel: str | None,
    web: bool,
    web_port: int | None,
    given: dict[str, Any],
    seed: int | None,
    as_json: bool,
) -> None:
    """Serve the emulated cell, or its robot or sensor alone, until stopped with Ctrl-C.

    \b
    Ports to listen on, KIND+WIRE:
      robot   s3+pty:?baudrate=9600&parity=E
              s3+tcp-listen://127.0.0.1:0?baudrate=9600&parity=E
              egm+udp://127.0.0.1:6510
              rsi+udp://127.0.0.1:49152
              rtde+tcp-listen://127.0.0.1:0
      sensor  jr3+can+slcan+pty:
              jr3+can+socketcan://vcan0
              jr3-uart+tcp-listen://127.0.0.1:0
              jr3-board+tcp-listen://127.0.0.1:0
              netft+udp-bind://127.0.0.1:0
              ft300+pty:
              ft300-urcap+tcp-listen://127.0.0.1:63351
              ati-can+can+slcan+pty:
    """
    from hil_bridge.runs.serve import serve
    from hil_bridge.runs.setup import Listen, Setup
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.faults import refuse_faults

    page = web or web_port is not None
    _refuse_unserved(
        what,
        {
            "robot": {
                "--robot": robot,
                "--robot-port": robot_port,
                "--link-profile": link_profile,
                "--panel": panel,
                "--web": page,
            },
            "sensor": {"--sensor": sensor, "--sensor-port": sensor_port},
        },
    )
    config = load_config(
        config_file,
        over(
            given,
            {
                "run.seed": seed,
                "run.panel_url": panel,
                "robot.emulated": robot,
                "cell.s3.link.profile": link_profile,
                "sensor.emulated": sensor,
                "cell.surface_kind": surface,
            },
        ),
    )
    refuse_link_profile(link_profile, config.robot.emulated or "s3")
    if what == "sensor" and config.run.panel_url:
        raise click.UsageError("run.panel_url: `emulate sensor` serves no robot, and a panel is a robot's")
    operable = "inject with `hil-bridge panel`, see --panel" if what != "sensor" else ""
    refuse_faults(config.faults, "hil-bridge emulate", operable)
    listen = Listen(
        None if what == "sensor" else robot_port or "",
        None if what == "robot" else sensor_port or "",
        config.run.panel_url,
    )
    serve(Setup(config, listen), as_json, (web_port or 0) if page else None)


def _refuse_unserved(what: str, options: Mapping[str, Mapping[str, object]]) -> None:
    """Raise UsageError for an option about a device that is not served. `options` are by device and name."""
    for device, given in options.items():
        for name, value in given.items():
            if value and what not in (device, "cell"):
                raise click.UsageError(
                    f"{name} is the {device}'s, and `emulate {what}` serves none; take `emulate cell`, or leave it out"
                )
