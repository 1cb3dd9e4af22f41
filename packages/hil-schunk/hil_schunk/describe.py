"""Description of the data of a SCHUNK FTS as plain values for display."""

from hil_schunk.messages import (
    PACKET,
    Command,
    ErrorCode,
    Message,
    MessageReader,
    decode_packet,
    decode_parameter,
    error_words,
)
from protocol.endpoint import RemoteProtocolError
from protocol.marks import Mark

_HEADER_SIZE = 6


def describe(raw: bytes) -> list[dict[str, object]]:
    """Describe a packet, or the messages of either direction in a piece of the command stream. Other data are
    described as a problem. A command with a value and its answer have the same form.
    """
    try:
        packet = decode_packet(raw)
    except RemoteProtocolError:
        return _messages(raw)
    item = {"offset": 0, "size": len(raw), "kind": "packet", "direction": "from sensor"}
    fields = [field for field in PACKET.describe(raw) if field["name"] not in ("sync", "length")]
    if not packet.status:
        next(field for field in fields if field["name"] == "status")["meaning"] = "not ready"
    return [item | {"fields": fields, "problems": []}]


def _messages(raw: bytes) -> list[dict[str, object]]:
    reader, items, at = MessageReader(), [], 0
    for message in reader.feed(raw):
        items.append(_message(message, at))
        at += _HEADER_SIZE + len(message.payload)
    if reader.noises or at < len(raw):
        problem = "bytes that are not a message" if reader.noises else "the message is incomplete"
        items.append(
            {
                "offset": at,
                "size": max(len(raw) - at, 0),
                "kind": "noise",
                "fields": [],
                "problems": [problem],
            }
        )
    return items


def _message(message: Message, at: int) -> dict[str, object]:
    payload = message.payload
    size = _HEADER_SIZE + len(payload)
    item: dict[str, object] = {"offset": at, "size": size, "kind": "message", "problems": []}
    fields = [_field("counter", message.counter)]
    if not payload:
        return item | {"fields": fields, "problems": ["the message is empty"]}
    known = payload[0] in Command._value2member_map_
    item["op"] = Command(payload[0]).label if known else f"{payload[0]:02X}"
    if payload[0] in (Command.READ, Command.WRITE):
        fields += _parameter_fields(payload)
    elif len(payload) > 1:
        fields.append(_field("value or error", payload[1]))
    return item | {
        "fields": fields,
        "problems": [] if known else [f"{payload[0]:02X} is not a known command"],
    }


def _parameter_fields(payload: bytes) -> list[dict[str, object]]:
    """Describe the parameter of a request to read, or of an answer. A request to write cannot be told from an answer
    and is described as one if its second byte is a known error.
    """
    is_answer = len(payload) > 4 and payload[1] in ErrorCode._value2member_map_
    fields = [_field("error", payload[1], error_words(payload[1]))] if is_answer else []
    try:
        parameter, value = decode_parameter(payload[2 if is_answer else 1 :])
    except RemoteProtocolError:
        return fields
    fields += [_field("index", parameter.main), _field("subindex", parameter.sub)]
    return [*fields, _field("value", value.hex())] if value else fields


def _field(name: str, value: object, meaning: str = "") -> dict[str, object]:
    return {
        "name": name,
        "raw": value,
        "value": value,
        "unit": "",
        "mark": Mark.DERIVED.value,
        "meaning": meaning,
    }
