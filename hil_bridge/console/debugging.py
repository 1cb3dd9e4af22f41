"""Reports of bugs on the screen: one line, or the traceback with the option `--debug`."""

import click

_KEY = "hil_bridge.debug"


def _note(context: click.Context, parameter: click.Parameter, given: bool) -> None:
    if given:
        context.find_root().meta[_KEY] = True


debug_option = click.option(
    "--debug", is_flag=True, expose_value=False, callback=_note, help="Show the traceback of a bug."
)
"""Option `--debug` of the main program, and of the commands that are repeated to display more details."""


def is_debug_requested(context: click.Context | None = None) -> bool:
    """Return whether tracebacks were requested, in the given or the present command."""
    context = context or click.get_current_context(silent=True)
    return context is not None and bool(context.find_root().meta.get(_KEY))


def describe_bug(what: str, trace: str, context: click.Context | None = None) -> str:
    """Return the text about a bug for the screen: the traceback if it was requested, and one line that names the
    bug.
    """
    line = f"hil-bridge: this is a bug: {' '.join(what.split())}"
    if is_debug_requested(context):
        return f"{trace.rstrip()}\n{line}"
    return f"{line}; repeat it with --debug for the traceback"
