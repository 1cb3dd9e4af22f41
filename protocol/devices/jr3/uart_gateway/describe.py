"""Textual description of captured bytes from a gateway's serial line."""

from typing import Any

from protocol.devices.jr3.uart_gateway.messages import (
    COMMANDS,
    FROM_GATEWAY,
    LAYOUTS,
    OVERHEAD,
    Frame,
    Op,
    holds_delimiter,
)
from protocol.devices.jr3.uart_gateway.reader import Reader


def describe(raw: bytes) -> list[dict[str, Any]]:
    """Describe the frames and all other bytes in a capture of one or both directions, in order, as plain values.

    Every item has `offset`, `size` and `kind` ("frame" or "noise"). A frame adds `op`, `direction`, `acknowledged`,
    `fields` with units, and `problems`. Never raises, regardless of the bytes.
    """
    reader = Reader(frozenset(Op))
    reader.feed(raw)
    items: list[dict[str, Any]] = []
    at = 0
    while True:
        skipped = reader.skipped
        frame = reader.next_frame(ended=True)
        if noise := reader.skipped - skipped:
            items.append(_noise(raw, at, noise))
            at += noise
        if frame is None:
            return items
        items.append(_frame(frame, at))
        at += len(frame.payload) + OVERHEAD


def _noise(raw: bytes, at: int, size: int) -> dict[str, Any]:
    return {
        "offset": at,
        "size": size,
        "kind": "noise",
        "meaning": "not a frame, or a damaged or truncated one",
        "bytes": raw[at : at + size].hex(" ").upper(),
    }


def _frame(frame: Frame, at: int) -> dict[str, Any]:
    layout = next(layout for layout in LAYOUTS[frame.op] if layout.size == len(frame.payload))
    problems = []
    if frame.op in COMMANDS and holds_delimiter(frame.payload):
        problems.append(
            "the payload contains 3C or 3E: the gateway interprets it as < or > and misreads the frame"
        )
    return {
        "offset": at,
        "size": len(frame.payload) + OVERHEAD,
        "kind": "frame",
        "op": frame.op.name.lower().replace("_", " "),
        "direction": "from gateway" if frame.op in FROM_GATEWAY else "to gateway",
        "acknowledged": frame.op in COMMANDS,
        "fields": layout.describe(frame.payload),
        "problems": problems,
    }
