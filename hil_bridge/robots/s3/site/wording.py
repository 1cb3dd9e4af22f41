"""Telegrams and CAN frames as one line of words, for the monitor."""

from collections.abc import Mapping

from protocol.can.frame import CanFrame
from protocol.endpoint import RemoteProtocolError
from protocol.jr3 import describe
from protocol.s3.arap import KNOWN, OrderBook, Telegram, TelegramType, function_text, type_text
from protocol.s3.arap.layouts import FLAG_BITS_16, FLAG_BITS_17

_FLAGS = {"flags_16": FLAG_BITS_16, "flags_17": FLAG_BITS_17}
_FURTHER = (TelegramType.FURTHER_FROM_PC, TelegramType.FURTHER_FROM_ROBOT)
_SUFFIXED = (TelegramType.ORDER, TelegramType.SPONTANEOUS, TelegramType.FURTHER_FROM_PC)
"""Types whose suffix says something even when it is 0."""


def telegram_text(
    raw: bytes, from_robot: bool, further: int | None = None, orders: OrderBook = KNOWN
) -> tuple[str, int | None]:
    """A telegram in words, and its function if another block of it follows.

    `further` is the function of which a block was announced. Fields that are 0 are left out.
    """
    try:
        telegram = Telegram.decode(raw, from_robot)
    except RemoteProtocolError as error:
        return f"unreadable telegram: {error}", None
    function, suffix = telegram.function, telegram.suffix
    answers = telegram.type not in _SUFFIXED
    meaning = "" if answers and not suffix else orders.suffix_text(function, suffix)
    named = f" {meaning}" if meaning else f" suffix {suffix}" if suffix else ""
    head = f"{function_text(function)}{named}, {type_text(telegram.type)}"
    try:
        text = orders.describe(telegram, continued=further == function)
    except RemoteProtocolError as error:
        return f"{head}: {error}", None
    values = ", ".join(filter(None, map(_field_text, text.fields)))
    if not text.fields and telegram.data:
        values = f"data {telegram.data.hex(' ').upper()}"
    if text.remark:
        values = f"{values} {text.remark}"
    return (f"{head}: {values}" if values else head), function if telegram.type in _FURTHER else None


def frame_text(frame: CanFrame) -> tuple[str, str, bool]:
    """A frame of a JR3 gateway: direction, words, and whether something is wrong with it."""
    told = describe(frame)
    fields, problems = told["fields"], told["problems"]
    assert isinstance(fields, list)
    assert isinstance(problems, list)
    node = f" node {told['node']}" if told["node"] else ""
    head = f"{told['op']}{node}" if told["op"] else str(frame)
    values = ", ".join(filter(None, (_field_text(field, zeros=True) for field in fields)))
    text = ": ".join(filter(None, (head, values)))
    direction = {"from gateway": "JR3→PC", "to gateway": "PC→JR3"}.get(str(told["direction"]), "?")
    return direction, "; ".join((text, *problems)), bool(problems)


def _field_text(field: Mapping[str, object], zeros: bool = False) -> str:
    """Name, value and unit of a field; empty for one that is 0."""
    name, value, unit = str(field["name"]), field["value"], str(field["unit"])
    if name in _FLAGS and isinstance(value, (int, float)):
        raised = (flag.replace("_", " ") for flag, bit in _FLAGS[name].items() if int(value) >> bit & 1)
        return " + ".join(raised)
    if isinstance(value, (int, float)):
        if not value and not zeros:
            return ""
        value = f"{value:.7g}"
    return " ".join(filter(None, (name.replace("_", " "), str(value), unit)))
