"""Frames of a NETCANOEM board as plain values, for people to read."""

from protocol.can.text import parse_frame
from protocol.devices.ati_can.messages import (
    Op,
    decode_counts,
    decode_firmware,
    decode_pair,
    decode_sample,
    decode_sample_rest,
    decode_units,
    status_words,
)
from protocol.endpoint import RemoteProtocolError


def describe(raw: bytes) -> list[dict[str, object]]:
    """One frame: its identifier in two bytes, high byte first, and its data; or ASCII as candump writes it, `200#`."""
    if b"#" in raw[3:9]:
        try:
            frame = parse_frame(raw.decode("ascii"))
        except ValueError as error:
            return [_made(raw, None, [], [str(error)])]
        number, data = frame.identifier, frame.data
    elif 2 <= len(raw) <= 10:
        number, data = int.from_bytes(raw[:2], "big"), raw[2:]
    else:
        return [_made(raw, None, [], ["a frame has an identifier of two bytes and at most 8 bytes of data"])]
    if number > 0x7FF:
        return [_made(raw, number, [], ["the identifier has more than 11 bits"])]
    try:
        op = Op(number & 0xF)
    except ValueError:
        return [_made(raw, number, [], [f"{number & 0xF:X} is no operation"])]
    try:
        return [_made(raw, number, _fields(op, data), [])]
    except RemoteProtocolError as error:
        return [_made(raw, number, [], [str(error)])]


def _fields(op: Op, data: bytes) -> list[dict[str, object]]:
    """Fields of an answer; of a question its bytes."""
    if op is Op.SAMPLE and data:
        start = decode_sample(data)
        gages = zip((0, 2, 4), start.gages, strict=True)
        status = _field("status", start.status, start.status, status_words(start.status) or "no error")
        return [status, *(_field(f"sg{k}", gage, gage, "strain gage") for k, gage in gages)]
    if op is Op.SAMPLE_REST:
        gages = zip((1, 3, 5), decode_sample_rest(data), strict=True)
        return [_field(f"sg{k}", gage, gage, "strain gage") for k, gage in gages]
    if op in (Op.ROW_MIDDLE, Op.ROW_END) or (op is Op.ROW and len(data) > 1):
        first = 2 * (op - Op.ROW)
        return [
            _field(f"sg{first + k}", value, value, "coefficient") for k, value in enumerate(decode_pair(data))
        ]
    if op is Op.COUNTS and data:
        force, torque = decode_counts(data)
        return [_field("per force", force, force, "counts"), _field("per torque", torque, torque, "counts")]
    if op is Op.UNITS and data:
        units = decode_units(data)
        return [
            _field("force", data[0], units[0], "N for one"),
            _field("torque", data[1], units[1], "N·m for one"),
        ]
    if op is Op.FIRMWARE and data:
        return [
            _field(name, part, part, "")
            for name, part in zip(("major", "minor", "build"), decode_firmware(data), strict=True)
        ]
    return [_field("byte", byte, byte, "") for byte in data]


def _made(
    raw: bytes, number: int | None, fields: list[dict[str, object]], problems: list[str]
) -> dict[str, object]:
    item: dict[str, object] = {"offset": 0, "size": len(raw), "kind": "frame", "identifier": None, "op": None}
    if number is not None and number <= 0x7FF:
        item["identifier"] = f"{number:03X}"
        item["op"] = next((op.name.lower().replace("_", " ") for op in Op if op == number & 0xF), None)
    return item | {"fields": fields, "problems": problems}


def _field(name: str, raw: float, value: float, meaning: str) -> dict[str, object]:
    return {"name": name, "raw": raw, "value": value, "unit": "", "mark": "observed", "meaning": meaning}
