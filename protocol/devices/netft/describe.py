"""Description of the datagrams of a Net F/T as plain values for display."""

from protocol.devices.netft.page import parse_page
from protocol.devices.netft.records import (
    AXIA,
    BUFFER_LIMIT,
    RECORD,
    RECORD_SIZE,
    REQUEST,
    Command,
    decode_request,
)
from protocol.endpoint import RemoteProtocolError
from protocol.wrench import AXES

_LONGEST_REQUEST = 14
"""Maximum number of bytes in a request. A longer text is the reason why the page is missing, as stored in a
recording.
"""


def describe(raw: bytes) -> list[dict[str, object]]:
    """Describe one datagram of either direction: a request, records, or the page. Other data is described as a
    problem.
    """
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
            problems.append(f"{request.command:04X} is not a command")
        fields = REQUEST.describe(raw)[1:]
        fields[0] |= {"raw": request.command, "value": request.command}
    return [item | {"fields": fields, "problems": problems}]


def _page(raw: bytes) -> dict[str, object]:
    item = {"offset": 0, "size": len(raw), "kind": "page", "direction": "from sensor"}
    try:
        configuration = parse_page(raw)
    except RemoteProtocolError as error:
        return item | {"fields": [], "problems": [str(error)]}
    fields: list[dict[str, object]] = [
        {
            "name": name,
            "raw": scale,
            "value": scale,
            "unit": unit,
            "mark": "observed",
            "meaning": "per count",
        }
        for name, scale, unit in zip(AXES, configuration.scales, ("N",) * 3 + ("N·m",) * 3, strict=True)
    ]
    return item | {"fields": fields, "problems": []}


def _record(raw: bytes, at: int) -> dict[str, object]:
    """Describe a record. A record does not name the sensor's family, so a status other than 0 is described for both
    families.
    """
    fields = RECORD.describe(raw)
    place = next(number for number, field in enumerate(fields) if field["name"] == "status")
    status = fields[place]
    if status["raw"]:
        text = AXIA.words(int(str(status["raw"])))
        fields.insert(place + 1, {**status, "name": "status of an Axia", "meaning": text})
    return {
        "offset": at,
        "size": RECORD_SIZE,
        "kind": "record",
        "direction": "from sensor",
        "fields": fields,
        "problems": [],
    }
