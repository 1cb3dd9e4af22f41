"""Textual description of bytes captured from a computer link, for the decode command and the monitor."""

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
    Control.RVI: "acknowledged, the receiver requests the line",
    Control.NAK: "refused",
    Control.EOT: "end of the message",
}
"""Meaning of each control byte."""


def describe(
    raw: bytes,
    dle_stuffing: DleStuffing = "off",
    max_telegram: int = LinkProfile().max_telegram,
    orders: OrderBook = KNOWN,
) -> list[dict[str, Any]]:
    """Describe the control bytes, blocks and all other bytes in a capture, in order, as plain values.

    Every item has `offset`, `size`, `kind` ("control", "block", "error" or "noise") and `meaning`. A block adds its
    `direction`, `stx`, `header`, `checksum` and `fields`. `problem` and `problem_offset` describe an error. Never
    raises, regardless of the bytes.
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
    """Return the description of the item at this position, and the telegram in it if it can be decoded."""
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
        "meaning": "not a control byte, and outside a block",
        "bytes": f"{raw[at]:02X}",
    }


def _block_at(raw: bytes, at: int, stuffing: DleStuffing, max_telegram: int) -> tuple[_Item, Telegram | None]:
    # Byte 2 of the telegram gives the direction, and only the PC may state its length in two ways.
    head = raw[at + 2 : at + 2 + HEADER_SIZE]
    if stuffing == "double":
        head = head.replace(_DLE * 2, _DLE)
    from_robot = head[2:3] != bytes((FROM_PC,))
    result = _decode(
        raw, at, [BlockFormat(stuffing, (style,), max_telegram) for style in _styles(from_robot)]
    )
    match result:
        case Block():
            return _describe_block(at, result, from_robot)
        case Flaw(at=1):
            return _noise(raw, at), None
        case Flaw(whole=True):
            telegram = raw[at + 2 : at + result.size - 3]
            if stuffing == "double":
                telegram = telegram.replace(_DLE * 2, _DLE)
            item, readable = _describe_block(at, Block(telegram, raw[at + 1], result.size), from_robot)
            item["checksum"] |= {"got": f"{raw[at + result.size - 1]:02X}", "right": False}
            item["problem"] = result.text
            item["problem_offset"] = at + result.at
            return item, readable
        case Flaw():
            return _error(at, _extent(raw, at, 2), f"block: {result.text}", at + result.at), None
        case _:
            size = _extent(raw, at, len(raw) - at)
            return _error(at, size, "block: the capture ends before its length is reached", len(raw)), None


def _styles(from_robot: bool) -> tuple[LengthStyle, ...]:
    return LENGTH_STYLES[:1] if from_robot else LENGTH_STYLES


def _decode(raw: bytes, at: int, formats: list[BlockFormat]) -> Block | Flaw | None:
    """Return the best decoding. An incomplete decoding is rejected, because no more bytes follow."""
    readings = [result for form in formats if (result := form.decode(raw, at)) is not None]
    readings.sort(
        key=lambda result: (isinstance(result, Flaw), not (isinstance(result, Flaw) and result.whole))
    )
    return readings[0] if readings else None


def _extent(raw: bytes, at: int, otherwise: int) -> int:
    """Return the probable size of the block, determined only from the next DLE ETX."""
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
    """Add the meaning of the telegram to the item. `before` is the previous telegram, which this one may continue."""
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
