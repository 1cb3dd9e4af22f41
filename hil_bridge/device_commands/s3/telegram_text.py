"""Description of a telegram as one line of text, for the monitor."""

from collections.abc import Mapping

from hil_bridge.console.printing import field_text
from protocol.devices.s3.arap import (
    KNOWN,
    OrderBook,
    Telegram,
    TelegramType,
    function_text,
    plain_type,
    type_text,
)
from protocol.devices.s3.arap.layouts import FLAG_BITS_16, FLAG_BITS_17
from protocol.endpoint import RemoteProtocolError

_FLAGS = {"flags_16": FLAG_BITS_16, "flags_17": FLAG_BITS_17}
_FURTHER = (TelegramType.FURTHER_FROM_PC, TelegramType.FURTHER_FROM_ROBOT)
_SUFFIXED = (TelegramType.ORDER, TelegramType.SPONTANEOUS, TelegramType.FURTHER_FROM_PC)
"""Telegram types whose suffix has a meaning even if it is 0."""


def telegram_text(
    raw: bytes, from_robot: bool, further: int | None = None, orders: OrderBook = KNOWN
) -> tuple[str, int | None]:
    """Describe a telegram. If another block of the telegram follows, also return the function of the telegram.

    `further` is the function of an announced block. Fields that are 0 are omitted.
    """
    try:
        telegram = Telegram.decode(raw, from_robot)
    except RemoteProtocolError as error:
        return f"unreadable telegram: {error}", None
    function, suffix = telegram.function, telegram.suffix
    type_ = plain_type(telegram.type)
    answers = type_ not in _SUFFIXED
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
    return (f"{head}: {values}" if values else head), function if type_ in _FURTHER else None


def _field_text(field: Mapping[str, object]) -> str:
    """Describe a field; flags are listed by name. Return "" for a field that is 0."""
    name, value = str(field["name"]), field["value"]
    if name in _FLAGS and isinstance(value, (int, float)):
        raised = (flag.replace("_", " ") for flag, bit in _FLAGS[name].items() if int(value) >> bit & 1)
        return " + ".join(raised)
    return field_text(field)
