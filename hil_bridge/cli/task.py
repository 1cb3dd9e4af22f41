"""`hil-bridge task`: commands around the program of a run."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.options import overwrite_option, tell
from hil_bridge.cli.paths import FILE

if TYPE_CHECKING:
    from hil_bridge.control.program.legs import Row
    from hil_bridge.settings.configuration import Config


@click.group(no_args_is_help=False)
def task() -> None:
    """Check and show the program of a run."""


@task.command(short_help="Check a program, and print and draw its steps.")
@click.argument("file", metavar="FILE", type=FILE)
@click.option("--out", type=FILE, metavar="PICTURE.png", help="Draw paths and forces into this file.")
@overwrite_option
def show(file: Path, out: Path | None, overwrite: bool) -> None:
    """Check the program of a configuration as a whole, and print its steps; with --out draw them.

    FILE is a configuration, or a file with the steps of a program alone. Times are about: corners are taken slower,
    and an approach ends where the surface is.
    """
    from hil_bridge.recording.files import check_place, write_whole
    from hil_bridge.report.task_steps import shown, table_lines, total_line

    if out is not None:
        check_place(out, overwrite)
    config = _config(file)
    row = _row(config, file)
    steps = shown(config.task.step, row)
    total = total_line(steps, row)
    lines = [*table_lines(steps), f"total: {total}"]
    if out is not None:
        from hil_bridge.report.task_plot import draw_task

        write_whole(out, draw_task(steps, f"{file.stem}: {total}"), overwrite)
        lines.append(f"wrote {out}")
    tell(lines)


def _config(file: Path) -> "Config":
    """The configuration of a file, which may hold the steps alone. Raises ConfigError."""
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.program import is_program
    from hil_bridge.text_files import read_toml

    if is_program(read_toml(file)):
        return load_config(None, {"task.file": str(file)})
    return load_config(file, {})


def _row(config: "Config", file: Path) -> "Row":
    """The program's steps in one row. Raises ConfigError with the number of the first step that cannot be."""
    from dataclasses import replace

    from hil_bridge.control.program.program import Program
    from hil_bridge.errors import ConfigError
    from hil_bridge.runs.checks import check_program
    from hil_bridge.runs.pace import control_loop, paced
    from hil_bridge.settings.program import in_file

    if not config.task.step:
        raise ConfigError(f"{file} holds no program: give its steps as tables [[task.step]]")
    config = config.model_copy(update={"task": replace(config.task, resume=None)})
    try:
        program = control_loop(paced(config)).task
        check_program(config)
    except ConfigError as error:
        raise in_file(error, str(file), config.task.file) from error
    assert isinstance(program, Program)
    return program.row
