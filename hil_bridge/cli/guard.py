"""`hil-bridge config explain` and `hil-bridge list conditions`: reactions of the guard, and their conditions."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from hil_bridge.console.options import echo_lines
from hil_bridge.console.paths import FILE

_Command = TypeVar("_Command", bound=Callable[..., Any])


@click.command(short_help="List the conditions that refuse, clamp or end a run.")
def conditions() -> None:
    """List every condition that refuses, clamps or ends a run, with its consequence."""
    from hil_bridge.site.guard.conditions import as_text

    echo_lines(as_text())


def _number(name: str, key: str, text: str) -> Callable[[_Command], _Command]:
    return click.option(name, key, type=float, metavar="X", help=text)


def _count(name: str, key: str, text: str) -> Callable[[_Command], _Command]:
    return click.option(name, key, type=click.IntRange(0, 10**9), metavar="N", help=text)


def _words(name: str, key: str, text: str) -> Callable[[_Command], _Command]:
    return click.option(name, key, metavar="TEXT", help=text)


@click.command(short_help="Explain what the guard does with an observation.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.option(
    "--phase",
    type=click.Choice(["approach", "track", "retract"]),
    default="track",
    show_default=True,
    help="Phase of the run.",
)
@_number("--force", "force_n", "Force along the approach, N.  [default: task.force_n in TRACK, else 0]")
@_number("--peak", "peak_n", "The same, farthest from 0 since the last decision, N.  [default: the force]")
@_number("--resultant", "resultant_n", "Length of the force vector, N.  [default: that of the force]")
@_number("--moment", "moment_nm", "Length of the moment vector, N·m.")
@_number("--age-ms", "age_ms", "Age of the newest frame.")
@_number("--unchanged-ms", "unchanged_ms", "Time for which frames have carried identical counts.")
@_number("--unchanged-mm", "unchanged_mm", "Distance moved through free space since the counts last changed.")
@_number("--pulled-ms", "pulled_ms", "Duration of a pull in free space.  [default: long]")
@_number("--still-ms", "still_ms", "Duration of the cycles without a new frame.")
@_count("--counter-back", "counter_back", "By how much the frame counter went back.")
@_number("--depth-mm", "depth_mm", "Reported depth below the start.  [default: the commanded one]")
@_number("--commanded-mm", "commanded_mm", "Depth of the last order.  [default: the reported one]")
@_number("--wanted-mm", "wanted_mm", "Next requested depth.  [default: a step of the phase]")
@_number("--across-mm", "across_mm", "Next requested distance across the approach.")
@_number("--unanswered-mm", "unanswered_mm", "Increase in depth since the force last changed.")
@_number("--moved-mm", "moved_mm", "Distance that the reported position moved since the last cycle.")
@_number("--cycle-ms", "cycle_ms", "Time since the last cycle.  [default: the least line time]")
@_number("--against", "against_n", "Force against the travel, N.")
@_number("--witness", "witness_n", "Force along the approach as measured by the robot itself, N.")
@_number(
    "--disagreed-ms", "disagreed_ms", "Time for which it has disagreed with the sensor.  [default: long]"
)
@_number("--tilt-deg", "tilt_deg", "Angle between the reported orientation and that of the start.")
@_number("--gap-ms", "gap_ms", "Time for which the computer stalled.")
@click.option("--saturated", is_flag=True, default=None, help="An axis is at the end of its range.")
@_words("--fault", "fault", "Fault of a device.")
@_words("--dead-axis", "dead_axis", "Axis of the sensor that does not respond.")
@_words("--controller-failure", "controller_failure", "Failure of the controller.")
@_number("--swing", "swing_n", "Amplitude of an oscillation that continues at the least gain, N.")
@_number("--stiffness", "stiffness_n_m", "Estimated contact stiffness, N/m.")
@click.option(
    "--start-m",
    type=float,
    nargs=3,
    metavar="X Y Z",
    help="Start, base frame.  [default: middle of the workspace]",
)
@_number("--lowest", "lowest_n", "RETRACT: least resultant force so far, N.  [default: the present one]")
@_number("--retracting-ms", "retracting_ms", "RETRACT: time since its start.")
@click.option(
    "--from-contact/--from-air", default=None, help="RETRACT: whether it began in contact.  [default: it did]"
)
@_number("--back-mm", "back_mm", "RETRACT: distance back since the force last fell.")
def explain(config_file: Path | None, phase: str, **given: Any) -> None:
    """Explain what the guard does with an observation, by the limits of a configuration.

    The control loop of a run decides. What is not given is as in an undisturbed run. Prints the verdict, its cause, the
    setting that decided, the tool's next reaction and the deepest order. For each quantity it prints the distance to
    the value at which that quantity alone would stop the run, nearest first.

    \b
      hil-bridge config explain --force 120 --age-ms 30
      hil-bridge config explain --force 40 --commanded-mm 8 --wanted-mm 12 --stiffness 20000
      hil-bridge config explain --phase retract --force 30 --lowest 12 --retracting-ms 1500
    """
    from hil_bridge.control import Phase
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.site.guard.asking import Situation
    from hil_bridge.site.guard.explaining import explain as explain_decision

    known = {name: value for name, value in given.items() if value is not None}
    echo_lines(explain_decision(load_config(config_file, {}), Situation(Phase(phase), **known)).lines())
