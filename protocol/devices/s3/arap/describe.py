"""A captured piece of a computer link put into words, for the decode command and the monitor."""

from typing import Any, TypeAlias

from protocol.devices.s3.adlp import (
    HEADER_SIZE,
    LENGTH_STYLES,
    SINGLE_CONTROLS,
    Block,
    BlockFormat,
    Control,
    DleStuffing,
    Flaw,
    LengthStyle,
    LinkProfile,
    check_character,
)
from protocol.devices.s3.arap.blocks import further_type
from protocol.devices.s3.arap.codes import function_text, type_text
from protocol.devices.s3.arap.order_book import KNOWN, OrderBook
from protocol.devices.s3.arap.telegram import FROM_PC, Telegram
from protocol.endpoint import RemoteProtocolError

_Item: TypeAlias = dict[str, Any]
_DLE = bytes((Control.DLE,))
CONTROL_TEXTS = {
    Control.STX: 'after DLE: a block begins ("even")',
    Control.STX_ODD: 'after DLE: a block begins ("odd")',
    Control.ETX: "after DLE: the telegram has ended, the check character follows",
    Control.DLE: "the next byte begins or ends a block",
    Control.ENQ: "bid for the line",
    Control.ACK: "acknowledged",
    Control.WACK: "wait",
    Control.RVI: "acknowledged, the receiver asks for the line",
    Control.NAK: "refused",
    Control.EOT: "end of the message",
}
"""Meaning of the control bytes."""


def describe(
    raw: bytes,
    dle_stuffing: DleStuffing = "off",
    max_telegram: int = LinkProfile().max_telegram,
    orders: OrderBook = KNOWN,
) -> list[dict[str, Any]]:
    """Control bytes, blocks and everything else in a capture, in order, as plain values.

    Every item has `offset`, `size`, `kind` ("control", "block", "error" or "noise") and `meaning`. A block
    adds its `direction`, `stx`, `header`, `checksum` and `fields`; `problem` and `problem_offset` say what is
    wrong with it. Never raises for what the bytes are.
    """
    items: list[dict[str, Any]] = []
    at = 0
    before: Telegram | None = None
    while at < len(raw):
        item, telegram = _item_at(raw, at, dle_stuffing, max_telegram)
        if telegram is not None:
            _describe_telegram(item, telegram, before, orders)
            before = telegram
        previous = items[-1] if items else None
        if previous and previous["kind"] == item["kind"] == "noise":
            previous["size"] += item["size"]
            previous["bytes"] += " " + item["bytes"]
        else:
            items.append(item)
        at += item["size"]
    return items


def _item_at(raw: bytes, at: int, stuffing: DleStuffing, max_telegram: int) -> tuple[_Item, Telegram | None]:
    """Meaning of these bytes, and the telegram in them if one can be read."""
    byte = raw[at]
    if (control := SINGLE_CONTROLS.get(byte)) is not None:
        item: _Item = {
            "offset": at,
            "size": 1,
            "kind": "control",
            "name": control.name,
            "meaning": CONTROL_TEXTS[control],
        }
        return item, None
    if byte == Control.DLE:
        return _block_at(raw, at, stuffing, max_telegram)
    return _noise(raw, at), None


def _noise(raw: bytes, at: int) -> _Item:
    return {
        "offset": at,
        "size": 1,
        "kind": "noise",
        "meaning": "no control byte and outside a block",
        "bytes": f"{raw[at]:02X}",
    }


