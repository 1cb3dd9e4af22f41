"""Textual description of packets of the primary and the real-time interface."""

from collections.abc import Iterator
from typing import Any

from protocol.devices.rtde import primary, realtime
from protocol.devices.rtde.primary import BODIES, MessageKind, PacketType, ReportLevel
from protocol.devices.rtde.states import RobotMode, Runtime, SafetyMode, name_of
from protocol.endpoint import RemoteProtocolError
from protocol.fields import Field, describe_field

NAMED = {
    "robot_mode": RobotMode,
    "safety_mode": SafetyMode,
    "safety_status": SafetyMode,
    "runtime_state": Runtime,
    "level": ReportLevel,
}
"""Fields whose values have names, with the enumeration of these names."""


def packet_size(raw: bytes, at: int) -> int:
    """Return the length, in bytes, of a complete packet of the primary or real-time interface that starts here; 0
    if none does.

    A packet of RTDE starts with its length in two bytes, which are 0 in packets of these interfaces.
    """
    if at + primary.HEADER.size > len(raw):
        return 0
    size, kind = primary.HEADER.unpack_from(raw, at)
    if not size <= len(raw) - at:
        return 0
    if kind in (PacketType.STATE, PacketType.MESSAGE):
        return size if primary.HEADER.size <= size < primary.LONGEST else 0
    return size if size in realtime.LAYOUTS else 0


def describe_packet(packet: bytes) -> dict[str, Any]:
    """Describe a complete packet by `op`, `fields` and `problems`."""
    fields, problems = list[dict[str, Any]](), list[str]()
    kind = packet[primary.HEADER.size - 1]
    if kind not in (PacketType.STATE, PacketType.MESSAGE):
        layout = realtime.LAYOUTS[len(packet)].layout
        raw = layout.unpack(packet[realtime.HEADER.size :])
        fields += (_describe(field, raw[field.name]) for field in layout.fields)
        return {"op": "real-time state", "fields": fields, "problems": problems}
    body = packet[primary.HEADER.size :]
    op = "robot state"
    try:
        if kind == PacketType.STATE:
            fields += _describe_state(body, problems)
        else:
            message = primary.read_message(body)
            op = name_of(MessageKind, message.kind) + " message"
            fields += _describe_message(message, problems)
    except RemoteProtocolError as error:
        problems.append(str(error))
    return {"op": op, "fields": fields, "problems": problems}


def _describe_state(body: bytes, problems: list[str]) -> Iterator[dict[str, Any]]:
    for kind, data in primary.split(body):
        layout = next((layout for part, layout in primary.PARTS.items() if part == kind), None)
        if layout is None:
            problems.append(f"unknown part of type {kind} and {len(data)} bytes")
        elif len(data) < layout.size:
            problems.append(f"{layout.name} needs {layout.size} bytes, got {len(data)}")
        else:
            raw = layout.unpack(data)
            for field in layout.fields:
                item = _describe(field, raw[field.name])
                yield {**item, "name": f"{layout.name}: {field.name}"}


def _describe_message(message: primary.Message, problems: list[str]) -> Iterator[dict[str, Any]]:
    yield _text("time", message.time_ns, message.time_ns * 1e-9, "s")
    yield _text("source", message.source, message.source)
    read = primary.read_body(message)
    if read is None:
        problems.append(f"unknown message kind {message.kind}; {len(BODIES)} kinds are known")
        return
    for field, raw in read.fields:
        yield _describe(field, raw)
    for name, text in read.texts:
        yield _text(name, text, text)


def _describe(field: Field, raw: float) -> dict[str, Any]:
    item: dict[str, Any] = describe_field(field, raw)
    if field.name in NAMED:
        item["value"] = name_of(NAMED[field.name], raw)
    return item


def _text(name: str, raw: Any, value: Any, unit: str = "") -> dict[str, Any]:
    return {"name": name, "raw": raw, "value": value, "unit": unit, "mark": "observed", "meaning": ""}
