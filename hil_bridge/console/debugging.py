"""Reports of bugs on the screen: one line, or with the option `--debug` the traceback."""

import click

_KEY = "hil_bridge.debug"


def _note(context: click.Context, parameter: click.Parameter, given: bool) -> None:
    if given:
        context.find_root().meta[_KEY] = True


debug_option = click.option(
    "--debug", is_flag=True, expose_value=False, callback=_note, help="Show the traceback of a bug."
)
"""Option of the main program and of the commands that are repeated to see more."""


def debug_wanted(context: click.Context | None = None) -> bool:
    """Return whether tracebacks were requested, in this command or in the present one."""
    context = context or click.get_current_context(silent=True)
    return context is not None and bool(context.find_root().meta.get(_KEY))


def describe_bug(what: str, trace: str, context: click.Context | None = None) -> str:
    """Return the text about a bug for the screen: its traceback if requested, and one line that names it."""
    line = f"hil-bridge: this is a bug: {' '.join(what.split())}"
    if debug_wanted(context):
        return f"{trace.rstrip()}\n{line}"
    return f"{line}; repeat it with --debug for the traceback"
