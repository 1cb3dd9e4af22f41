"""Description of the bytes on an FT 300's line as plain values for display."""

from protocol.devices.ft300.messages import (
    EXCEPTION_BIT,
    EXCEPTIONS,
    HEADER,
    MESSAGE,
    MESSAGE_SIZE,
    READ,
    READ_INPUT,
    SLAVE,
    WRITE,
    WRITE_ONE,
    crc_fits,
    decode_message,
    decode_request,
    request_size,
    words_of,
)
from protocol.endpoint import RemoteProtocolError

_FUNCTIONS = {READ: "read", READ_INPUT: "read", WRITE_ONE: "write", WRITE: "write"}


def describe(raw: bytes) -> list[dict[str, object]]:
    """Describe stream messages, Modbus frames and all other bytes, in order."""
    items: list[dict[str, object]] = []
    at = noise = 0
    while at < len(raw):
        item = _item(raw, at)
        if item is None:
            at += 1
            continue
        if noise < at:
            items.append(_noise(raw, noise, at))
        items.append(item)
        at = noise = at + int(str(item["size"]))
    if noise < at:
        items.append(_noise(raw, noise, at))
    return items


def _noise(raw: bytes, begin: int, end: int) -> dict[str, object]:
    part = raw[begin:end]
    stop = part.count(0xFF) == len(part)
    return {
        "offset": begin,
        "size": len(part),
        "kind": "stop" if stop else "noise",
        "fields": [],
        "problems": [] if stop else ["not a message or a frame"],
    }


def _item(raw: bytes, at: int) -> dict[str, object] | None:
    message = raw[at : at + MESSAGE_SIZE]
    if message.startswith(HEADER):
        try:
            decode_message(message)
        except RemoteProtocolError:
            return None
        return _as_item(at, MESSAGE_SIZE, "message", MESSAGE.describe(message))
    if raw[at] != SLAVE or len(raw) < at + 5:
        return None
    function = raw[at + 1]
    if function & EXCEPTION_BIT and crc_fits(raw[at : at + 5]):
        code = raw[at + 2]
        return _as_item(
            at, 5, f"exception: {EXCEPTIONS.get(code, 'unknown')}", [_field("code", code, code, "")]
        )
    size = request_size(raw[at:])
    if (
        function in _FUNCTIONS
        and size is not None
        and crc_fits(raw[at : at + size])
        and len(raw) >= at + size
    ):
        try:
            request = decode_request(raw[at : at + size])
        except RemoteProtocolError:
            return None
        fields = [_field("register", request.register, request.register, "")]
        fields += [_field("count", request.words, request.words, "words")]
        fields += [_field("word", word, word, "") for word in request.values]
        return _as_item(at, size, _FUNCTIONS[function], fields)
    size = 5 + raw[at + 2]
    if function in (READ, READ_INPUT) and crc_fits(raw[at : at + size]) and len(raw) >= at + size:
        try:
            registers = words_of(raw[at + 2 : at + size - 2])
        except RemoteProtocolError:
            return None
        return _as_item(at, size, "words", [_field("word", word, word, "") for word in registers])
    if function == WRITE and crc_fits(raw[at : at + 8]) and len(raw) >= at + 8:
        register = int.from_bytes(raw[at + 2 : at + 4], "big")
        return _as_item(at, 8, "written", [_field("register", register, register, "")])
    return None


def _as_item(at: int, size: int, kind: str, fields: list[dict[str, object]]) -> dict[str, object]:
    return {"offset": at, "size": size, "kind": kind, "fields": fields, "problems": []}


def _field(name: str, raw: int, value: float, unit: str) -> dict[str, object]:
    return {"name": name, "raw": raw, "value": value, "unit": unit, "mark": "observed", "meaning": ""}