def _block_at(raw: bytes, at: int, stuffing: DleStuffing, max_telegram: int) -> tuple[_Item, Telegram | None]:
    # Byte 2 of the telegram tells the direction, and only the PC may state its length in two ways.
    head = raw[at + 2 : at + 2 + HEADER_SIZE]
    if stuffing == "double":
        head = head.replace(_DLE * 2, _DLE)
    from_robot = head[2:3] != bytes((FROM_PC,))
    found = _decode(raw, at, [BlockFormat(stuffing, (style,), max_telegram) for style in _styles(from_robot)])
    match found:
        case Block():
            return _describe_block(at, found, from_robot)
        case Flaw(at=1):
            return _noise(raw, at), None
        case Flaw(whole=True):
            telegram = raw[at + 2 : at + found.size - 3]
            if stuffing == "double":
                telegram = telegram.replace(_DLE * 2, _DLE)
            item, readable = _describe_block(at, Block(telegram, raw[at + 1], found.size), from_robot)
            item["checksum"] |= {"got": f"{raw[at + found.size - 1]:02X}", "right": False}
            item["problem"] = found.text
            item["problem_offset"] = at + found.at
            return item, readable
        case Flaw():
            return _error(at, _extent(raw, at, 2), f"block: {found.text}", at + found.at), None
        case _:
            size = _extent(raw, at, len(raw) - at)
            return _error(at, size, "block: the capture ends before its length is reached", len(raw)), None


def _styles(from_robot: bool) -> tuple[LengthStyle, ...]:
    return LENGTH_STYLES[:1] if from_robot else LENGTH_STYLES


def _decode(raw: bytes, at: int, formats: list[BlockFormat]) -> Block | Flaw | None:
    """Return the best reading. Nothing more will come, so an incomplete reading is rejected."""
    readings = [found for form in formats if (found := form.decode(raw, at)) is not None]
    readings.sort(key=lambda found: (isinstance(found, Flaw), not (isinstance(found, Flaw) and found.whole)))
    return readings[0] if readings else None


def _extent(raw: bytes, at: int, otherwise: int) -> int:
    """Size of what probably is the block, judged by the next DLE ETX alone."""
    trailer = raw.find(bytes((Control.DLE, Control.ETX)), at + 2)
    return min(trailer + 3, len(raw)) - at if trailer >= 0 else otherwise


def _error(at: int, size: int, meaning: str, where: int) -> _Item:
    return {
        "offset": at,
        "size": size,
        "kind": "error",
        "meaning": meaning,
        "problem": meaning,
        "problem_offset": where,
    }


def _describe_block(at: int, block: Block, from_robot: bool) -> tuple[_Item, Telegram | None]:
    check = f"{check_character(block.telegram):02X}"
    item: _Item = {
        "offset": at,
        "size": block.size,
        "kind": "block",
        "meaning": "",
        "direction": "S3 → PC" if from_robot else "PC → S3",
        "stx": f"{block.stx:02X}",
        "bytes": block.telegram.hex(" ").upper(),
        "checksum": {"expected": check, "got": check, "right": True},
        "header": {},
        "fields": [],
    }
    try:
        telegram = Telegram.decode(block.telegram, from_robot)
    except RemoteProtocolError as error:
        item |= {"meaning": "unreadable telegram", "problem": str(error), "problem_offset": at + 2}
        return item, None
    item["header"] = {
        "length": int.from_bytes(block.telegram[:2], "big"),
        "source": block.telegram[2],
        "destination": block.telegram[3],
        "function": telegram.function,
        "function_text": function_text(telegram.function),
        "type": telegram.type,
        "type_text": type_text(telegram.type),
        "suffix": telegram.suffix,
    }
    return item, telegram


def _describe_telegram(item: _Item, telegram: Telegram, before: Telegram | None, orders: OrderBook) -> None:
    """Add what the telegram means; `before` is the last one, whose continuation it may be."""
    definition = orders.of_function(telegram.function)
    item["meaning"] = str(telegram)
    item["header"] |= {
        "suffix_text": orders.suffix_text(telegram.function, telegram.suffix),
        "order": definition.name if definition else "",
    }
    continued = (
        before is not None
        and (before.from_robot, before.function) == (telegram.from_robot, telegram.function)
        and before.type == further_type(before.from_robot)
    )
    try:
        text = orders.describe(telegram, continued)
    except RemoteProtocolError as error:
        item.setdefault("problem", str(error))
        item.setdefault("problem_offset", item["offset"] + 2 + HEADER_SIZE)
        return
    item["fields"] = text.fields
    if text.remark:
        item["meaning"] += f": {text.remark}"
