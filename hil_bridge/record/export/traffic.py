"""The raw traffic of a recording, piece by piece, and as text."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hil_bridge.record import LinkRecord, RawTraffic, WireRecord
from hil_bridge.record.pieces import is_frame, not_readable, recorded_pieces
from protocol.can.frame import CanFrame
from protocol.can.text import parse_frame


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


def is_can(traffic: RawTraffic) -> bool:
    """Whether the sensor's wire carried CAN frames."""
    return any(
        is_frame(part)
        for piece in recorded_pieces(traffic.sensor)
        if not piece.is_event
        for part in piece.parts
    )


def can_frames(records: Sequence[WireRecord]) -> list[WireFrame]:
    """Return the frames of a CAN wire, oldest first. Raises ConfigError for a record that holds something else."""
    found = []
    for piece in recorded_pieces(records):
        if piece.is_event:
            continue
        for text in filter(None, piece.parts):
            try:
                frame = parse_frame(text)
            except ValueError as error:
                raise not_readable(text, f"no CAN frame: {error}") from error
            found.append(WireFrame(piece.at, piece.direction == "tx", frame))
    # a frame that the kernel stamped may have come before one that was sent before it was read
    found.sort(key=lambda one: one.at)
    return found


def wire_text(records: Sequence[LinkRecord | WireRecord], title: str) -> WireText:
    """Return the bytes of a wire as a text capture, which `hil-bridge monitor` reads for a computer link.

    A line for each piece or datagram with the run's clock, s, `tx` or `rx` as the PC sees it, and hexadecimal
    bytes. Link events stand in comments. Raises ConfigError for a record that holds something else.
    """
    lines = [f"# {title}", "# seconds of the run's clock, tx sent by the PC or rx received by it, bytes"]
    pieces, newest = 0, 0.0
    for piece in recorded_pieces(records):
        newest = max(newest, piece.at)  # each was rounded for itself
        if piece.is_event:
            lines.append(f"# {newest:.6f} {' '.join(piece.parts[0].split())}")
            continue
        for text in filter(None, piece.parts):
            try:
                data = bytes.fromhex(text)
            except ValueError as error:
                raise not_readable(text, "no hexadecimal bytes") from error
            lines.append(f"{newest:.6f} {piece.direction} {data.hex(' ').upper()}")
            pieces += 1
    return WireText("\n".join(lines) + "\n", pieces)
