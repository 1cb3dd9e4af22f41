"""Description of the frames of a NETCANOEM board as plain values for display."""

from protocol.can.text import parse_frame
from protocol.devices.ati_can.messages import LAYOUTS, Op, decode_counts, decode_pair, decode_units
from protocol.endpoint import RemoteProtocolError

_ANSWERS_ALONE = {Op.SAMPLE_REST, Op.ROW_MIDDLE, Op.ROW_END}
_CHECKED = {**dict.fromkeys((Op.ROW, Op.ROW_MIDDLE, Op.ROW_END), decode_pair), Op.COUNTS: decode_counts}
"""Decoders that reject some values, by the operation of the response."""


def describe(raw: bytes) -> list[dict[str, object]]:
    """Describe one frame: two bytes of identifier, high byte first, followed by the data, or ASCII in candump
    format, `200#`.
    """
    if b"#" in raw[3:9]:
        try:
            frame = parse_frame(raw.decode("ascii"))
        except ValueError as error:
            return [_item(raw, None, [], [str(error)])]
        number, data = frame.identifier, frame.data
    elif 2 <= len(raw) <= 10:
        number, data = int.from_bytes(raw[:2], "big"), raw[2:]
    else:
        return [_item(raw, None, [], ["a frame has an identifier of two bytes and at most 8 bytes of data"])]
    if number > 0x7FF:
        return [_item(raw, number, [], ["the identifier has more than 11 bits"])]
    try:
        op = Op(number & 0xF)
    except ValueError:
        return [_item(raw, number, [], [f"{number & 0xF:X} is not an operation"])]
    try:
        return [_item(raw, number, _fields(op, data), [])]
    except RemoteProtocolError as error:
        return [_item(raw, number, [], [str(error)])]


def _fields(op: Op, data: bytes) -> list[dict[str, object]]:
    """Return the fields of a response, or the bytes of a request."""
    layout = LAYOUTS.get(op)
    longest_question = -1 if op in _ANSWERS_ALONE else 1 if op is Op.ROW else 0
    if layout is None or len(data) <= longest_question:
        return [_field("byte", byte, byte, "") for byte in data]
    if op is Op.UNITS:
        units = zip(("force", "torque"), data, decode_units(data), ("N", "N·m"), strict=True)
        return [_field(name, code, unit, f"{si} for one") for name, code, unit, si in units]
    if read := _CHECKED.get(op):
        read(data)
    layout.unpack_exact(data)
    return layout.describe(data)


def _item(
    raw: bytes, number: int | None, fields: list[dict[str, object]], problems: list[str]
) -> dict[str, object]:
    item: dict[str, object] = {"offset": 0, "size": len(raw), "kind": "frame", "identifier": None, "op": None}
    if number is not None and number <= 0x7FF:
        item["identifier"] = f"{number:03X}"
        item["op"] = next((op.name.lower().replace("_", " ") for op in Op if op == number & 0xF), None)
    return item | {"fields": fields, "problems": problems}


def _field(name: str, raw: float, value: float, meaning: str) -> dict[str, object]:
    return {"name": name, "raw": raw, "value": value, "unit": "", "mark": "observed", "meaning": meaning}
