"""The pieces of a wire's recorded traffic, read back from the lines that `link_log` writes."""

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.record.link_log import LINK_EVENT
from hil_bridge.record.reader import CLOCK_LIMIT_S
from hil_bridge.record.records import LinkRecord, WireRecord

_LINE = re.compile(r"(-?\d{1,10}(?:\.\d{0,9})?) (tx|rx|--) ?(.*)", re.ASCII | re.DOTALL)
_SHOWN = 40
"""Most characters of a wrong line in a message. Chosen."""


class RecordedPiece(NamedTuple):
    """Something that went over a wire at one time, or an event of its link."""

    at: float
    """Time on the run's clock, s."""
    direction: str
    """`tx` or `rx` as the PC sees it; `--` for an event."""
    parts: tuple[str, ...]
    """Hexadecimal bytes of each datagram, CAN frames as candump writes them, or the text of the event alone."""

    @property
    def is_event(self) -> bool:
        """It did not travel."""
        return self.direction == LINK_EVENT


def recorded_pieces(records: Iterable[LinkRecord | WireRecord], name: str = "") -> Iterator[RecordedPiece]:
    """Return the pieces of these records in order.

    Raises ConfigError, with the `name` of the recording, for a wrong line.
    """
    for record in records:
        for text in record.pieces:
            line = _LINE.fullmatch(text)
            if line is None or not abs(record.at) < CLOCK_LIMIT_S:
                raise not_readable(text, "no piece of a wire's traffic", name)
            at, direction, what = record.at + float(line[1]), line[2], line[3]
            parts = (what,) if direction == LINK_EVENT else tuple(what.split(" "))
            yield RecordedPiece(at, direction, parts)


def is_frame(part: str) -> bool:
    """Whether it is a CAN frame, of which `parse_frame` reads all but an error's; otherwise it is bytes."""
    return "#" in part or "!" in part


def not_readable(text: str, what: str, name: str = "") -> ConfigError:
    """Return the error for a part of a piece that is not `what` it should be."""
    return ConfigError(f"{name and f'{name}: '}{text[:_SHOWN]!r} is {what}; record the run again")
