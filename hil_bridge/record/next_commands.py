"""Commands for an operator after the end of a run. Terminal and page take them from here."""

from pathlib import Path
from shlex import join
from typing import NamedTuple

from msgspec import Struct

from hil_bridge.record.ending import Outcome


class NextCommand(NamedTuple):
    """Command, and what it is for."""

    purpose: str
    command: str


class RunPlaces(Struct, frozen=True):
    """Where a run leaves its recording and its report, and how `hil-bridge free` reaches its tool."""

    record: str = ""
    """Path of the recording; empty if none is kept."""
    reports: bool = False
    """Whether the run writes a report itself."""
    free: tuple[str, ...] = ()
    """Arguments of `hil-bridge free`; empty if it cannot reach the tool, as in an emulated cell that ended with its
    run.
    """

    def next_commands(self, outcome: str, moved: bool, retracted: bool | None) -> list[NextCommand]:
        """Return the commands that make sense after the end of the run, the most urgent first.

        `moved` states whether the run had a control cycle, without which there is no report.
        """
        commands = []
        if self.free and moved and not retracted:
            commands.append(_command("Lift the tool off", "free", *self.free))
        if self.record and outcome not in (Outcome.COMPLETED, Outcome.INTERRUPTED):
            commands.append(_command("Explain the end", "why", self.record))
        if self.record and moved and not self.reports:
            commands.append(_command("Write a report", "report", self.record))
        return commands


def _command(purpose: str, *arguments: str | Path) -> NextCommand:
    return NextCommand(purpose, join(["hil-bridge", *map(str, arguments)]))
