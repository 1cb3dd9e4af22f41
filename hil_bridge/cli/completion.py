"""Names with which a shell completes the values of options: ours, and those of installed packages."""

from collections.abc import Callable, Sequence

import click

Names = Callable[[], Sequence[str]]
"""Gives names, imported when a shell asks."""
Completer = Callable[[click.Context, click.Parameter, str], list[str]]


def complete(names: Names) -> Completer:
    """For `shell_complete` of an option. What cannot be found completes nothing: a shell shows no error."""

    def completer(context: click.Context, parameter: click.Parameter, begun: str) -> list[str]:
        try:
            return [name for name in names() if name.startswith(begun)]
        except Exception:
            return []

    return completer


def robots() -> Sequence[str]:
    """Kinds of robots."""
    from hil_bridge.devices.kinds import ROBOTS

    return ROBOTS.names


def sensors() -> Sequence[str]:
    """Kinds of sensors."""
    from hil_bridge.devices.kinds import SENSORS

    return SENSORS.names


def surfaces() -> Sequence[str]:
    """Kinds of surfaces of other packages."""
    from hil_bridge.devices.kinds import SURFACES

    return SURFACES.names


def setting_keys() -> Sequence[str]:
    """Return the keys of all settings, as `--set` takes them: `limits.force_limit_n=`."""
    from hil_bridge.settings.template import setting_rows

    return [f"{row.section}.{row.name}=" for row in setting_rows() if row.section]


def link_profiles() -> Sequence[str]:
    """Named settings of an S3's computer link."""
    from hil_bridge.cli.entry_points import extension

    names: Sequence[str] = extension("link-profiles", "--link-profile")()
    return names


def controllers() -> Sequence[str]:
    """Names of controllers."""
    from hil_bridge.control.controllers import controller_names

    return controller_names()
