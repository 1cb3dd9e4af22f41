"""Command line `hil-bridge`.

The commands come from entry points. Each command is imported when it is used, and imports its own dependencies when
it runs, so that help appears at once.
"""

import io
import signal
import sys
from collections.abc import Mapping
from typing import Any

import click

from hil_bridge.cli.entry_points import COMMANDS, EntryPointGroup
from hil_bridge.console.debugging import debug_option, describe_bug, is_debug_requested
from hil_bridge.console.screen import leave
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.errors.text_files import harmless

EXIT_INTERRUPTED = 130
"""Exit code that a shell expects of a command that was ended by Ctrl-C."""
EXIT_BUG = 70
"""Exit code of a bug, distinct from the exit codes of the commands. Source: EX_SOFTWARE of sysexits(3)."""

HELP_SECTIONS: Mapping[str, tuple[str, ...]] = {
    "Run": ("run", "free"),
    "Recordings": ("view", "report", "why", "latency", "compare", "replay", "export"),
    "On site": ("doctor", "probe", "identify", "monitor", "decode"),
    "Emulation": ("emulate", "panel", "conform"),
    "Many runs": ("campaign", "tune"),
    "Settings and lists": ("config", "list"),
}
"""Names of the built-in commands by purpose, in the order of the help."""
PLUGINS = "Plug-ins"
"""Title of the section with the commands of plug-ins in the help."""
FIRST_COMMANDS = """\
Closed-loop force control for position-controlled robots, over the real link or
an emulated one.

First commands:
  hil-bridge run --virtual     Run with emulated devices, in virtual time.
  hil-bridge view RECORDING    Show the recording of a run in the browser.
  hil-bridge report RECORDING  Make a page with charts from a recording.
  hil-bridge config init       Write a configuration file with every setting.
  hil-bridge doctor            Check this computer for runs with real devices.

All commands: hil-bridge --help
"""
"""Output of `hil-bridge` without a command: the first commands for a new user."""
MOVED: Mapping[str, tuple[str, ...]] = {
    "controllers": ("list controllers",),
    "faults": ("list faults",),
    "fidelity": ("identify fidelity",),
    "force-source": ("emulate force-source",),
    "identify-cell": ("identify cell",),
    "identify-tool": ("identify tool",),
    "layouts": ("export RECORDING --to layouts",),
    "plugins": ("list plugins",),
    "profile": ("list facts",),
    "runs": ("list runs",),
    "serve-jr3": ("emulate jr3-pci",),
    "supervisor": ("config explain", "list conditions"),
    "task": ("config program", "identify frame"),
    "verify": ("campaign verify",),
}
"""Present commands by their names before version 0.7."""
PACKAGED: Mapping[str, str] = {"experiment": "./examples/paper-experiments"}
"""Commands that packages of the checkout provide, with the path of the package."""


class OutputClosed(Exception):
    """Signal that the reader of the output's pipe has closed it. It is not an OSError, because click converts that
    to exit code 1.
    """


class Bug(Exception):
    """Unexpected exception. Its text is displayed on the terminal."""


