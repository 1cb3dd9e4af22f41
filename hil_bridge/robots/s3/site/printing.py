"""The monitor's lines on a terminal."""

import click

from hil_bridge.robots.s3.site.capture import Sender
from hil_bridge.robots.s3.site.link_monitor import Counts, Line, LinkMonitor

_DIRECTIONS = {Sender.PC: "PC→S3", Sender.ROBOT: "S3→PC", Sender.UNKNOWN: "?"}


class Printer:
    """Prints lines with their times since the first and since the line before."""

    def __init__(self, raw: bool, begun: float | None = None) -> None:
        self._raw = raw
        self._begun = begun
        self._before = begun

    def lines_of(self, monitor: LinkMonitor) -> None:
        """Print what a monitor has to tell."""
        while (line := monitor.next_line()) is not None:
            self.line(line)

    def line(self, line: Line) -> None:
        """Print a line of a link."""
        self.row(line.at, _DIRECTIONS[line.sender], line.line_time, line.text, line.data, line.trouble)

    def row(
        self, at: float, direction: str, line_time: float | None, text: str, data: bytes, trouble: bool
    ) -> None:
        """Print a row: time, time since the row before, direction, line time, what it was."""
        self._begun = at if self._begun is None else self._begun
        since = at - (at if self._before is None else self._before)
        self._before = at
        took = "" if line_time is None else f"{line_time * 1e3:.1f} ms"
        mark = "!" if trouble else " "
        hexed = f"  {{{data.hex(' ').upper()}}}" if self._raw and data else ""
        click.echo(f"{at - self._begun:12.6f} {since:+10.6f} {direction:<6} {took:>8} {mark} {text}{hexed}")


def counts_text(counts: Counts, span: float) -> str:
    """What a link's traffic adds up to, as one line."""
    busy = f", the line was in use {min(counts.busy / span, 1.0):.0%} of {span:.1f} s" if span > 0.0 else ""
    return (
        f"{counts.blocks} blocks, {counts.repeats} repeated, {counts.refusals} NAK, {counts.unanswered} unanswered, "
        f"{counts.collisions} collisions, {counts.garbage} bytes without meaning{busy}"
    )
