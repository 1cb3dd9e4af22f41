"""`hil-bridge probe`: identify the device at a URL, and the settings of its link."""

import sys
from functools import partial
from pathlib import Path

import click

from hil_bridge.cli.entry_points import extension
from hil_bridge.console.options import echo_json, echo_lines, json_option, output_option, overwrite_option
from hil_bridge.console.paths import FILE

EXIT_REFUSED = 3
"""Exit code if the robot answers but a run would be refused."""


@click.group(no_args_is_help=False)
def probe() -> None:
    """Identify a robot or a sensor, and show its state."""


@probe.command(short_help="Show what a robot is, and its state.")
@click.argument("url", metavar="URL")
@click.option(
    "--config", "config_file", type=FILE, metavar="FILE", help="Configuration whose [robot.KIND] is used."
)
@output_option("FILE", "Write the start of a configuration: the URL, and for an S3 the settings that work.")
@click.option(
    "--patience",
    "patience_s",
    type=click.FloatRange(min=0.05),
    default=0.7,
    show_default=True,
    metavar="S",
    help="Longest wait for an ACK. [S3]",
)
@json_option
@overwrite_option
def robot(
    url: str,
    config_file: Path | None,
    out: Path | None,
    patience_s: float,
    as_json: bool,
    overwrite: bool,
) -> None:
    """Show what answers at a robot's URL, its rate and its state, and why a run would be refused.

    No order is sent, so nothing moves. An EGM robot gets no answer; its web services are read too if the URL
    has `rws=HOST:PORT`. An RSI robot is sent its present correction, because it stops without an answer. A
    Universal Robot is sent no program. The link settings of an S3 are detected first, by read status alone: rate,
    parity, length style and doubling of DLE. Those in the URL are tried first.

    The exit code is 3 when nothing answers, and when a run would be refused.
    """
    from hil_bridge.devices.kinds import robot_of
    from hil_bridge.record.files import check_place, write_atomically
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.kinds import settings_of
    from hil_bridge.site import robot_probe

    kind, wire = robot_of(url)
    settings = settings_of(load_config(config_file, {}), kind)
    if kind.name == "s3":
        say = partial(click.echo, err=as_json)
        wire, settings = extension("probe-s3", "probe robot")(wire, out, patience_s, overwrite, say)
    elif out is not None:
        check_place(out, overwrite)
    result = robot_probe.probe_robot(kind, wire, settings)
    if out is not None and kind.name != "s3":
        write_atomically(out, robot_probe.site_toml(_with_kind(kind.name, wire), result).encode(), overwrite)
        click.echo(f"wrote {out}\n", err=as_json)
    if as_json:
        echo_json({"kind": kind.name, "url": _with_kind(kind.name, wire), **robot_probe.probe_values(result)})
    else:
        echo_lines(f"{name:<14} {text}" for name, text in robot_probe.probe_rows(result))
    if result.refusals:
        sys.exit(EXIT_REFUSED)


def _with_kind(kind: str, wire: str) -> str:
    """Return the URL in the form that `run --robot` accepts."""
    return wire if wire.startswith(kind) else f"{kind}+{wire}"


@probe.command(short_help="Show a force sensor, and name its axes by pushes.")
@click.argument("url", metavar="URL")
@click.option(
    "--config", "config_file", type=FILE, metavar="FILE", help="Configuration whose [sensor] is compared."
)
@click.option("--no-push", is_flag=True, help="Ask for no pushes by hand.")
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=0.0),
    metavar="S",
    help="Time for which to show the wrench.  [default: until Ctrl-C]",
)
@json_option
def sensor(
    url: str, config_file: Path | None, no_push: bool, duration_s: float | None, as_json: bool
) -> None:
    """Show what a force sensor reports about itself, its noise, and its live wrench.

    On a terminal it asks for a push along +X, +Y and +Z of the tool and names the axis that responds, and its sign. If
    that differs from the configuration, it prints what to set in [sensor]. Nothing is zeroed, nothing moves. URL is
    that of `run --sensor`. With --json it reads for one second, asks for no pushes, and ends.
    """
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.site.sensor_probe import find_sensor, probe_sensor

    if as_json:
        echo_json(find_sensor(url, load_config(config_file, {})))
        return
    probe_sensor(url, load_config(config_file, {}), not no_push, duration_s)
