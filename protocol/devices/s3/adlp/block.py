"""ADLP-10 blocks and control bytes, and the scanner that finds them in a stream.

A block is `DLE STX <telegram> DLE ETX BCC`. While DLE bytes inside a telegram are not doubled, `10 03` may be data. So
a block ends where the telegram's own length says it ends. Source: computer-link specification, section 2, itself from
the ofxABBRobot client.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import reduce
from operator import xor
from typing import NamedTuple, TypeAlias

from protocol.devices.s3.adlp.profile import BlockEnd, DleStuffing, LengthStyle

HEADER_SIZE = 8
"""Bytes of a telegram before its data; its first two are the length. Mark: observed."""
BLOCK_OVERHEAD = 5
"""Bytes that a block adds to its telegram: DLE STX, DLE ETX BCC. Mark: observed."""
LENGTH_STYLES: tuple[LengthStyle, ...] = ("whole", "data")


class Control(IntEnum):
    """The control bytes. Mark: observed (WACK and RVI are defined by the client but were never used)."""

    STX = 0x02
    """Begins a block; "even" where block starts alternate."""
    ETX = 0x03
    EOT = 0x04
    ENQ = 0x05
    ACK = 0x06
    WACK = 0x0E
    RVI = 0x0F
    DLE = 0x10
    NAK = 0x15
    STX_ODD = 0x82


SINGLE_CONTROLS = {
    int(c): c for c in (Control.EOT, Control.ENQ, Control.ACK, Control.WACK, Control.RVI, Control.NAK)
}
"""Control bytes that mean something on their own."""
_STARTS = frozenset((Control.STX, Control.STX_ODD))
_MEANINGFUL = re.compile(b"[" + b"".join(rb"\x%02x" % c for c in (*SINGLE_CONTROLS, Control.DLE)) + b"]")
_DLE_BYTE = int(Control.DLE)
_DLE = bytes((Control.DLE,))
TRAILER = bytes((Control.DLE, Control.ETX))
"""Ends a block; while DLE travels once, the same bytes may be data."""


class Block(NamedTuple):
    """A complete block with the right check character."""

    telegram: bytes
    stx: int
    """02 or 82."""
    size: int
    """Bytes on the line."""


class Flaw(NamedTuple):
    """Bytes that began like a block and are none."""

    text: str
    at: int
    """Where it is wrong, in bytes from the block's DLE."""
    size: int
    """Bytes that are certainly its own: all of a whole frame, else 1."""
    whole: bool
    """The frame ends where it should and only its check character is wrong."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes that mean nothing where they stand."""

    data: bytes


Token: TypeAlias = Control | Block | Flaw | Noise


def check_character(telegram: bytes) -> int:
    """BCC of a block: XOR of the telegram's bytes and of ETX; both DLEs and STX stay outside."""
    return reduce(xor, telegram, int(Control.ETX))


def encode_block(telegram: bytes, stuffing: DleStuffing = "off", stx: int = Control.STX) -> bytes:
    """Encode the block that carries a telegram. The check character is never doubled, whatever its value."""
    body = telegram.replace(_DLE, _DLE * 2) if stuffing == "double" else telegram
    return b"%c%c%b%b%c" % (Control.DLE, stx, body, TRAILER, check_character(telegram))


def telegram_sizes(length: int, styles: Sequence[LengthStyle]) -> list[int]:
    """Sizes that a telegram with this length field may have, the shorter first."""
    sizes = []
    if "whole" in styles and length >= HEADER_SIZE:
        sizes.append(length)
    if "data" in styles:
        sizes.append(length + HEADER_SIZE)
    return sizes


