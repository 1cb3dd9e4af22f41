"""The command line `hil-bridge`. Each command imports what it needs when it runs, so that help comes at once."""

import io
import sys

import click

from hil_bridge.cli.decode import decode
from hil_bridge.cli.doctor import doctor
from hil_bridge.cli.emulate import emulate
from hil_bridge.cli.experiment import experiment
from hil_bridge.cli.faults import faults
from hil_bridge.cli.files import config, profile, report
from hil_bridge.cli.free import free
from hil_bridge.cli.identify_tool import identify_tool
from hil_bridge.cli.latency import latency
from hil_bridge.cli.monitor import monitor
from hil_bridge.cli.panel import panel
from hil_bridge.cli.probe import probe
from hil_bridge.cli.replay import replay
from hil_bridge.cli.run import run
from hil_bridge.cli.serve_jr3 import serve_jr3
from hil_bridge.errors import BridgeError

EXIT_INTERRUPTED = 130
"""What a shell expects of a command that Ctrl-C ended."""


@click.group(
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="hil-bridge", prog_name="hil-bridge")
@click.pass_context
def cli(context: click.Context) -> None:
    """Force control of a position-controlled robot, over its real wires or the same wires emulated.

    Exit codes: 0 done, 1 a replay that differs, 2 configuration or input, 3 device, link or safety stop,
    130 interrupted.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


for command in (
    run,
    emulate,
    serve_jr3,
    free,
    identify_tool,
    experiment,
    decode,
    replay,
    latency,
    report,
    config,
    profile,
    probe,
    monitor,
    doctor,
    panel,
    faults,
):
    cli.add_command(command)


def main() -> None:
    """Entry point: errors that a person is meant to read become one line on standard error and an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without "→" must not end a command
    try:
        code = cli.main(prog_name="hil-bridge", standalone_mode=False)
    except BridgeError as error:
        click.echo(f"hil-bridge: {error}", err=True)
        code = error.exit_code
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        see = f"; see `{context.command_path} --help`" if context else ""
        click.echo(f"hil-bridge: {' '.join(error.format_message().split()).rstrip('.')}{see}", err=True)
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        code = EXIT_INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has left (`| head`); nothing more can be said, also not while exiting.
        sys.stderr.close()
        code = 0
    sys.exit(code)
