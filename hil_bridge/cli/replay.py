"""`hil-bridge replay`: repeat the decisions for the inputs of a recorded run."""

import math
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.completion import complete, controllers
from hil_bridge.console.options import echo_lines, overwrite_option
from hil_bridge.console.paths import FILE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hil_bridge.runs.replay import ReplayedCycle

EXIT_DIFFERENT = 1
"""Exit code if the replay of an unchanged run makes a different decision."""


@click.command(short_help="Replay the decisions of a recorded run, and compare.")
@click.argument("recording", type=FILE)
@click.argument("config_file", metavar="[CHANGES.toml]", required=False, type=FILE)
@click.option(
    "--controller",
    metavar="NAME",
    shell_complete=complete(controllers),
    help="Replay with another controller.",
)
@click.option(
    "--csv", "table", type=FILE, metavar="FILE", help="Write recorded and replayed commands of every cycle."
)
@overwrite_option
def replay(
    recording: Path, config_file: Path | None, controller: str | None, table: Path | None, overwrite: bool
) -> None:
    """Feed the inputs of a recording to controller and supervisor, and compare every command.

    Without changes, every command must be the same: otherwise it prints the first difference and the exit code is 1.
    With --controller or a file of changes it prints what would have been commanded in every situation of the run. The
    file has tables such as [limits] or [controller], which override the recorded configuration.
    """
    from hil_bridge.record import read
    from hil_bridge.record.files import check_place
    from hil_bridge.record.reader import NO_CYCLE
    from hil_bridge.runs.replay import changes_of, recorded_config
    from hil_bridge.runs.replay import replay as replayed

    if table is not None:
        check_place(table, overwrite)
    record = read(recording)
    changes = changes_of(config_file, controller)
    config = recorded_config(record, changes)
    cycles = list(replayed(record, config, forced=bool(changes)))
    if table is not None:
        _write_table(table, cycles, overwrite)
    if not cycles:
        echo_lines([f"no cycle to replay: {NO_CYCLE}"])
        return
    if changes:
        echo_lines(_changes(cycles, config.controller.name))
        return
    for cycle in cycles:
        if cycle.differences:
            echo_lines(_differences(cycle, len(cycles)))
            echo_lines(_versions(record.metadata.get("version", "")))
            sys.exit(EXIT_DIFFERENT)
    note = "; the recording is cut short or damaged after them" if record.truncated else ""
    echo_lines([f"{len(cycles)} cycles replayed, every command identical{note}"])


def _differences(cycle: "ReplayedCycle", count: int) -> "Iterator[str]":
    yield f"cycle {cycle.record.cycle} of {count} differs:"
    for name, (before, now) in cycle.differences.items():
        yield f"  {name}: recorded {before}, replayed {now}"


def _versions(recorded: str) -> "Iterator[str]":
    """Yield a line that names the version of the recording if it is not the present version, whose guard may decide
    differently.
    """
    here = version("hil-bridge")
    if recorded != here:
        yield f"recorded by version {recorded or 'unknown'}; this is {here}, whose guard may decide differently"


def _changes(cycles: "list[ReplayedCycle]", controller: str) -> "Iterator[str]":
    """Describe how the commands of the replay differ from the recorded commands, by phase."""
    yield f"commands of {controller} with these limits in the recorded situations:"
    yield f"{'phase':<10}{'cycles':>8}{'other':>8}{'rms':>10}{'largest':>10}  of the difference in depth, mm"
    for phase in dict.fromkeys(cycle.record.phase for cycle in cycles):
        chosen = [cycle for cycle in cycles if cycle.record.phase == phase]
        deviations = [abs(c.decision.target.depth - c.record.depth_commanded) * 1e3 for c in chosen]
        other = sum(bool(cycle.differences) for cycle in chosen)
        rms = math.sqrt(sum(a * a for a in deviations) / len(deviations))
        yield f"{phase:<10}{len(chosen):>8}{other:>8}{rms:>10.4f}{max(deviations):>10.4f}"
    for verdict, action in (("stop", "stopped the run"), ("clamp", "clamped the command")):
        new = [c for c in cycles if c.decision.verdict.kind == verdict != c.record.verdict]
        if new:
            why = ", ".join(new[0].decision.reasons)
            yield f"the supervisor would have {action} in {len(new)} more; first in {new[0].record.cycle}: {why}"
    first = next((cycle for cycle in cycles if cycle.differences), None)
    if first is None:
        yield "every command would have been the same"
        return
    yield f"first difference: cycle {first.record.cycle}, phase {first.record.phase}"
    for name, (before, now) in first.differences.items():
        yield f"  {name}: recorded {before}, now {now}"


def _write_table(path: Path, cycles: "list[ReplayedCycle]", overwrite: bool) -> None:
    from hil_bridge.record.files import write_atomically

    lines = ["cycle,phase,force_n,depth_recorded_m,depth_replayed_m,verdict_recorded,verdict_replayed"]
    for cycle in cycles:
        record, decision = cycle.record, cycle.decision
        lines.append(
            f"{record.cycle},{record.phase},{record.force!r},{record.depth_commanded!r},{decision.target.depth!r},"
            f"{record.verdict},{decision.verdict.kind}"
        )
    write_atomically(path, ("\n".join(lines) + "\n").encode(), overwrite)