@dataclass(frozen=True, slots=True)
class BlockFormat:
    """Rules by which the end of a block is found."""

    stuffing: DleStuffing
    styles: tuple[LengthStyle, ...]
    """Meaning of the length field: from a robot always the whole telegram."""
    max_telegram: int
    end: BlockEnd = "length"
    """By what the end is found while DLE travels once."""

    def decode(self, data: bytes, start: int = 0) -> Block | Flaw | None:
        """Decode the block whose DLE is at `start`: the block, its flaw, or None until more bytes arrive."""
        if len(data) < start + 2:
            return None
        if data[start + 1] not in _STARTS:
            return Flaw(f"DLE is followed by {data[start + 1]:02X}, not STX", 1, 1, False)
        if self.stuffing == "double":
            return self._decode_doubled(data, start)
        return (
            self._decode_to_trailer(data, start) if self.end == "trailer" else self._decode_plain(data, start)
        )

    def _decode_plain(self, data: bytes, start: int) -> Block | Flaw | None:
        begin = start + 2
        if len(data) < begin + 2:
            return None
        length = data[begin] << 8 | data[begin + 1]
        sizes = [n for n in telegram_sizes(length, self.styles) if n <= self.max_telegram]
        if not sizes:
            return Flaw(f"impossible length {length}", 2, 1, False)
        flaw = Flaw(f"no DLE ETX where the length {length} puts it", 2 + sizes[-1], 1, False)
        for size in sizes:
            end = begin + size
            if len(data) < end + 3:
                return None
            if data[end : end + 2] == TRAILER:
                telegram = data[begin:end]
                if data[end + 2] == check_character(telegram):
                    return Block(telegram, data[start + 1], size + BLOCK_OVERHEAD)
                flaw = _wrong_checksum(telegram, data[end + 2], size + BLOCK_OVERHEAD)
        return flaw

    def _decode_to_trailer(self, data: bytes, start: int) -> Block | Flaw | None:
        begin = start + 2
        end = data.find(TRAILER, begin, begin + self.max_telegram + len(TRAILER))
        if end < 0 and len(data) >= begin + self.max_telegram + len(TRAILER):
            return Flaw(f"no DLE ETX within {self.max_telegram} bytes", 2, 1, False)
        if end < 0 or len(data) < end + 3:
            return None
        telegram = data[begin:end]
        if data[end + 2] != check_character(telegram):
            return _wrong_checksum(telegram, data[end + 2], len(telegram) + BLOCK_OVERHEAD)
        return Block(telegram, data[start + 1], len(telegram) + BLOCK_OVERHEAD)

    def _decode_doubled(self, data: bytes, start: int) -> Block | Flaw | None:
        parts: list[bytes] = []
        size = 0
        at = start + 2
        while True:
            mark = data.find(_DLE, at)
            size += (len(data) if mark < 0 else mark) - at
            if size > self.max_telegram:
                return Flaw(f"telegram is longer than {self.max_telegram} bytes", 2, 1, False)
            if mark < 0 or len(data) < mark + 2:
                return None
            parts.append(data[at:mark])
            if data[mark + 1] == Control.ETX:
                break
            if data[mark + 1] != Control.DLE:
                return Flaw(f"DLE is followed by {data[mark + 1]:02X} inside", mark - start, 1, False)
            parts.append(_DLE)
            size += 1
            at = mark + 2
        if len(data) < mark + 3:
            return None
        telegram = b"".join(parts)
        length = int.from_bytes(telegram[:2], "big")
        if len(telegram) not in telegram_sizes(length, self.styles):
            # Cut short by a lost DLE, or short of a 00, which no XOR tells.
            return Flaw(f"length {length} in a telegram of {len(telegram)} bytes", 2, 1, False)
        if data[mark + 2] != check_character(telegram):
            return _wrong_checksum(telegram, data[mark + 2], mark + 3 - start)
        return Block(telegram, data[start + 1], mark + 3 - start)


def _wrong_checksum(telegram: bytes, got: int, size: int) -> Flaw:
    text = f"check character is {got:02X}, the telegram needs {check_character(telegram):02X}"
    return Flaw(text, size - 1, size, True)


class BlockScanner:
    """Cuts a byte stream into control bytes, blocks, flaws and noise; any split of it gives the same tokens.

    Only noise may come in several pieces. An unfinished block is kept back, at most one block long.
    """

    def __init__(self, block_format: BlockFormat) -> None:
        self._format = block_format
        self._pending = b""

    @property
    def pending(self) -> int:
        """Bytes of an unfinished block that are kept back."""
        return len(self._pending)

    def drop(self) -> int:
        """Forget the unfinished block; returns how many bytes that were."""
        dropped, self._pending = len(self._pending), b""
        return dropped

    def feed(self, data: bytes) -> list[Token]:
        """Events that the bytes complete, in order."""
        if self._pending:
            data, self._pending = self._pending + data, b""
        tokens: list[Token] = []
        at, end = 0, len(data)
        while at < end:
            byte = data[at]
            if byte == _DLE_BYTE:
                found = self._format.decode(data, at)
                if found is None:
                    self._pending = data[at:]
                    break
                tokens.append(found)
                at += found.size
            elif (control := SINGLE_CONTROLS.get(byte)) is not None:
                tokens.append(control)
                at += 1
            else:
                match = _MEANINGFUL.search(data, at)
                stop = match.start() if match else end
                tokens.append(Noise(data[at:stop]))
                at = stop
        return tokens
