"""Text captures of a computer link, one piece per line, for users, scripts and the monitor.

    # seconds  sender  bytes
    0.000000 PC 05
    0.013402 S3 06
    0.013410 PC 10 02 00 08 01 00 13 01 00 00 10 03 18

The sender is `PC` or `S3`, or equivalently `tx` or `rx`; `?` is an unknown sender. Empty lines, and text after a #, are
ignored.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from hil_bridge.errors import ConfigError
from hil_bridge.errors.file_kinds import HEAD_BYTES, refuse_known
from hil_bridge.record import LinkRecord
from hil_bridge.record.pieces import not_readable, recorded_pieces


class Sender(StrEnum):
    """End of the link that sent a piece of traffic."""

    PC = "PC"
    ROBOT = "S3"
    UNKNOWN = "?"
    """Unknown sender, because both directions are on one wire."""


_SENDERS = {
    "pc": Sender.PC,
    "tx": Sender.PC,
    "s3": Sender.ROBOT,
    "rx": Sender.ROBOT,
    "?": Sender.UNKNOWN,
}
_LINE = re.compile(
    r"(?P<at>\d+(?:\.\d*)?)\s+(?P<sender>\S+)\s+(?P<data>[0-9A-Fa-f]{2}(?:\s*[0-9A-Fa-f]{2})*)"
)


@dataclass(frozen=True, slots=True)
class Piece:
    """Bytes of one direction that were received together."""

    at: float
    """Time since the start of the capture, s."""
    sender: Sender
    data: bytes

    def __str__(self) -> str:
        return f"{self.at:.6f} {self.sender} {self.data.hex(' ').upper()}"


def parse_capture(text: str, name: str) -> Iterator[Piece]:
    """Yield the pieces of a text capture in order. Raises ConfigError that contains `name` and the invalid line."""
    newest = 0.0
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        piece = _piece(content)
        if piece is None:
            refuse_known(name, text[:HEAD_BYTES].encode())
            raise ConfigError(
                f"{name}: line {number}: {content[:40]!r} is not a piece; write it like 0.013402 S3 06, "
                f"with a sender of {', '.join(_SENDERS)}"
            )
        if piece.at < newest:
            raise ConfigError(
                f"{name}: line {number}: {piece.at:g} s is before {newest:g} s; sort the capture"
            )
        newest = piece.at
        yield piece


def link_pieces(records: Iterable[LinkRecord], name: str) -> Iterator[Piece]:
    """Yield the pieces of a recording's raw traffic in order. Raises ConfigError if they are invalid."""
    for piece in recorded_pieces(records, name):
        if piece.is_event:
            continue
        for text in piece.parts:
            try:
                data = bytes.fromhex(text)
            except ValueError as error:
                raise not_readable(text, "no piece of a link's traffic", name) from error
            yield Piece(piece.at, _SENDERS[piece.direction], data)


def _piece(text: str) -> Piece | None:
    match = _LINE.fullmatch(text)
    sender = _SENDERS.get(match["sender"].lower()) if match else None
    if match is None or sender is None:
        return None
    return Piece(float(match["at"]), sender, bytes.fromhex(match["data"]))
