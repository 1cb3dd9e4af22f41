"""ADLP-10 blocks and control bytes, and the scanner that extracts them from a byte stream.

A block is `DLE STX <telegram> DLE ETX BCC`. If DLE bytes inside a telegram are not doubled, `10 03` may be data.
The end of a block is therefore determined from the telegram's length field. Source: computer-link specification,
section 2, which is based on the ofxABBRobot client.
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
"""Number of bytes in a telegram before its data. The first two bytes are the length. Mark: observed."""
BLOCK_OVERHEAD = 5
"""Number of bytes that a block adds to its telegram: DLE STX, DLE ETX BCC. Mark: observed."""
LENGTH_STYLES: tuple[LengthStyle, ...] = ("whole", "data")


class Control(IntEnum):
    """Control bytes of the link. Mark: observed (the client defines WACK and RVI but never used them)."""

    STX = 0x02
    """Start of a block; the "even" one if the starts of blocks alternate."""
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
"""Control bytes that are valid outside a block."""
_STARTS = frozenset((Control.STX, Control.STX_ODD))
_MEANINGFUL = re.compile(b"[" + b"".join(rb"\x%02x" % c for c in (*SINGLE_CONTROLS, Control.DLE)) + b"]")
_DLE_BYTE = int(Control.DLE)
_DLE = bytes((Control.DLE,))
TRAILER = bytes((Control.DLE, Control.ETX))
"""Bytes that end a block. Without DLE doubling, the same bytes may be data."""


class Block(NamedTuple):
    """A complete block with a correct check character."""

    telegram: bytes
    stx: int
    """Byte with which the block started, 02 or 82."""
    size: int
    """Number of bytes that the block has on the line."""


class Flaw(NamedTuple):
    """Bytes that start like a block but do not form one."""

    text: str
    at: int
    """Offset of the error from the block's DLE, in bytes."""
    size: int
    """Number of bytes that certainly belong to the flaw: the entire frame if it is complete, otherwise 1."""
    whole: bool
    """Whether the frame is complete and only its check character is wrong."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes that have no meaning at their position."""

    data: bytes


Token: TypeAlias = Control | Block | Flaw | Noise


def check_character(telegram: bytes) -> int:
    """Return the check character (BCC) of a block: XOR of the telegram's bytes and of ETX, without STX and both
    DLEs.
    """
    return reduce(xor, telegram, int(Control.ETX))


def encode_block(telegram: bytes, stuffing: DleStuffing = "off", stx: int = Control.STX) -> bytes:
    """Encode a telegram as a block. The check character is never doubled, even if it is a DLE."""
    body = telegram.replace(_DLE, _DLE * 2) if stuffing == "double" else telegram
    return b"%c%c%b%b%c" % (Control.DLE, stx, body, TRAILER, check_character(telegram))


def telegram_sizes(length: int, styles: Sequence[LengthStyle]) -> list[int]:
    """Return the possible sizes of a telegram with this length field, the smaller first."""
    sizes = []
    if "whole" in styles and length >= HEADER_SIZE:
        sizes.append(length)
    if "data" in styles:
        sizes.append(length + HEADER_SIZE)
    return sizes


@dataclass(frozen=True, slots=True)
class BlockFormat:
    """Rules that determine the end of a block."""

    stuffing: DleStuffing
    styles: tuple[LengthStyle, ...]
    """Possible meanings of the length field. From a robot, it always counts the entire telegram."""
    max_telegram: int
    end: BlockEnd = "length"
    """Method to determine the end of a block if DLE is not doubled."""

    def decode(self, data: bytes, start: int = 0) -> Block | Flaw | None:
        """Decode the block whose DLE is at index `start`. Return the block, its flaw, or None until more bytes
        arrive.
        """
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
        flaw = Flaw(f"no DLE ETX at the end given by the length {length}", 2 + sizes[-1], 1, False)
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
            # A lost DLE truncated it, or a 00 is missing, which the XOR cannot detect.
            return Flaw(f"length {length} in a telegram of {len(telegram)} bytes", 2, 1, False)
        if data[mark + 2] != check_character(telegram):
            return _wrong_checksum(telegram, data[mark + 2], mark + 3 - start)
        return Block(telegram, data[start + 1], mark + 3 - start)


def _wrong_checksum(telegram: bytes, got: int, size: int) -> Flaw:
    text = f"check character is {got:02X}, the telegram needs {check_character(telegram):02X}"
    return Flaw(text, size - 1, size, True)


class BlockScanner:
    """Splitter of a byte stream into control bytes, blocks, flaws and noise. The result does not depend on the
    chunking.

    Only noise may be returned in several pieces. At most one incomplete block is buffered.
    """

    def __init__(self, block_format: BlockFormat) -> None:
        self._format = block_format
        self._pending = b""

    @property
    def pending(self) -> int:
        """Number of buffered bytes of an incomplete block."""
        return len(self._pending)

    def drop(self) -> int:
        """Discard the incomplete block and return its number of bytes."""
        dropped, self._pending = len(self._pending), b""
        return dropped

    def feed(self, data: bytes) -> list[Token]:
        """Process received bytes and return the items that they complete, in order."""
        if self._pending:
            data, self._pending = self._pending + data, b""
        tokens: list[Token] = []
        at, end = 0, len(data)
        while at < end:
            byte = data[at]
            if byte == _DLE_BYTE:
                result = self._format.decode(data, at)
                if result is None:
                    self._pending = data[at:]
                    break
                tokens.append(result)
                at += result.size
            elif (control := SINGLE_CONTROLS.get(byte)) is not None:
                tokens.append(control)
                at += 1
            else:
                match = _MEANINGFUL.search(data, at)
                stop = match.start() if match else end
                tokens.append(Noise(data[at:stop]))
                at = stop
        return tokens
