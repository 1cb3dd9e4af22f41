"""`hil-bridge config init`, `schema` and `program`, and `hil-bridge list facts`: configuration files."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.console.options import echo_lines, output_option, overwrite_option
from hil_bridge.console.paths import FILE

if TYPE_CHECKING:
    from hil_bridge.control.program.leg import Row
    from hil_bridge.settings.configuration import Config


@click.command(short_help="Write a file with every setting at its default.")
@click.argument("path", type=FILE, default=Path("hil-bridge.toml"))
@overwrite_option
def init(path: Path, overwrite: bool) -> None:
    """Write a commented configuration file with every setting at its default.  [default: hil-bridge.toml]"""
    from hil_bridge.record.files import write_atomically
    from hil_bridge.settings.template import commented_defaults

    write_atomically(path, commented_defaults().encode(), overwrite)
    click.echo(f"wrote {path}")


@click.command()
def schema() -> None:
    """Print the JSON schema of a configuration file."""
    from hil_bridge.settings.template import schema as json_schema

    click.echo(json.dumps(json_schema(), indent=1, ensure_ascii=False))


@click.command(short_help="List the assumed values of a configuration.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.option(
    "--all", "everything", is_flag=True, help="Also list observed, derived, standard and chosen values."
)
def facts(config_file: Path | None, everything: bool) -> None:
    """List the values about devices that a configuration assumes, each with its mark and meaning.

    Correct them in the configuration. The last line counts the settings with each mark.
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


@click.command(short_help="Check a program, and print and draw its steps.")
@click.argument("file", metavar="FILE", type=FILE)
@output_option("PICTURE.png", "Draw paths and forces into this file.")
@overwrite_option
def program(file: Path, out: Path | None, overwrite: bool) -> None:
    """Check the complete program of a configuration and print its steps; with -o, draw them.

    FILE is a configuration, or a file that holds only the steps of a program. Times are approximate: the robot slows
    down in corners, and an approach ends at the surface.
    """
    from hil_bridge.record.files import check_place, write_atomically
    from hil_bridge.show.report.task_steps import list_steps, table_lines, total_line

    if out is not None:
        check_place(out, overwrite)
    config = _config(file)
    row = _row(config, file)
    steps = list_steps(config.task.program(config.run.duration_s), row)
    total = total_line(steps, row)
    lines = [*table_lines(steps), f"total: {total}"]
    if out is not None:
        from hil_bridge.show.report.task_plot import draw_task

        write_atomically(out, draw_task(steps, f"{file.stem}: {total}"), overwrite)
        lines.append(f"wrote {out}")
    echo_lines(lines)


def _config(file: Path) -> "Config":
    """Load the configuration from a file, which may contain only the steps of a program. Raises ConfigError if the
    file is invalid.
    """
    from hil_bridge.errors.text_files import read_toml
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.program import is_program

    if is_program(read_toml(file)):
        return load_config(None, {"task.file": str(file)})
    return load_config(file, {})


def _row(config: "Config", file: Path) -> "Row":
    """Return the program's steps as one row. Raises ConfigError with the number of the first step that is
    impossible.
    """
    from dataclasses import replace

    from hil_bridge.errors import StepError
    from hil_bridge.runs.checks import check_program
    from hil_bridge.runs.setup import Setup
    from hil_bridge.settings.program import in_file

    config = config.model_copy(update={"task": replace(config.task, resume=None)})
    try:
        setup = Setup(config)
        row = setup.loop.program.row
        check_program(setup)
    except StepError as error:
        raise in_file(error, str(file), config.task.file) from error
    return row
