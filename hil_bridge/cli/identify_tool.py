"""`hil-bridge identify tool`: mass and centre of gravity of the load below the sensor."""

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.devices import device_settings, url_options
from hil_bridge.console.options import output_option, overwrite_option
from hil_bridge.console.paths import FILE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hil_bridge.control import ToolEstimate, ToolPose

LARGE_RESIDUAL = 0.03
"""Residuals above which a warning is given, as a share of the weight. Chosen: a sensor mounted 2° off."""
LEAST_ANGLE_DEG = 15.0
"""Smallest angle of a sweep, °; a smaller angle is refused before the robot moves. Chosen: from 12° on, the poses
of the sweep determine the centre of gravity.
"""


@click.command("tool", short_help="Measure the tool's mass and centre of gravity.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@url_options
@click.option("--virtual", is_flag=True, help="Emulated cell in virtual time.")
@click.option(
    "--angle-deg",
    type=click.FloatRange(LEAST_ANGLE_DEG, 90.0),
    metavar="A",
    help="Angle to turn the tool to either side.  [default: 30, or as far as the robot can]",
)
@click.option(
    "--lift-mm",
    type=click.FloatRange(0.0, 2000.0),
    default=50.0,
    show_default=True,
    metavar="D",
    help="Distance to pull back from the surface before turning.",
)
@click.option(
    "--settle-s",
    type=click.FloatRange(0.0, 60.0),
    default=1.0,
    show_default=True,
    metavar="S",
    help="Wait at each pose.",
)
@click.option(
    "--average-s",
    type=click.FloatRange(0.05, 600.0),
    default=1.0,
    show_default=True,
    metavar="S",
    help="Averaging time at each pose.",
)
@click.option(
    "--from",
    "table",
    type=FILE,
    metavar="POSES.csv",
    help="Compute from this table; no device is opened, nothing moves.",
)
@click.option("--save", type=FILE, metavar="POSES.csv", help="Write the poses and readings to this file.")
@output_option("FILE.toml", "Write [tool] and the sensor's bias to this file.")
@overwrite_option
def identify_tool(
    config_file: Path | None,
    robot: str | None,
    sensor: str | None,
    virtual: bool,
    angle_deg: float | None,
    lift_mm: float,
    settle_s: float,
    average_s: float,
    table: Path | None,
    save: Path | None,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Identify the mass and centre of gravity of the tool, and the sensor's bias.

    The robot pulls back from the surface, turns the tool slowly about its tip to either side about two level axes, and
    returns. Keep the space around the turning tool clear. The sensor is not zeroed. Copy what -o writes into the
    configuration.

    A table for --from has a line of column names: qw qx qy qz (tool in base) and fx_n fy_n fz_n mx_nm my_nm mz_nm (mean
    readings in the sensor frame, N and N·m). It may also have their standard deviations sd_fx_n … sd_mz_nm.
    """
    from hil_bridge.control import identify_tool as tool_estimate
    from hil_bridge.errors import ConfigError
    from hil_bridge.record.files import check_place, write_atomically
    from hil_bridge.runs.zeroing import wrist
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.site.tool.files import poses_as_csv, read_poses, tool_as_toml

    for option, file in (("-o", out), ("--save", save)):
        if file is None:
            continue
        for other, source in (("the configuration", config_file), ("the table", table)):
            if source is not None and file.resolve() == source.resolve():
                raise ConfigError(f"{option} {file} would overwrite {other}; name another file")
        if not file.resolve().parent.is_dir():
            raise ConfigError(f"{option} {file}: no such folder; create it or name another")
        check_place(file, overwrite)
    config = load_config(config_file, device_settings(robot, sensor, None))
    if table is not None:
        poses = read_poses(table)
    else:
        from hil_bridge.console.screen import Screen
        from hil_bridge.runs.checks import Start, check_wires
        from hil_bridge.runs.setup import Setup
        from hil_bridge.runs.signals import as_ctrl_c
        from hil_bridge.settings.faults import refuse_faults
        from hil_bridge.site.tool.measuring import DEFAULT_DEG, Sweep, choose_angle, measure

        refuse_faults(config.faults, "hil-bridge identify tool")
        setup = Setup(config)
        check_wires(setup, Start(virtual))
        chosen = choose_angle(setup, angle_deg, lift_mm)
        sweep = Sweep(chosen, lift_mm, settle_s, average_s)
        with as_ctrl_c(), Screen(sys.stderr) as screen:
            if angle_deg is None and chosen < DEFAULT_DEG:
                screen.say(f"the tool is turned by {chosen:g}° to either side, as far as the robot can")
            poses = measure(config, virtual, sweep, screen.say)
    if save is not None:
        write_atomically(save, poses_as_csv(poses).encode(), overwrite)
        click.echo(f"poses: {save}")
    estimate = tool_estimate(poses, wrist(config))
    _print(poses, estimate)
    if out is not None:
        write_atomically(out, tool_as_toml(estimate).encode(), overwrite)
        click.echo(f"tool: {out}")


def _print(poses: "Sequence[ToolPose]", estimate: "ToolEstimate") -> None:
    from hil_bridge.control.geometry.frames import STANDARD_GRAVITY

    def numbers(values: "Sequence[float]", digits: int, unit: float = 1.0) -> str:
        return " ".join(f"{value * unit + 0.0:9.{digits}f}" for value in values)

    forces, moments = slice(0, 3), slice(3, 6)
    rows = [
        ("mass, kg", f"{estimate.mass:9.4f}", f"{estimate.mass_uncertainty:9.4f}"),
        (
            "centre of gravity, mm",
            numbers(estimate.centre_of_gravity, 2, 1e3),
            numbers(estimate.centre_of_gravity_uncertainty, 2, 1e3),
        ),
        (
            "bias of forces, N",
            numbers(estimate.bias[forces], 3),
            numbers(estimate.bias_uncertainty[forces], 3),
        ),
        (
            "bias of moments, N·m",
            numbers(estimate.bias[moments], 4),
            numbers(estimate.bias_uncertainty[moments], 4),
        ),
    ]
    for name, value, uncertainty in rows:
        click.echo(f"  {name:<23}{value:<30} ± {uncertainty}")
    click.echo(f"  {len(poses)} poses, up to {math.degrees(estimate.turned):.0f}° apart; residuals:")
    click.echo(f"  {'pose':>6}   {'fx fy fz, N':^29}   {'mx my mz, N·m':^29}")
    for number, rest in enumerate(estimate.residuals, 1):
        click.echo(f"  {number:>6}   {numbers(rest[forces], 3)}   {numbers(rest[moments], 5)}")
    click.echo(
        f"  {'rms':>6}   {estimate.force_residual:9.3f} N {'':>20} {estimate.moment_residual:9.5f} N·m".rstrip()
    )
    if estimate.force_residual > LARGE_RESIDUAL * estimate.mass * STANDARD_GRAVITY:
        click.echo(
            "the residuals are large: did the tool touch something, or is sensor.mounting_deg, sensor.quaternion "
            "or sensor.flip_fx_mx wrong?",
            err=True,
        )
