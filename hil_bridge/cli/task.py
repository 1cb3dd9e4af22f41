"""`hil-bridge task`: commands around the program of a run."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.devices import device_options, device_settings
from hil_bridge.console.debugging import debug_option
from hil_bridge.console.options import output_option, overwrite_option, tell
from hil_bridge.console.paths import FILE

if TYPE_CHECKING:
    from hil_bridge.control.program.leg import Row
    from hil_bridge.settings.configuration import Config


@click.group(no_args_is_help=False)
def task() -> None:
    """Check and show the program of a run."""


@task.command(short_help="Check a program, and print and draw its steps.")
@click.argument("file", metavar="FILE", type=FILE)
@output_option("PICTURE.png", "Draw paths and forces into this file.")
@overwrite_option
def show(file: Path, out: Path | None, overwrite: bool) -> None:
    """Check the program of a configuration as a whole, and print its steps; with -o draw them.

    FILE is a configuration, or a file with the steps of a program alone. Times are about: corners are taken slower,
    and an approach ends where the surface is.
    """
    from hil_bridge.record.files import check_place, write_whole
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

        write_whole(out, draw_task(steps, f"{file.stem}: {total}"), overwrite)
        lines.append(f"wrote {out}")
    tell(lines)


def _config(file: Path) -> "Config":
    """The configuration of a file, which may hold the steps alone. Raises ConfigError."""
    from hil_bridge.errors.text_files import read_toml
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.program import is_program

    if is_program(read_toml(file)):
        return load_config(None, {"task.file": str(file)})
    return load_config(file, {})


def _row(config: "Config", file: Path) -> "Row":
    """The program's steps in one row. Raises ConfigError with the number of the first step that cannot be."""
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


@task.command("teach-frame", short_help="Touch three places and tell the work frame that they make.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.option(
    "--place",
    "places",
    type=(float, float),
    multiple=True,
    metavar="X Y",
    help="A place in the work frame that is set now, mm; give three: new origin, a place on the new x axis, any third.",
)
@click.option("--force-n", type=float, default=3.0, show_default=True, help="Force of each touch, N.")
@device_options
@click.option("--tool-mass-kg", type=click.FloatRange(min=0.0), metavar="M", help="Mass below the sensor.")
@click.option("--virtual", is_flag=True, help="Virtual time, with the emulated cell.")
@click.option(
    "--record", type=FILE, metavar="FILE", help="Record the run there.  [default: a new folder under runs/]"
)
@output_option("FRAME.toml", "Write the frame as a table [frame] there.")
@overwrite_option
@debug_option
def teach_frame(
    config_file: Path | None,
    places: tuple[tuple[float, float], ...],
    force_n: float,
    robot: str | None,
    sensor: str | None,
    surface: str | None,
    tool_mass_kg: float | None,
    virtual: bool,
    record: Path | None,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Touch three places of a plane under force control, and tell the work frame that they make.

    The first place is its origin, the second lies on its x axis, the third anywhere beside. Places count from where the
    tool stands, or from frame.origin_mm where that is set. The robot goes over at the height where it stands. A program
    of the configuration is not carried out.
    """
    from hil_bridge.errors.text_files import toml_pair
    from hil_bridge.record import read
    from hil_bridge.record.files import check_place, write_whole
    from hil_bridge.runs.outputs import Outputs, settle_outputs
    from hil_bridge.runs.session import execute
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.site.teach import frame_of, touches

    if len(places) != 3:
        raise click.UsageError("give --place three times: origin, a place on the x axis, a third one")
    if out is not None:
        check_place(out, overwrite)
    overrides = {
        **device_settings(robot, sensor, surface),
        "tool.mass_kg": tool_mass_kg,
        "task.file": "",
        "task.step": touches(places, force_n),
    }
    config = load_config(config_file, overrides)
    outputs = settle_outputs(Outputs(record, overwrite=overwrite, own_folder=record is None), config_file)
    assert outputs.record is not None
    if code := execute(config, virtual, outputs, False, config_file):
        sys.exit(code)
    found = {step.name: step.found for step in read(outputs.record).steps if step.found}
    frame = frame_of(found, config.frame.approach)
    lines = ["[frame]", *(toml_pair(name, value) for name, value in frame.items())]
    if out is not None:
        write_whole(out, ("\n".join(lines) + "\n").encode(), overwrite)
        lines.append(f"wrote {out}")
    tell(lines)
