"""Textual description of captured RSI telegrams of either direction."""

import re

from protocol.devices.rsi.elements import CHANNEL, ELEMENTS, Content
from protocol.devices.rsi.telegram import CLOCK, ROBOT, SENSOR, Telegram, decode, number
from protocol.endpoint import RemoteProtocolError

_END = re.compile(rb"</(?:Rob|Sen)\s*>")
_BLANK = b" \t\r\n"


def describe(raw: bytes) -> list[dict[str, object]]:
    """Describe the telegrams and all other bytes in a capture of one or both directions, in order, as plain values.

    Every item has `offset`, `size` and `kind` ("telegram" or "noise"). A telegram adds `root`, `direction`, `type`,
    `ipoc`, `fields` with units, and `problems`. Never raises, regardless of the bytes.
    """
    items: list[dict[str, object]] = []
    at = 0
    for end in _END.finditer(raw):
        at += len(raw[at : end.end()]) - len(raw[at : end.end()].lstrip(_BLANK))
        items.append(_item(raw[at : end.end()], at))
        at = end.end()
    if rest := raw[at:].strip(_BLANK):
        items.append(_noise(rest, at, "it ends before </Rob> or </Sen>"))
    return items


def _item(raw: bytes, at: int) -> dict[str, object]:
    try:
        telegram = decode(raw)
    except RemoteProtocolError as error:
        return _noise(raw, at, str(error))
    fields = [_field(tag, text) for tag, text in telegram.values.items()]
    return {
        "offset": at,
        "size": len(raw),
        "kind": "telegram",
        "root": telegram.root,
        "direction": "from robot" if telegram.root == ROBOT else "to robot",
        "type": telegram.type,
        "ipoc": telegram.ipoc,
        "fields": fields,
        "problems": _problems(telegram)
        + [f"{field['name']} is not a number" for field in fields if field["value"] is None],
    }


def _field(tag: str, text: str) -> dict[str, object]:
    name, _, attribute = tag.partition(".")
    element = ELEMENTS.get(name, CHANNEL)
    value: float | str | None = text
    if element.content is not Content.TEXT:
        try:
            value = number(text)
        except RemoteProtocolError:
            value = None
    return {
        "name": tag,
        "raw": text,
        "value": value,
        "unit": element.unit(attribute),
        "meaning": element.meaning,
    }


def _problems(telegram: Telegram) -> list[str]:
    problems = [] if telegram.type else ["the root has no Type"]
    if telegram.root == ROBOT and "RIst.X" not in telegram.values:
        problems.append("RIst is missing: add DEF_RIst to the controller's configuration")
    if telegram.root == SENSOR and not telegram.values:
        problems.append(f"it contains only {CLOCK}: every channel keeps its value or falls to 0, by HOLDON")
    return problems


def _noise(raw: bytes, at: int, meaning: str) -> dict[str, object]:
    return {
        "offset": at,
        "size": len(raw),
        "kind": "noise",
        "meaning": meaning,
        "bytes": repr(raw[:200])[2:-1],
    }
