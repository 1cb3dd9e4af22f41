"""`hil-bridge identify frame`: the work frame of a part, from three touches."""

import sys
from pathlib import Path

import click

from hil_bridge.cli.devices import device_options, device_settings
from hil_bridge.console.debugging import debug_option
from hil_bridge.console.options import echo_lines, output_option, overwrite_option
from hil_bridge.console.paths import FILE


@click.command("frame", short_help="Measure a work frame by three touches.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.option(
    "--place",
    "places",
    type=(float, float),
    multiple=True,
    metavar="X Y",
    help="Point in the present work frame, mm; give three: new origin, a point on the new x axis, any third.",
)
@click.option("--force-n", type=float, default=3.0, show_default=True, help="Force of each touch, N.")
@device_options
@click.option("--tool-mass-kg", type=click.FloatRange(min=0.0), metavar="M", help="Mass below the sensor.")
@click.option("--virtual", is_flag=True, help="Virtual time, with the emulated cell.")
@click.option(
    "--record", type=FILE, metavar="FILE", help="Record the run in FILE.  [default: a new folder under runs/]"
)
@output_option("FRAME.toml", "Write the frame to this file as a table [frame].")
@overwrite_option
@debug_option
def identify_frame(
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
    """Touch three points of a plane under force control, and print the work frame that they define.

    The first point is its origin, the second lies on its x axis, the third anywhere off that axis. Points are relative
    to the present position of the tool, or to frame.origin_mm where that is set. The robot moves between them at its
    present height. A program of the configuration is not run.
    """
    from hil_bridge.errors.text_files import toml_pair
    from hil_bridge.record import read
    from hil_bridge.record.files import check_place, write_atomically
    from hil_bridge.runs.outputs import Outputs, settle_outputs
    from hil_bridge.runs.session import execute
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.site.teach import frame_of, touches

    if len(places) != 3:
        raise click.UsageError("give --place three times: origin, a point on the x axis, a third point")
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
    contacts = {step.name: step.found for step in read(outputs.record).steps if step.found}
    frame = frame_of(contacts, config.frame.approach)
    lines = ["[frame]", *(toml_pair(name, value) for name, value in frame.items())]
    if out is not None:
        write_atomically(out, ("\n".join(lines) + "\n").encode(), overwrite)
        lines.append(f"wrote {out}")
    echo_lines(lines)
