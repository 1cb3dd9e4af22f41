"""Pieces of a wire's recorded traffic, parsed from the lines that `link_log` writes."""

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.record.link_log import LINK_EVENT
from hil_bridge.record.reader import CLOCK_LIMIT_S
from hil_bridge.record.records import LinkRecord, WireRecord

_LINE = re.compile(r"(-?\d{1,10}(?:\.\d{0,9})?) (tx|rx|--) ?(.*)", re.ASCII | re.DOTALL)
_QUOTED_MAX = 40
"""Maximum number of characters of an invalid line that a message quotes. Chosen."""


class RecordedPiece(NamedTuple):
    """Data on a wire at one time, or an event of its link."""

    at: float
    """Time on the run's clock, s."""
    direction: str
    """`tx` or `rx` as seen by the PC; `--` for an event."""
    parts: tuple[str, ...]
    """Hexadecimal bytes of each datagram, CAN frames as candump writes them, or only the text of the event."""

    @property
    def is_event(self) -> bool:
        """Whether the piece is a link event, not data."""
        return self.direction == LINK_EVENT


def recorded_pieces(records: Iterable[LinkRecord | WireRecord], name: str = "") -> Iterator[RecordedPiece]:
    """Return the pieces of these records in order.

    Raises ConfigError for an invalid line; the message contains the `name` of the recording.
    """
    for record in records:
        for text in record.pieces:
            line = _LINE.fullmatch(text)
            if line is None or not abs(record.at) < CLOCK_LIMIT_S:
                raise not_readable(text, "not a piece of a wire's traffic", name)
            at, direction, what = record.at + float(line[1]), line[2], line[3]
            parts = (what,) if direction == LINK_EVENT else tuple(what.split(" "))
            yield RecordedPiece(at, direction, parts)


def is_frame(part: str) -> bool:
    """Return whether a part is a CAN frame, not bytes.

    `parse_frame` can read a CAN frame unless it is an error frame.
    """
    return "#" in part or "!" in part


def not_readable(text: str, what: str, name: str = "") -> ConfigError:
    """Return the error for an invalid part of a piece; `what` states what is wrong with it."""
    return ConfigError(f"{name and f'{name}: '}{text[:_QUOTED_MAX]!r} is {what}; record the run again")
