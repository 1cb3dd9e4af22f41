"""CAN frames as text in candump format, and the parsers for this format. `str` of a frame writes it.

Source: candump.c and lib.c of can-utils.
"""

import math
import re
import string
from datetime import UTC, datetime
from typing import NamedTuple

from protocol.can.frame import CanFrame

_HEX = frozenset(string.hexdigits)
_ERROR_FLAG = 0x20000000
"""Error flag in a candump identifier. Source: CAN_ERR_FLAG of linux/can.h."""
_BEGIN = r"(?:\((?P<at>[^()]+)\)\s+)?(?P<channel>[A-Za-z][\w.-]*)\s+(?:[RT]X\s+[B-]\s[E-]\s+)?"
_LOG = re.compile(_BEGIN + r"(?P<frame>[0-9A-Fa-f]+#\S*)(?:\s+[RT])?")
_CONSOLE = re.compile(
    _BEGIN + r"(?P<id>[0-9A-Fa-f]+)\s+\[(?P<count>\d+)\]\s*(?P<data>remote request|(?:\s*[0-9A-Fa-f]{2}\b)*)"
    r"(?:\s+'.*'|\s+ERRORFRAME)?"
)


class LogLine(NamedTuple):
    """One line of candump output."""

    at: float | None
    """Time stamp on the clock of the recording computer, s; None if the line has none."""
    channel: str
    frame: CanFrame


def parse_candump(line: str) -> LogLine:
    """Parse a line with a frame as printed or logged by candump.

    The console shows `can0  123   [2]  11 22`; `candump -l` writes `(1436509052.249713) can0 123#1122`. Raises
    ValueError for any other text, including CAN FD.
    """
    if log := _LOG.fullmatch(line.strip()):
        text = log["frame"]
        if "##" in text:
            raise ValueError("CAN FD frames are not supported; use classical frames")
    elif log := _CONSOLE.fullmatch(line.strip()):
        count, data = log["count"], "".join(log["data"].split())
        if len(count) > 1:
            raise ValueError(f"a frame of CAN FD or with [{count}] bytes; classical frames have up to [8]")
        remote = log["data"].startswith("remote")
        if not remote and len(data) != 2 * int(count):
            raise ValueError(f"[{count}] bytes are announced, but {len(data) // 2} are present")
        text = f"{log['id']}#{f'R{count}' if remote else data}"
    else:
        raise ValueError(
            "not a line of candump, such as can0  123   [2]  11 22 or (1436509052.249713) can0 123#1122"
        )
    return LogLine(_parse_time(log["at"]), log["channel"], _mark_error(text))


def _parse_time(text: str | None) -> float | None:
    """Parse the time stamp of a line. Raises ValueError if it is invalid."""
    if text is None:
        return None
    try:
        at = float(text)
    except ValueError:
        at = datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()
    if not math.isfinite(at):
        raise ValueError(f"invalid time {text!r}")
    return at


def _mark_error(text: str) -> CanFrame:
    """Parse a frame of candump, and convert the error flag in its identifier to the `error` attribute."""
    name, _, data = text.partition("#")
    if len(name) == 8 and set(name) <= _HEX and int(name, 16) & _ERROR_FLAG:
        error = parse_frame(f"{int(name, 16) & ~_ERROR_FLAG:08X}#{data}")
        return error._replace(extended=False, error=True)
    return parse_frame(text)


def parse_frame(text: str) -> CanFrame:
    """Parse a frame from `ID#DATA`.

    ID has three hexadecimal digits, or eight if it is extended. DATA contains the data bytes; for a remote frame,
    it is R and the number of requested bytes. A ! instead of the # marks an error report of an interface.

    Raises ValueError that names the column of the error, counted from 1.
    """
    sign = "!" if "!" in text else "#"
    name, separator, data = text.partition(sign)
    if not separator:
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
            raise ValueError(f"column {start + 1}: a remote frame requests 0 … 8 bytes")
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
            raise ValueError(f"column {column + place}: {character!r} is not a hexadecimal digit")
