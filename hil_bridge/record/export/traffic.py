"""The raw traffic of a recording, piece by piece, and as text."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.record import LINK_EVENT, LinkRecord, RawTraffic, WireRecord
from hil_bridge.record.reader import CLOCK_LIMIT_S
from protocol.can.frame import CanFrame
from protocol.can.text import parse_frame

_PIECE = re.compile(r"(-?\d{1,10}(?:\.\d{1,9})?) (tx|rx|--) ?(.*)", re.ASCII | re.DOTALL)


class WireFrame(NamedTuple):
    """A CAN frame that went over a sensor's wire."""

    at: float
    """When it was handed to the interface or came from the bus, s on the run's clock."""
    sent: bool
    """The PC sent it."""
    frame: CanFrame


@dataclass(frozen=True, slots=True)
class WireText:
    """Data that went over a wire of bytes."""

    text: str
    pieces: int
    """How many there are, link events aside."""


class _Piece(NamedTuple):
    at: float
    direction: str
    what: str


def is_can(traffic: RawTraffic) -> bool:
    """Whether the sensor's wire carried CAN frames."""
    return any(
        "#" in piece.what or "!" in piece.what
        for record in traffic.sensor
        for piece in _pieces((record,))
        if piece.direction != LINK_EVENT
    )


def can_frames(records: Sequence[WireRecord]) -> list[WireFrame]:
    """The frames of a CAN wire, oldest first. Raises ConfigError for a record that holds something else."""
    found = []
    for piece in _pieces(records):
        if piece.direction == LINK_EVENT:
            continue
        for text in piece.what.split():
            try:
                frame = parse_frame(text)
            except ValueError as error:
                raise ConfigError(f"{text[:40]!r} is no CAN frame: {error}; record the run again") from error
            found.append(WireFrame(piece.at, piece.direction == "tx", frame))
    # a frame that the kernel stamped may have come before one that was sent before it was read
    found.sort(key=lambda one: one.at)
    return found


def wire_text(records: Sequence[LinkRecord | WireRecord], title: str) -> WireText:
    """The bytes of a wire as a text capture, which `hil-bridge monitor` reads for a computer link: a line for each
    piece or datagram with the run's clock, s, `tx` or `rx` as the PC sees it, and hexadecimal bytes. Link events stand
    in comments. Raises ConfigError for a record that holds something else.
    """
    lines = [f"# {title}", "# seconds of the run's clock, tx sent by the PC or rx received by it, bytes"]
    pieces, newest = 0, 0.0
    for piece in _pieces(records):
        newest = max(newest, piece.at)  # each was rounded for itself
        if piece.direction == LINK_EVENT:
            lines.append(f"# {newest:.6f} {' '.join(piece.what.split())}")
            continue
        for text in piece.what.split():
            try:
                data = bytes.fromhex(text)
            except ValueError as error:
                raise ConfigError(f"{text[:40]!r} is no hexadecimal bytes; record the run again") from error
            lines.append(f"{newest:.6f} {piece.direction} {data.hex(' ').upper()}")
            pieces += 1
    return WireText("\n".join(lines) + "\n", pieces)


def _pieces(records: Sequence[LinkRecord | WireRecord]) -> Iterator[_Piece]:
    for record in records:
        for text in record.pieces:
            match = _PIECE.fullmatch(text)
            if match is None or not abs(record.at) < CLOCK_LIMIT_S:
                raise ConfigError(f"{text[:40]!r} is no piece of a wire's traffic; record the run again")
            yield _Piece(record.at + float(match[1]), match[2], match[3])
