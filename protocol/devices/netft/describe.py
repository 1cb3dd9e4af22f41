"""Datagrams of a Net F/T as plain values, for people to read."""

from protocol.devices.netft.page import parse_page
from protocol.devices.netft.records import (
    BUFFER_LIMIT,
    RECORD_SIZE,
    Command,
    decode_record,
    decode_request,
    status_words,
)
from protocol.endpoint import RemoteProtocolError
from protocol.wrench import AXES

_LONGEST_REQUEST = 14
"""Bytes. Longer text is the reason for the absence of the page, as a recording has it."""


def describe(raw: bytes) -> list[dict[str, object]]:
    """One datagram of either direction, a request or records, or the page; anything else is a problem."""
    if raw and len(raw) % RECORD_SIZE == 0 and len(raw) <= BUFFER_LIMIT * RECORD_SIZE:
        return [_record(raw[at : at + RECORD_SIZE], at) for at in range(0, len(raw), RECORD_SIZE)]
    if b"<netft" in raw:
        return [_page(raw)]
    if len(raw) > _LONGEST_REQUEST and (reason := raw.decode("utf-8", errors="replace")).isprintable():
        return [{"offset": 0, "size": len(raw), "kind": "page", "fields": [], "problems": [reason]}]
    item: dict[str, object] = {"offset": 0, "size": len(raw), "kind": "request", "direction": "to sensor"}
    problems: list[str] = []
    fields: list[dict[str, object]] = []
    try:
        request = decode_request(raw)
    except RemoteProtocolError as error:
        problems.append(str(error))
    else:
        try:
            item["op"] = Command(request.command).name.lower().replace("_", " ")
        except ValueError:
            problems.append(f"{request.command:04X} is no command")
        fields = [
            _field("command", request.command, "", "high bit: names where the records shall go"),
            _field("count", request.records, "", "records to send; 0: until a stop"),
        ]
    return [item | {"fields": fields, "problems": problems}]


def _page(raw: bytes) -> dict[str, object]:
    item = {"offset": 0, "size": len(raw), "kind": "page", "direction": "from sensor"}
    try:
        found = parse_page(raw)
    except RemoteProtocolError as error:
        return item | {"fields": [], "problems": [str(error)]}
    fields: list[dict[str, object]] = [
        {
            "name": name,
            "raw": scale,
            "value": scale,
            "unit": unit,
            "mark": "observed",
            "meaning": "of one count",
        }
        for name, scale, unit in zip(AXES, found.scales, ("N",) * 3 + ("N·m",) * 3, strict=True)
    ]
    return item | {"fields": fields, "problems": []}


def _record(raw: bytes, at: int) -> dict[str, object]:
    record = decode_record(raw)
    fields = [
        _field("rdt_sequence", record.rdt_sequence, "", "place in this stream"),
        _field("ft_sequence", record.ft_sequence, "", "number of the internal sample"),
        _field("status", record.status, "", status_words(record.status) or "no error"),
        *(_field(name, count, "counts", "") for name, count in zip(AXES, record.counts, strict=True)),
    ]
    return {
        "offset": at,
        "size": RECORD_SIZE,
        "kind": "record",
        "direction": "from sensor",
        "fields": fields,
        "problems": [],
    }


def _field(name: str, value: int, unit: str, meaning: str) -> dict[str, object]:
    return {"name": name, "raw": value, "value": value, "unit": unit, "mark": "observed", "meaning": meaning}
