"""`hil-bridge run`: run the closed loop."""

import sys
from pathlib import Path
from typing import Any

import click

from hil_bridge.cli.completion import complete, controllers
from hil_bridge.cli.devices import (
    device_options,
    device_settings,
    link_profile_option,
    refuse_link_profile,
)
from hil_bridge.cli.setting_options import over, set_option
from hil_bridge.cli.web_options import web_options
from hil_bridge.console.debugging import debug_option
from hil_bridge.console.options import overwrite_option
from hil_bridge.console.paths import FILE

CONTROLLERS = "fuzzy, fuzzy-adaptive, resolution-aware, pi, admittance, predictive"
"""Built-in controllers for the help text. The configuration also accepts the controllers of plug-ins."""
_RECORDING_FOLDER = Path("-")
"""Placeholder for the recording's folder if --report does not name a folder."""


@click.command(short_help="Run force control, with a recording and a report.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@device_options
@link_profile_option
@click.option(
    "--tool-mass-kg",
    type=click.FloatRange(min=0.0),
    metavar="M",
    help="Mass below the sensor; the sensor must read its weight before the robot moves.",
)
@click.option(
    "--unchecked", is_flag=True, help="Run although the tool's load is unknown and cannot check the sensor."
)
@click.option(
    "--unverified",
    multiple=True,
    type=click.Choice(("fx", "fy", "fz")),
    help="Axis to accept although the tool's weight cannot verify it; each touch is then tested.",
)
@click.option(
    "--controller",
    metavar="NAME",
    shell_complete=complete(controllers),
    help=f"Force controller: {CONTROLLERS}, or a plug-in.",
)
@click.option("--force-n", type=float, metavar="F", help="Desired contact force, N.")
@click.option(
    "--task",
    "task_file",
    type=FILE,
    metavar="FILE.toml",
    help="Program of the run: a file with [[step]] tables.",
)
@click.option("--duration", "duration_s", type=float, metavar="S", help="Time to track the surface, s.")
@set_option
@click.option("--virtual", is_flag=True, help="Virtual time: as fast as possible, and exactly repeatable.")
@click.option("--seed", type=int, metavar="N", help="Seed of every random draw in the emulated cell.")
@click.option(
    "--record",
    type=FILE,
    metavar="FILE",
    help="Record the run as MCAP in FILE.  [default: run.mcap and summary.json in a new folder under runs/]",
)
@click.option("--no-record", is_flag=True, help="Do not record the run.")
@click.option("--summary", type=FILE, metavar="FILE", help="Write the figures of the run to FILE as JSON.")
@click.option(
    "--report",
    type=FILE,
    metavar="[DIR]",
    is_flag=False,
    flag_value=str(_RECORDING_FOLDER),
    help="Write report.html to DIR.  [without DIR: to the folder of the recording]",
)
@click.option(
    "--resume",
    type=FILE,
    metavar="RECORDING",
    help="Resume the program of a recorded run that was interrupted: move there, zero, approach, continue.",
)
@overwrite_option
@click.option(
    "--panel", metavar="URL", help="Where the emulated controller's panel listens: tcp-listen://127.0.0.1:0."
)
@click.option("--no-view", is_flag=True, help="No live view.")
@click.option("--web", is_flag=True, help="Show the run on a page in the browser, on this machine alone.")
@click.option(
    "--web-port", type=click.IntRange(0, 65535), metavar="N", help="Port of the page.  [default: a free one]"
)
@click.option(
    "--web-origin",
    "web_origins",
    multiple=True,
    metavar="URL",
    help="Let pages of this origin read the run, such as https://app.foxglove.dev. Repeatable.",
)
@debug_option
def run(
    config_file: Path | None,
    robot: str | None,
    sensor: str | None,
    surface: str | None,
    link_profile: str | None,
    tool_mass_kg: float | None,
    unchecked: bool,
    unverified: tuple[str, ...],
    controller: str | None,
    force_n: float | None,
    task_file: Path | None,
    duration_s: float | None,
    given: dict[str, Any],
    virtual: bool,
    seed: int | None,
    record: Path | None,
    no_record: bool,
    summary: Path | None,
    report: Path | None,
    resume: Path | None,
    overwrite: bool,
    panel: str | None,
    no_view: bool,
    web: bool,
    web_port: int | None,
    web_origins: tuple[str, ...],
) -> None:
    """Approach the surface, hold the force while moving along it, retract.

    Without --robot and --sensor it starts the emulated cell, over a 9600 baud pseudo-terminal and an emulated
    slcan adapter. With --virtual it uses in-memory wires. Ctrl-C retracts and ends with a complete record, and so do a
    closed terminal and the signals of `kill`.

    A configuration with steps (`[[task.step]]`) runs these instead, and prints a line for each. If all are done and
    one did not meet its criterion, the exit code is 4.

    Existing files are overwritten only with --overwrite.
    """
    from hil_bridge.errors import StepError
    from hil_bridge.record import read
    from hil_bridge.runs.outputs import Outputs
    from hil_bridge.runs.resuming import describe_resume, resume_config
    from hil_bridge.runs.session import execute
    from hil_bridge.runs.views import Views
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.devices import robot_in
    from hil_bridge.settings.overrides import lay_over
    from hil_bridge.settings.program import in_file

    if record is not None and no_record:
        raise click.UsageError("--record and --no-record exclude each other", click.get_current_context())
    overrides = over(
        given,
        {
            **device_settings(robot, sensor, surface),
            "robot.s3.link.profile": link_profile,
            "cell.s3.link.profile": link_profile,
            "sensor.unchecked": unchecked or None,
            "sensor.unverified": unverified or None,
            "tool.mass_kg": tool_mass_kg,
            "controller.name": controller,
            "task.force_n": force_n,
            "task.file": None if task_file is None else str(task_file),
            "run.duration_s": duration_s,
            "run.seed": seed,
            "run.panel_url": panel,
        },
    )
    if resume is None:
        config = load_config(config_file, overrides)
    elif config_file is not None or task_file is not None:
        raise click.UsageError(
            "--resume uses the configuration and program of the recording: leave others out"
        )
    else:
        changes: dict[str, object] = {}
        lay_over(changes, overrides)
        config = resume_config(read(resume), changes)
        click.echo(describe_resume(config))
    refuse_link_profile(link_profile, robot_in(config).kind.name)
    views = Views(not no_view, web_options(web, web_port, web_origins))
    with_recording = report == _RECORDING_FOLDER
    outputs = Outputs(
        record,
        summary,
        None if with_recording else report,
        overwrite=overwrite,
        own_folder=record is None and not no_record,
        report_with_record=with_recording,
    )
    try:
        code = execute(config, virtual, outputs, views, config_file or resume)
    except StepError as error:
        raise in_file(error, str(config_file or resume or ""), config.task.file) from error
    sys.exit(code)
