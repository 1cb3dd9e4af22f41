"""Gateway frames as text and as plain values, for people to read."""

import string

from protocol.can.frame import CanFrame
from protocol.jr3.can_gateway.messages import ACKNOWLEDGED, FROM_GATEWAY, FULL_SCALES, LAYOUTS, Op, split

_HEX = frozenset(string.hexdigits)


def parse_frame(text: str) -> CanFrame:
    """A frame from `ID#DATA`: three hexadecimal digits (eight when extended), then bytes, or R when remote.

    Raises ValueError that names the column, counted from 1.
    """
    name, hash_sign, data = text.partition("#")
    if not hash_sign:
        raise ValueError(f"column {len(text) + 1}: a # between identifier and data is missing")
    _check_digits(name, 1)
    if len(name) not in (3, 8):
        raise ValueError(f"column 1: an identifier has 3 or 8 digits, got {len(name)}")
    extended = len(name) == 8
    number, start = int(name, 16), len(name) + 2
    if number > (0x1FFFFFFF if extended else 0x7FF):
        raise ValueError(f"column 1: identifier {name} is too large")
    if data in ("R", "r"):
        return CanFrame(number, extended=extended, remote=True)
    _check_digits(data, start)
    if len(data) > 16:
        raise ValueError(f"column {start + 16}: a frame holds at most 8 bytes")
    if len(data) % 2:
        raise ValueError(f"column {start + len(data)}: half a byte at the end")
    return CanFrame(number, bytes.fromhex(data), extended=extended)


def _check_digits(text: str, column: int) -> None:
    for place, character in enumerate(text):
        if character not in _HEX:
            raise ValueError(f"column {column + place}: {character!r} is no hexadecimal digit")


def describe(frame: CanFrame) -> dict[str, object]:
    """One frame as plain values: op, node, direction, fields with units, and what is wrong with it."""
    number, node = split(frame.identifier)
    result: dict[str, object] = {
        "identifier": str(frame).partition("#")[0],
        "op": None,
        "node": node or None,
        "direction": None,
        "acknowledged": False,
        "fields": [],
    }
    problems: list[str] = []
    result["problems"] = problems
    if frame.error or frame.extended or frame.remote:
        problems.append("a gateway speaks data frames with 11-bit identifiers only")
        return result
    try:
        op = Op(number)
    except ValueError:
        problems.append(f"{number:03X} is no op of a gateway")
        return result
    result["op"] = op.name.lower().replace("_", " ")
    result["direction"] = "from gateway" if op in FROM_GATEWAY else "to gateway"
    result["acknowledged"] = op in ACKNOWLEDGED
    if op is Op.SYNC and node:
        problems.append("SYNC is the bare 080: a gateway ignores it with a node")
    if op is not Op.SYNC and not node:
        problems.append("node 0 is no gateway")
    size = len(frame.data)
    layout = FULL_SCALES if op is Op.ACKNOWLEDGE and size >= FULL_SCALES.size else LAYOUTS[op]
    if size < layout.size:
        consequence = ": what is missing counts as 0" if op in ACKNOWLEDGED else ""
        problems.append(f"{layout.name} needs {layout.size} bytes, got {size}{consequence}")
        return result
    if size > layout.size:
        problems.append(f"{layout.name} has {layout.size} bytes, got {size}: the rest is ignored")
    result["fields"] = layout.describe(frame.data)
    return result
