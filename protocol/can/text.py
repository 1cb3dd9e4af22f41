"""A CAN frame as text, as candump writes it, read back. `str` of a frame writes it."""

import string

from protocol.can.frame import CanFrame

_HEX = frozenset(string.hexdigits)


def parse_frame(text: str) -> CanFrame:
    """A frame from `ID#DATA`: three hexadecimal digits (eight when extended), then bytes, or R when remote, with the
    number of bytes that it asks for. A ! instead of the # makes it an interface's report of an error.

    Raises ValueError that names the column, counted from 1.
    """
    sign = "!" if "!" in text else "#"
    name, found, data = text.partition(sign)
    if not found:
        raise ValueError(f"column {len(text) + 1}: a # between identifier and data is missing")
    _check_digits(name, 1)
    if len(name) not in (3, 8):
        raise ValueError(f"column 1: an identifier has 3 or 8 digits, got {len(name)}")
    extended, error = len(name) == 8, sign == "!"
    number, start = int(name, 16), len(name) + 2
    if number > (0x1FFFFFFF if extended else 0x7FF):
        raise ValueError(f"column 1: identifier {name} is too large")
    if data[:1] in ("R", "r"):
        if data[1:] not in ("", *"012345678"):
            raise ValueError(f"column {start + 1}: a remote frame asks for 0 … 8 bytes")
        return CanFrame(number, bytes(int(data[1:] or 0)), extended=extended, remote=True, error=error)
    _check_digits(data, start)
    if len(data) > 16:
        raise ValueError(f"column {start + 16}: a frame holds at most 8 bytes")
    if len(data) % 2:
        raise ValueError(f"column {start + len(data)}: half a byte at the end")
    return CanFrame(number, bytes.fromhex(data), extended=extended, error=error)


def _check_digits(text: str, column: int) -> None:
    for place, character in enumerate(text):
        if character not in _HEX:
            raise ValueError(f"column {column + place}: {character!r} is no hexadecimal digit")
