"""Commands from entry points: the commands of hil-bridge, of its devices and of plug-ins.

A package adds a command by the name that a user types:

    [project.entry-points."hil_bridge.commands"]
    my-command = "my_package.command:my_command"

The group `hil_bridge.commands.list` adds commands to `hil-bridge list`. There are corresponding groups for `config`,
`decode`, `emulate` and `identify`. The object is a `click.Command`. Its module is imported when the command is used,
and for the list of all commands.
"""

from collections.abc import Callable, Iterable
from typing import Any

import click

from hil_bridge.errors import ConfigError
from hil_bridge.errors.offers import offered, package_of

COMMANDS = "hil_bridge.commands"
"""Entry point group for the commands of `hil-bridge`."""
EXTENSIONS = "hil_bridge.extensions"
"""Entry point group for functions that a package above the core adds to commands of the core."""


class EntryPointGroup(click.Group):
    """Command group that also provides the commands of an entry point group."""

    def __init__(self, *arguments: Any, entry_points: str, **options: Any) -> None:
        """Create a group. `entry_points` is the name of the entry point group."""
        super().__init__(*arguments, **options)
        self.entry_points = entry_points

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands, sorted, without importing any of them."""
        return sorted({*self.commands, *offered().select(group=self.entry_points).names})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command with this name, or None. Raises ConfigError if it cannot be loaded."""
        return super().get_command(ctx, cmd_name) or load_command(self.entry_points, cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands, including commands that cannot be loaded."""
        names = self.list_commands(ctx)
        if names:
            with formatter.section("Commands"):
                formatter.write_dl(self.short_helps(ctx, names, formatter.width - 6 - max(map(len, names))))

    def short_helps(self, ctx: click.Context, names: Iterable[str], width: int) -> list[tuple[str, str]]:
        """Return each name with its line of help, or with the error if the command cannot be loaded."""
        rows = []
        for name in names:
            try:
                command = self.get_command(ctx, name)
            except ConfigError as error:
                rows.append((name, str(error)))
            else:
                rows.append((name, "" if command is None else command.get_short_help_str(width)))
        return rows


def load_command(group: str, name: str) -> click.Command | None:
    """Return the command with this name in an entry point group, or None.

    Raises ConfigError that names the package if the command cannot be loaded, or if two packages provide it.
    """
    command = _load(group, "command", name)
    if command is None or isinstance(command, click.Command):
        return command
    (point,) = offered().select(group=group, name=name)
    raise ConfigError(
        f"the command {name!r} of {package_of(point)} is of type {type(command).__name__}; it must be a click.Command"
    )


def extension(name: str, subject: str) -> Callable[..., Any]:
    """Return the function with this name in the group `hil_bridge.extensions`, which extends a command of the core.

    `subject` names the purpose of the function in the error. Raises ConfigError if the function is not installed or
    cannot be loaded.
    """
    function: Callable[..., Any] | None = _load(EXTENSIONS, "extension", name)
    if function is None:
        from hil_bridge.errors.extras import install_command

        raise ConfigError(
            f"{subject}: the extension {name!r} is not installed",
            remedy=f"install hil-bridge again: {install_command()}",
        )
    return function


def _load(group: str, thing: str, name: str) -> Any:
    """Return the object with this name in an entry point group, or None. Raises ConfigError if it
    cannot be loaded.
    """
    points = list(offered().select(group=group, name=name))
    if not points:
        return None
    if len(points) == 1:
        try:
            return points[0].load()
        except (Exception, SystemExit):  # raised again and explained by find_plugin
            pass
    from hil_bridge.errors.plugins import find_plugin  # slow, and needed only for an error

    plugin = find_plugin(group, thing, name)
    return None if plugin is None else plugin.value
