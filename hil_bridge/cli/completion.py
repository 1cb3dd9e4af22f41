"""Shell completion of option values: the names of built-in and plug-in kinds."""

from collections.abc import Callable, Sequence

import click

Names = Callable[[], Sequence[str]]
"""Function that returns the names. They are imported only when a shell completes."""
Completer = Callable[[click.Context, click.Parameter, str], list[str]]


def complete(names: Names) -> Completer:
    """Return a completer for `shell_complete` of an option. The completer ignores errors, because a shell cannot
    display them.
    """

    def completer(context: click.Context, parameter: click.Parameter, begun: str) -> list[str]:
        try:
            return [name for name in names() if name.startswith(begun)]
        except Exception:
            return []

    return completer


def robots() -> Sequence[str]:
    """Return the names of the kinds of robot."""
    from hil_bridge.devices.kinds import ROBOTS

    return ROBOTS.names


def sensors() -> Sequence[str]:
    """Return the names of the kinds of sensor."""
    from hil_bridge.devices.kinds import SENSORS

    return SENSORS.names


def surfaces() -> Sequence[str]:
    """Return the names of the kinds of surface."""
    from hil_bridge.devices.kinds import SURFACES

    return SURFACES.names


def setting_keys() -> Sequence[str]:
    """Return the keys of all settings in the notation of `--set`: `limits.force_limit_n=`."""
    from hil_bridge.settings.template import setting_rows

    return [f"{row.section}.{row.name}=" for row in setting_rows() if row.section]


def link_profiles() -> Sequence[str]:
    """Return the names of the link profiles of an S3's computer link."""
    from hil_bridge.cli.entry_points import extension

    names: Sequence[str] = extension("link-profiles", "--link-profile")()
    return names


def controllers() -> Sequence[str]:
    """Return the names of the controllers."""
    from hil_bridge.control.controllers import controller_names

    return controller_names()
