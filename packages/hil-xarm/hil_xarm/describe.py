"""Description of frames of the command channel and of reports, of either direction."""

from collections.abc import Iterator, Mapping
from typing import Any

from hil_xarm.codes import error_text
from hil_xarm.frames import HEARTBEAT, MODBUS, Bit, Frame, FrameReader, Function, frames_in, unpack_floats
from hil_xarm.reports import LAYOUTS, reports_in
from protocol.endpoint import RemoteProtocolError

_TO_ROBOT, _FROM_ROBOT = "to robot", "from robot"
_REQUEST_FLOATS: Mapping[int, tuple[str, int, str]] = {
    Function.SERVO_JOINTS: ("joints", 7, "rad"),
    Function.SERVO_POSE: ("pose", 6, "mm, rad"),
    Function.MOVE_LINE: ("pose", 6, "mm, rad"),
    Function.MOVE_JOINTS: ("joints", 7, "rad"),
    Function.TCP_OFFSET: ("tcp_offset", 6, "mm, rad"),
    Function.LOAD: ("load", 4, "kg, mm"),
}
_REPLY_FLOATS: Mapping[int, tuple[str, int, str]] = {
    Function.POSE: ("pose", 6, "mm, rad"),
    Function.JOINTS: ("joints", 7, "rad"),
    Function.FORCE: ("force", 6, "N, N·m"),
}
_GETTERS = (Function.VERSION, Function.SERIALS, Function.STATE, Function.QUEUE, Function.ERROR)
_NO_DATA = (*_GETTERS, Function.POSE, Function.JOINTS, Function.CLEAR_ERROR, Function.CLEAR_WARNING)
_DATA_BYTES: Mapping[int, tuple[int, ...]] = {
    **dict.fromkeys(_NO_DATA, (0,)),
    Function.ENABLE: (2,),
    Function.SET_STATE: (1,),
    Function.SET_MODE: (1, 2),
    Function.SERVO_JOINTS: (40,),
    Function.SERVO_POSE: (36,),
    Function.FORCE: (0, 1),
    Function.FORCE_ENABLE: (1,),
    Function.FORCE_ZERO: (0,),
}
"""Numbers of data bytes of a request. A reply has the state as its first data byte."""
_LARGEST = 7
"""Largest mode, state or switch in a request with one byte of data. A larger byte is the state of a reply. A smaller
one can be either, because the bits of a state are 8 and more, or none.
"""


def describe(raw: bytes) -> list[dict[str, Any]]:
    """Describe part of a stream as items with `offset`, `size`, `kind` ("message" or "noise"), `message`, `direction`,
    `fields` and `problems`. Never raises.
    """
    is_report = raw[:2] == b"\0\0" and int.from_bytes(raw[:4], "big") in LAYOUTS
    parts, read = (reports_in(raw), _report) if is_report else (frames_in(raw), _frame)
    items, offset = [], 0
    for part in parts:
        try:
            item = read(part)
        except RemoteProtocolError as error:
            item = {"kind": "noise", "fields": [], "problems": [str(error)]}
        items.append({"offset": offset, "size": len(part), **item})
        offset += len(part)
    return items


def _report(raw: bytes) -> dict[str, Any]:
    layout = LAYOUTS.get(len(raw))
    if layout is None:
        raise RemoteProtocolError(f"part of a report: {len(raw)} bytes")
    values, fields = layout.decode(raw), []
    for field in layout.fields:
        if field.name.startswith("reserved"):
            continue
        value = values[field.name]
        fields.append(_field(field.name, value[0] if field.length == 1 else list(value), field.unit))
    error = int(values.get("error", (0,))[0])
    return _message(layout.name, _FROM_ROBOT, fields, [error_text(error)] if error else [])


def _frame(raw: bytes) -> dict[str, Any]:
    frames = list(FrameReader().feed(raw))
    if len(frames) != 1:
        raise RemoteProtocolError(f"part of a frame: {len(raw)} bytes")
    frame = frames[0]
    if frame.protocol == HEARTBEAT:
        return _message("heartbeat", _TO_ROBOT, [], [])
    if frame.protocol == MODBUS:
        fields = [_field("unit", frame.body[0]), _field("pdu", frame.body[1:].hex())]
        return _message("Modbus", "", fields, [])
    return _reply(frame) if _is_reply(frame) else _request(frame)


def _is_reply(frame: Frame) -> bool:
    """Return whether a frame is a reply: its data do not have the length of a request of this function, or its only
    byte can be a state alone.
    """
    length = len(frame.body) - 1
    if _is_ambiguous(frame):
        return False
    known = _DATA_BYTES.get(frame.body[0])
    return length == 1 if known is None else length not in known or (length == 1 and 1 in known)


def _is_ambiguous(frame: Frame) -> bool:
    """Return whether a frame can be a request or a reply."""
    known = _DATA_BYTES.get(frame.body[0], ())
    return len(frame.body) == 2 and 1 in known and frame.body[1] <= _LARGEST


def _request(frame: Frame) -> dict[str, Any]:
    request = frame.as_request()
    fields = [_field("transaction", request.transaction)]
    fields += _values(request.function, request.data, _REQUEST_FLOATS)
    if _is_ambiguous(frame):
        return _message(f"{_name(request.function)}, or its reply", "", fields, [])
    return _message(_name(request.function), _TO_ROBOT, fields, [])


def _reply(frame: Frame) -> dict[str, Any]:
    reply = frame.as_reply()
    bits = [bit.name.lower().replace("_", " ") for bit in Bit if reply.state & bit and bit.name]
    fields = [_field("transaction", reply.transaction), _field("state", ", ".join(bits) or "ready")]
    fields += _values(reply.function, reply.data, _REPLY_FLOATS)
    if reply.function == Function.ERROR and reply.data and reply.data[0]:
        bits.append(error_text(reply.data[0]))
    problems = [bit for bit in bits if bit not in ("not ready", "warning")]
    return _message(f"reply to {_name(reply.function)}", _FROM_ROBOT, fields, problems)


def _values(
    function: int, data: bytes, floats: Mapping[int, tuple[str, int, str]]
) -> Iterator[dict[str, Any]]:
    if function in floats and data:
        name, count, unit = floats[function]
        yield _field(name, list(unpack_floats(data, count)), unit)
    elif function in (Function.VERSION, Function.SERIALS) and data:
        yield _field("text", data.rstrip(b"\0").replace(b"\0", b" ").decode("ascii", "replace"))
    elif data:
        yield _field("data", data.hex())


def _name(function: int) -> str:
    return Function(function).label if function in tuple(Function) else f"function {function}"


def _field(name: str, value: Any, unit: str = "") -> dict[str, Any]:
    return {"name": name, "value": value, "unit": unit}


def _message(name: str, direction: str, fields: list[Any], problems: list[str]) -> dict[str, Any]:
    return {
        "kind": "message",
        "message": name,
        "direction": direction,
        "fields": fields,
        "problems": problems,
    }
