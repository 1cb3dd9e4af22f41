"""Option --set, which overrides one setting of a configuration by its dotted key."""

from collections.abc import Mapping
from typing import Any

import click

from hil_bridge.cli.completion import complete, setting_keys


def _read(context: click.Context, parameter: click.Parameter, given: tuple[str, ...]) -> dict[str, Any]:
    """Return the values by key. Each value is parsed as TOML; text that is not valid TOML is a string."""
    import tomllib

    values: dict[str, Any] = {}
    for text in given:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (equals and key):
            raise click.BadParameter(f"{text!r}: write KEY=VALUE, such as limits.force_limit_n=30")
        if key in values:
            raise click.BadParameter(f"{key} is given twice")
        try:
            values[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[key] = value
    return values


def over(given: Mapping[str, Any], options: Mapping[str, object]) -> dict[str, object]:
    """Return the settings of a command by key. Options that the user gave take precedence over --set."""
    return {**given, **{key: value for key, value in options.items() if value is not None}}


set_option = click.option(
    "--set",
    "given",
    multiple=True,
    metavar="KEY=VALUE",
    callback=_read,
    shell_complete=complete(setting_keys),
    help="Set one setting by its key: limits.force_limit_n=30. Dedicated options take precedence. Repeatable.",
)
"""Option that passes `given` to the command: values by dotted key."""
