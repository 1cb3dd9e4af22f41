"""Bugs on the screen: one line, or with the option `--debug` the traceback."""

import click

_KEY = "hil_bridge.debug"


def _note(context: click.Context, parameter: click.Parameter, given: bool) -> None:
    if given:
        context.find_root().meta[_KEY] = True


debug_option = click.option(
    "--debug", is_flag=True, expose_value=False, callback=_note, help="Show the traceback of a bug."
)
"""Options of the whole program and of the commands that an operator repeats to see more."""


def debug_wanted(context: click.Context | None = None) -> bool:
    """Whether an operator asked for tracebacks, in this command or in the one under way."""
    context = context or click.get_current_context(silent=True)
    return context is not None and bool(context.find_root().meta.get(_KEY))


def describe_bug(what: str, trace: str, context: click.Context | None = None) -> str:
    """Text about a bug for the screen: its traceback where one was asked for, and one line that names it."""
    line = f"hil-bridge: this is a bug: {' '.join(what.split())}"
    if debug_wanted(context):
        return f"{trace.rstrip()}\n{line}"
    return f"{line}; repeat it with --debug for the traceback"
