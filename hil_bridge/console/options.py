"""Shared parts of commands: options, their groups, and output whose reader may stop before its end."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import click

from hil_bridge.console.paths import FILE

overwrite_option = click.option("--overwrite", is_flag=True, help="Replace existing files.")


def output_option(
    metavar: str, meaning: str, default: Path | None = None
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the option for a command's output file or folder: `-o`, `--output`, the argument `out`.

    The earlier spelling `--out` is refused, and the error names the present spelling.
    """
    option = click.option(
        "-o",
        "--output",
        "out",
        type=FILE,
        default=default,
        show_default=default is not None,
        metavar=metavar,
        help=meaning,
    )
    before = click.option("--out", "earlier_out", hidden=True, expose_value=False, callback=_refuse_out)
    return lambda command: option(before(command))


def _refuse_out(context: click.Context, parameter: click.Parameter, given: str | None) -> None:
    if given is not None:
        raise click.UsageError(f"--out is -o or --output now: write -o {given}", context)


def echo_lines(lines: Iterable[str]) -> None:
    """Print lines for as long as they are read (`| head`). The command still exits with its own code."""
    try:
        for line in lines:
            click.echo(line)
    except BrokenPipeError:
        pass


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
"""Option that passes `as_json` to the command; `echo_json` prints the JSON."""


def echo_json(value: object) -> None:
    """Print a value as JSON. Numbers that JSON cannot represent become null. Keys keep their order."""
    import msgspec

    echo_lines([msgspec.json.format(msgspec.json.encode(value), indent=2).decode()])


_Function = TypeVar("_Function", bound=Callable[..., Any])


def option_group(title: str, *options: Callable[[_Function], _Function]) -> Callable[[_Function], _Function]:
    """Return a decorator that adds options under a title in the help of a `GroupedCommand`."""

    def decorate(function: _Function) -> _Function:
        for option in reversed(options):
            function = option(function)
            function.__click_params__[-1].group_title = title  # type: ignore[attr-defined]
        return function

    return decorate


class GroupedCommand(click.Command):
    """Command whose help shows its options under the titles of their groups."""

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options by group. Options without a group come last."""
        rows: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(context):
            record = parameter.get_help_record(context)
            if isinstance(parameter, click.Option) and record is not None:
                rows.setdefault(getattr(parameter, "group_title", _OTHERS), []).append(record)
        others = rows.pop(_OTHERS, [])
        for title, records in (*rows.items(), (_OTHERS, others)):
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


class ExtrasCommand(click.Command):
    """Command whose help ends with the commands that install the extras which parts of it need, for this
    installation.
    """

    def __init__(self, *arguments: Any, extras: Mapping[str, str], **options: Any) -> None:
        """Create a command. `extras` contains the name of the extra for each part of the command."""
        super().__init__(*arguments, **options)
        self.extras = extras

    def format_epilog(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the installation commands, one per line, so that they can be copied."""
        from hil_bridge.errors.extras import install_command

        super().format_epilog(context, formatter)
        with formatter.section("Extras"):
            for part, extra in self.extras.items():
                formatter.write(f"  {part}: {install_command(extra)}\n")


_OTHERS = "Other options"
