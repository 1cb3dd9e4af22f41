"""Output of a link monitor on a terminal."""

from hil_bridge.console.printing import Printer, Row
from hil_bridge.device_commands.s3.capture import Sender
from hil_bridge.device_commands.s3.link_monitor import Counts, LinkMonitor

_DIRECTIONS = {Sender.PC: "PC→S3", Sender.ROBOT: "S3→PC", Sender.UNKNOWN: "?"}


def print_lines(show: Printer, monitor: LinkMonitor) -> None:
    """Print all pending lines of a monitor."""
    while (line := monitor.next_line()) is not None:
        direction = _DIRECTIONS[line.sender]
        show.row(Row(line.at, direction, line.text, line.data, line.trouble, line.line_time))


def counts_text(counts: Counts, span: float) -> str:
    """Return the totals of a link's traffic, as one line."""
    busy = f", the line was in use {min(counts.busy / span, 1.0):.0%} of {span:.1f} s" if span > 0.0 else ""
    return (
        f"{counts.blocks} blocks, {counts.repeats} repeated, {counts.refusals} NAK, {counts.unanswered} unanswered, "
        f"{counts.collisions} collisions, {counts.garbage} bytes without meaning{busy}"
    )
