"""Commands around files: `report`, `config`, `profile`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.bag_options import bag_options
from hil_bridge.console.options import ExtrasCommand, output_option, overwrite_option
from hil_bridge.console.paths import FILE

if TYPE_CHECKING:
    from hil_bridge.record.foreign import BagChoices


@click.command(
    cls=ExtrasCommand,
    extras={"pictures": "figures", "bags of ROS 2": "ros"},
    short_help="Make a page with charts from a recording.",
)
@click.argument("recording", type=FILE)
@output_option("DIR", "Where to put it.  [default: beside the recording]")
@click.option("--png", is_flag=True, help="A picture beside it, report.png.")
@click.option("--pdf", is_flag=True, help="The same as report.pdf.")
@overwrite_option
@bag_options
def report(
    recording: Path, out: Path | None, png: bool, pdf: bool, overwrite: bool, bag: "BagChoices"
) -> None:
    """Make report.html from a recording: one file with charts that zoom, which needs no network.

    RECORDING may be a bag of ROS 2 with a WrenchStamped and a PoseStamped: its folder, or an MCAP file. That needs the
    extra ros, and the pictures need matplotlib.
    """
    from hil_bridge.record.analysis.summary import summarise
    from hil_bridge.record.ros.bag_reader import read_any
    from hil_bridge.show.report import write_report

    record = read_any(recording, bag)
    pictures = [kind for kind, wanted in (("png", png), ("pdf", pdf)) if wanted]
    page = write_report(record, summarise(record), out or recording.parent, overwrite, pictures)
    click.echo(page)


@click.group(no_args_is_help=False)
def config() -> None:
    """Make or describe a configuration file."""


@config.command()
@click.argument("path", type=FILE, default=Path("hil-bridge.toml"))
@overwrite_option
def init(path: Path, overwrite: bool) -> None:
    """Write a commented file with every setting at its default.  [default: hil-bridge.toml]"""
    from hil_bridge.record.files import write_whole
    from hil_bridge.settings.template import commented_defaults

    write_whole(path, commented_defaults().encode(), overwrite)
    click.echo(f"wrote {path}")


@config.command()
def schema() -> None:
    """Print the JSON schema of a configuration file."""
    from hil_bridge.settings.template import schema as json_schema

    click.echo(json.dumps(json_schema(), indent=1, ensure_ascii=False))


@click.group(no_args_is_help=False)
def profile() -> None:
    """List known and assumed facts about the devices."""


@profile.command(short_help="Print every assumed value in use, and its mark.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.option("--all", "everything", is_flag=True, help="Also what is observed, derived, standard or chosen.")
def show(config_file: Path | None, everything: bool) -> None:
    """Print every assumed value in use with its mark; correct them in the configuration. The last line tells how many
    settings have each mark.
    """
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.template import profile_rows
    from protocol.marks import Mark

    counts = dict.fromkeys(Mark, 0)
    for key, item in profile_rows(load_config(config_file, {})):
        counts[item.info.mark] += 1
        if everything or item.info.mark is Mark.ASSUMED:
            unit = f" {item.info.unit}" if item.info.unit else ""
            changed = "" if item.value == item.default else f" (default {item.default})"
            click.echo(f"{key} = {item.value}{unit}{changed}  [{item.info.mark}]  {item.info.meaning}")
    click.echo(f"settings by mark: {', '.join(f'{count} {mark}' for mark, count in counts.items())}")
