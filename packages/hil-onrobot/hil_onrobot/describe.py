"""Description of the data of an OnRobot HEX as plain values for display."""

from hil_onrobot.messages import RECORD, Command, decode_request
from protocol.devices.netft.records import REQUEST
from protocol.endpoint import RemoteProtocolError
from protocol.marks import Mark


def describe(raw: bytes) -> list[dict[str, object]]:
    """Describe a datagram of either direction. Other data are described as a problem."""
    item: dict[str, object] = {"offset": 0, "size": len(raw), "problems": []}
    if len(raw) == RECORD.size:
        return [item | {"kind": "record", "direction": "from sensor", "fields": RECORD.describe(raw)}]
    item |= {"kind": "request", "direction": "to sensor", "fields": []}
    try:
        request = decode_request(raw)
    except RemoteProtocolError as error:
        return [item | {"problems": [str(error)]}]
    known = request.command in Command._value2member_map_
    _, _, data = REQUEST.unpack_row(raw)
    field = {
        "name": "value",
        "raw": data,
        "value": request.value,
        "unit": "",
        "mark": Mark.OBSERVED.value,
        "meaning": "" if data == request.value else "the device uses the low half",
    }
    problems = [] if known else [f"{request.command:04X} is not a known command"]
    op = Command(request.command).label if known else f"{request.command:04X}"
    return [item | {"op": op, "fields": [field], "problems": problems}]