class _Commands(EntryPointGroup):
    """Commands of hil-bridge, with a translation of every exception that ends a command."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command with this name, or None.

        Raises ConfigError if a built-in command is not installed, if the command cannot be loaded, or if the name
        is an earlier name of a command.
        """
        command = super().get_command(ctx, cmd_name)
        if command is None and cmd_name in MOVED:
            raise ConfigError(f"the command {cmd_name!r} is now {' or '.join(map(repr, MOVED[cmd_name]))}")
        if command is None and cmd_name in PACKAGED:
            raise ConfigError(
                f"the command {cmd_name!r} is in a package of its own",
                remedy=f"install it from a checkout: pip install {PACKAGED[cmd_name]}",
            )
        if command is None and any(cmd_name in names for names in HELP_SECTIONS.values()):
            from hil_bridge.errors.extras import install_command

            raise ConfigError(
                f"the command {cmd_name!r} is not installed",
                remedy=f"install hil-bridge again: {install_command()}",
            )
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands by purpose. The commands of plug-ins come last."""
        installed = self.list_commands(ctx)
        known = {name for names in HELP_SECTIONS.values() for name in names}
        sections = {**HELP_SECTIONS, PLUGINS: tuple(name for name in installed if name not in known)}
        width = max(map(len, installed), default=0)
        for title, names in sections.items():
            rows = self.short_helps(ctx, [name for name in names if name in installed], formatter.width)
            if rows:
                with formatter.section(title):
                    formatter.write_dl([(f"{name:{width}}", text) for name, text in rows])

    def make_context(self, *arguments: Any, **options: Any) -> click.Context:
        """Parse the command line, which may print help. Raises OutputClosed if the output was closed."""
        try:
            return super().make_context(*arguments, **options)
        except BrokenPipeError as error:
            raise OutputClosed from error

    def invoke(self, context: click.Context) -> Any:
        """Run a command. Raises OutputClosed, Bug, and the exceptions of click and of the commands that are
        messages for the user.
        """
        try:
            return super().invoke(context)
        except BridgeError as error:
            from hil_bridge.errors.failures import involves_plugin, traceback_of

            cause = error.__cause__
            if is_debug_requested(context) and cause is not None and involves_plugin(cause):
                click.echo(traceback_of(cause), err=True)
            raise
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except BrokenPipeError as error:
            raise OutputClosed from error
        except BaseException as error:
            from hil_bridge.errors.cancelling import is_interrupt
            from hil_bridge.errors.failures import failure, involves_plugin, traceback_of

            if is_interrupt(error) or getattr(error, "code", None) == 128 + signal.SIGTERM:
                raise  # the user ended it, possibly within a plug-in's command
            if involves_plugin(error):
                if is_debug_requested(context):
                    click.echo(traceback_of(error), err=True)
                raise ConfigError(f"plug-in code failed: {failure(error)}") from error
            if isinstance(error, SystemExit):
                raise
            what = "; ".join([f"{type(error).__name__}: {error}", *getattr(error, "__notes__", ())])
            raise Bug(describe_bug(what, traceback_of(error), context)) from error


@click.group(
    cls=_Commands,
    entry_points=COMMANDS,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="hil-bridge", prog_name="hil-bridge")
@debug_option
@click.pass_context
def cli(context: click.Context) -> None:
    """Closed-loop force control for position-controlled robots, over the real link or an emulated one.

    Exit codes: 0 success, 1 a comparison differs, 2 invalid configuration or input, 3 stopped by a device, the link or
    the guard, 4 a criterion is not met, 70 a bug, 130 interrupted. Criteria are those of a step (run) or of a run
    (campaign), promises (campaign hunt), scenarios (conform) and constraints (tune).
    """
    if context.invoked_subcommand is None:
        click.echo(FIRST_COMMANDS, nl=False)


def main() -> None:
    """Run hil-bridge: print an error that the user can handle as one line on standard error, and exit with its code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without "→" must not end a command
    code: int | str | None
    try:
        code = _run()
    except SystemExit as ended:
        code = ended.code
    except (click.Abort, KeyboardInterrupt):
        code = EXIT_INTERRUPTED
    except OSError:  # standard error is closed too, so the cause cannot be printed
        code = EXIT_BUG
    leave(code)


def _run() -> int | str | None:
    """Run the command, print one line for the error that ended it, and return the exit code."""
    try:
        code: int | str | None = cli.main(prog_name="hil-bridge", standalone_mode=False)
        return code
    except OutputClosed:  # as by `| head`: nothing more can be printed
        return 0
    except BridgeError as error:
        click.echo(f"hil-bridge: {harmless(str(error))}", err=True)
        return error.exit_code
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        see = f"; see `{context.command_path} --help`" if context else ""
        click.echo(f"hil-bridge: {' '.join(error.format_message().split()).rstrip('.')}{see}", err=True)
        return error.exit_code
    except Bug as bug:
        click.echo(bug, err=True)
        return EXIT_BUG
