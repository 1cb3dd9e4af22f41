"""Options for robot, sensor and surface. A URL selects a real device, the name of a kind an emulated one."""

from collections.abc import Callable, Mapping
from typing import Any

import click

from hil_bridge.cli.completion import complete, link_profiles, robots, sensors, surfaces
from hil_bridge.cli.entry_points import extension


def not_empty(context: click.Context, parameter: click.Parameter, url: str | None) -> str | None:
    """Refuse an empty URL, because it is an unset shell variable and not a request for an emulated device."""
    if url == "":
        raise click.BadParameter("it is empty; leave the option out for the emulated device")
    return url


def known_profile(context: click.Context, parameter: click.Parameter, name: str | None) -> str | None:
    """Raise ConfigError that lists the known profiles if the profile is unknown."""
    if name is not None:
        extension("check-link-profile", "--link-profile")(name)
    return name


link_profile_option = click.option(
    "--link-profile",
    metavar="NAME",
    shell_complete=complete(link_profiles),
    callback=known_profile,
    help="Named settings of an S3's computer link: default, observed-client.  [default: as configured]",
)


def refuse_link_profile(name: str | None, robot: str) -> None:
    """Raise UsageError for link settings of an S3 if the robot is of another kind."""
    if name is not None and robot != "s3":
        raise click.UsageError(
            f"--link-profile applies only to the computer link of an s3, and the robot is {robot}; leave it out",
            click.get_current_context(),
        )


surface_option = click.option(
    "--surface",
    metavar="KIND",
    shell_complete=complete(surfaces),
    callback=not_empty,
    help="Kind of the emulated surface: soft-body, or one from a plug-in.",
)


def url_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options --robot and --sensor to a command, with a short help."""
    for name, kinds, what in (("--sensor", sensors, "Force sensor"), ("--robot", robots, "Robot")):
        command = click.option(
            name,
            metavar="URL",
            shell_complete=complete(kinds),
            callback=not_empty,
            help=f"{what}, KIND+WIRE, as for `hil-bridge run`.",
        )(command)
    return command


def device_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options --robot, --sensor and --surface to a command."""
    for option in (
        surface_option,
        click.option(
            "--sensor",
            metavar="URL",
            shell_complete=complete(sensors),
            callback=not_empty,
            help="Force sensor, KIND+WIRE: jr3+can+socketcan://can0, jr3-uart+serial:///dev/ttyACM0, "
            "netft+udp://192.168.1.1:49152. A kind alone is emulated: jr3, jr3-uart, jr3-board, netft, ft300, "
            "ft300-urcap, ati-can, or one of `hil-bridge list plugins`.",
        ),
        click.option(
            "--robot",
            metavar="URL",
            shell_complete=complete(robots),
            callback=not_empty,
            help="Robot, KIND+WIRE: s3+serial:///dev/ttyUSB0?baudrate=9600&parity=E, egm+udp-bind://0.0.0.0:6510, "
            "rtde+tcp://192.168.1.2. A kind alone is emulated: s3 and egm (ABB), rtde (Universal Robots), rsi (KUKA), "
            "or one of `hil-bridge list plugins`.",
        ),
    ):
        command = option(command)
    return command


def device_settings(robot: str | None, sensor: str | None, surface: str | None) -> Mapping[str, object]:
    """Return the values of these options by setting key. The name of a kind also clears the URL from the file."""

    settings: dict[str, object] = {"cell.surface_kind": surface}
    for section, value in (("robot", robot), ("sensor", sensor)):
        if value is None or not _is_kind(value):
            settings[f"{section}.url"] = value
        else:
            settings |= {f"{section}.emulated": value, f"{section}.url": ""}
    return settings


def _is_kind(value: str) -> bool:
    """Return whether a value is the name of a kind. URLs contain a colon, ports a slash, and addresses a dot."""
    return not any(mark in value for mark in ":/.")
