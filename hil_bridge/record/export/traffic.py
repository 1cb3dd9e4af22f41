"""Raw traffic of a recording, as single pieces and as text."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hil_bridge.record import LinkRecord, RawTraffic, WireRecord
from hil_bridge.record.pieces import is_frame, not_readable, recorded_pieces
from protocol.can.frame import CanFrame
from protocol.can.text import parse_frame


class WireFrame(NamedTuple):
    """CAN frame on the wire of a sensor."""

    at: float
    """Time at which the frame was handed to the interface or received from the bus, s on the run's clock."""
    sent: bool
    """Whether the PC sent the frame."""
    frame: CanFrame


@dataclass(frozen=True, slots=True)
class WireText:
    """Data on a byte wire, as text."""

    text: str
    pieces: int
    """Number of pieces, excluding link events."""


def is_can(traffic: RawTraffic) -> bool:
    """Return whether the sensor's wire carried CAN frames."""
    return any(
        is_frame(part)
        for piece in recorded_pieces(traffic.sensor)
        if not piece.is_event
        for part in piece.parts
    )


def can_frames(records: Sequence[WireRecord]) -> list[WireFrame]:
    """Return the frames of a CAN wire, oldest first. Raises ConfigError if the recording has other contents."""
    frames = []
    for piece in recorded_pieces(records):
        if piece.is_event:
            continue
        for text in filter(None, piece.parts):
            try:
                frame = parse_frame(text)
            except ValueError as error:
                raise not_readable(text, f"not a CAN frame: {error}") from error
            frames.append(WireFrame(piece.at, piece.direction == "tx", frame))
    # a frame stamped by the kernel may be older than a frame sent before the read
    frames.sort(key=lambda one: one.at)
    return frames


def wire_text(records: Sequence[LinkRecord | WireRecord], title: str) -> WireText:
    """Return the bytes of a wire as a text capture, which `hil-bridge monitor` can read for a computer link.

    Each piece or datagram is one line: time on the run's clock, s, `tx` or `rx` as seen by the PC, and hexadecimal
    bytes. Link events are comments. Raises ConfigError if the recording has other contents.
    """
    lines = [f"# {title}", "# seconds of the run's clock, tx sent by the PC or rx received by it, bytes"]
    pieces, newest = 0, 0.0
    for piece in recorded_pieces(records):
        newest = max(newest, piece.at)  # the times were rounded separately
        if piece.is_event:
            lines.append(f"# {newest:.6f} {' '.join(piece.parts[0].split())}")
            continue
        for text in filter(None, piece.parts):
            try:
                data = bytes.fromhex(text)
            except ValueError as error:
                raise not_readable(text, "not hexadecimal bytes") from error
            lines.append(f"{newest:.6f} {piece.direction} {data.hex(' ').upper()}")
            pieces += 1
    return WireText("\n".join(lines) + "\n", pieces)
