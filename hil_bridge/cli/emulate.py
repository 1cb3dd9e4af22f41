"""`hil-bridge emulate cell`, `robot` and `sensor`: emulated devices for a bridge or any other client."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import click

from hil_bridge.cli.completion import complete, robots, sensors
from hil_bridge.cli.devices import link_profile_option, refuse_link_profile, surface_option
from hil_bridge.cli.setting_options import over, set_option
from hil_bridge.console.paths import FILE

_Option = Callable[[Callable[..., Any]], Callable[..., Any]]
_ROBOT_PORTS = """  robot   s3+pty:?baudrate=9600&parity=E
          s3+tcp-listen://127.0.0.1:0?baudrate=9600&parity=E
          egm+udp://127.0.0.1:6510
          rsi+udp://127.0.0.1:49152
          rtde+tcp-listen://127.0.0.1:0
"""
_SENSOR_PORTS = """  sensor  jr3+can+slcan+pty:
          jr3+can+socketcan://vcan0
          jr3-uart+tcp-listen://127.0.0.1:0
          jr3-board+tcp-listen://127.0.0.1:0
          netft+udp-bind://127.0.0.1:0
          ft300+pty:
          ft300-urcap+tcp-listen://127.0.0.1:63351
          ati-can+can+slcan+pty:
"""
_ROBOT_OPTIONS = (
    click.option(
        "--robot",
        metavar="KIND",
        shell_complete=complete(robots),
        help="Kind of the robot.  [default: robot.emulated, s3]",
    ),
    click.option("--robot-port", metavar="URL", help="Where the robot listens.  [default: by its kind]"),
    link_profile_option,
    click.option(
        "--panel", metavar="URL", help="Where `hil-bridge panel` reaches it: tcp-listen://127.0.0.1:0."
    ),
    click.option(
        "--web", is_flag=True, help="Show the robot's panel on a page in the browser, on this machine alone."
    ),
    click.option(
        "--web-port",
        type=click.IntRange(0, 65535),
        metavar="N",
        help="Its port.  [default: one that is free]",
    ),
)
_SENSOR_OPTIONS = (
    click.option(
        "--sensor",
        metavar="KIND",
        shell_complete=complete(sensors),
        help="Kind of the sensor.  [default: sensor.emulated, jr3]",
    ),
    click.option("--sensor-port", metavar="URL", help="Where the sensor listens.  [default: by its kind]"),
)
_COMMON_OPTIONS: tuple[_Option, ...] = (
    surface_option,
    set_option,
    click.option("--seed", type=int, help="Seed of every random draw in the devices."),
    click.option("--json", "as_json", is_flag=True, help="Print the URLs as one line of JSON."),
)


def _serve(
    what: str,
    config_file: Path | None,
    surface: str | None,
    given: dict[str, Any],
    seed: int | None,
    as_json: bool,
    *,
    robot: str | None = None,
    robot_port: str | None = None,
    link_profile: str | None = None,
    panel: str | None = None,
    web: bool = False,
    web_port: int | None = None,
    sensor: str | None = None,
    sensor_port: str | None = None,
) -> None:
    from hil_bridge.runs.serve import serve
    from hil_bridge.runs.setup import Listen, Setup
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.faults import refuse_faults

    options = {
        "run.seed": seed,
        "run.panel_url": panel,
        "robot.emulated": robot,
        "cell.s3.link.profile": link_profile,
        "sensor.emulated": sensor,
        "cell.surface_kind": surface,
    }
    config = load_config(config_file, over(given, options))
    refuse_link_profile(link_profile, config.robot.emulated or "s3")
    if what == "sensor" and config.run.panel_url:
        raise click.UsageError(
            "run.panel_url: `emulate sensor` serves no robot, and only a robot has a panel"
        )
    operable = "inject with `hil-bridge panel`, see --panel" if what != "sensor" else ""
    refuse_faults(config.faults, "hil-bridge emulate", operable)
    listen = Listen(
        None if what == "sensor" else robot_port or "",
        None if what == "robot" else sensor_port or "",
        config.run.panel_url,
    )
    serve(Setup(config, listen), as_json, (web_port or 0) if web or web_port is not None else None)


def _command(what: str, summary: str, ports: str, *options: _Option) -> click.Command:
    """Return the command that serves `what`, with the options for its devices."""
    serve: Callable[..., None] = partial(_serve, what)
    for option in reversed((*options, *_COMMON_OPTIONS)):
        serve = option(serve)
    serve = click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)(serve)
    text = f"{summary}, until stopped with Ctrl-C.\n\n\b\nPorts to listen on, KIND+WIRE:\n{ports}"
    return click.command(what, help=text, short_help=f"{summary}.")(serve)


cell = _command(
    "cell", "Serve the emulated cell", _ROBOT_PORTS + _SENSOR_PORTS, *_ROBOT_OPTIONS, *_SENSOR_OPTIONS
)
robot = _command("robot", "Serve the emulated robot alone", _ROBOT_PORTS, *_ROBOT_OPTIONS)
sensor = _command("sensor", "Serve the emulated sensor alone", _SENSOR_PORTS, *_SENSOR_OPTIONS)
