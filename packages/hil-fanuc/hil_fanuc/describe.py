"""Textual description of packets of Stream Motion and of lines of the Remote Motion Interface, of either direction."""

from collections.abc import Iterator, Mapping
from typing import Any

from hil_fanuc import rmi
from hil_fanuc.packets import (
    CARTESIAN,
    Capability,
    Command,
    ContactStop,
    GpioRequest,
    GpioResult,
    Kind,
    Report,
    RobotStatus,
    Signal,
    Status,
    Threshold,
    ToClient,
    ToRobot,
    decode_to_client,
    decode_to_robot,
    header_of,
    is_finite,
)
from hil_fanuc.rmi import LineReader
from protocol.endpoint import RemoteProtocolError

_TO_ROBOT, _FROM_ROBOT = "to robot", "from robot"
_UNITS: Mapping[str, str] = {
    "pose": "mm, °",
    "joints": "°",
    "currents": "A",
    "time_s": "s",
    "wrench": "N, N·m",
    "speed_mm_s": "mm/s",
    "interval_ms": "ms",
    "sampling_ms": "ms",
}


def describe(raw: bytes) -> list[dict[str, Any]]:
    """Describe a datagram, or part of a stream of lines, as items with `offset`, `size`, `kind` ("message" or "noise"),
    `message`, `direction`, `fields` and `problems`. Never raises.
    """
    if raw[:1] in (b"{", b"\r", b"\n") or raw.rstrip().endswith(b"}"):
        return list(_lines(raw))
    try:
        kind = header_of(raw).kind
        packet, direction = _decode(raw)
    except RemoteProtocolError as error:
        return [_noise(raw, f"not a packet of Stream Motion: {error}")]
    return [
        {
            "offset": 0,
            "size": len(raw),
            "kind": "message",
            "message": f"{_name(packet)} (type {kind})",
            "direction": direction,
            "fields": list(_fields(packet)),
            "problems": list(_problems(packet)),
        }
    ]


def _decode(raw: bytes) -> tuple[ToRobot | ToClient, str]:
    """Decode a packet. A capability that names the sampling period is an answer; requests have 0 there."""
    try:
        answer = decode_to_client(raw)
    except RemoteProtocolError:
        return decode_to_robot(raw), _TO_ROBOT
    if isinstance(answer, Capability) and not answer.sampling_ms:
        return answer, _TO_ROBOT
    return answer, _FROM_ROBOT


def _name(packet: ToRobot | ToClient) -> str:
    match packet:
        case Signal(kind):
            return "stop" if kind == Kind.STOP else "start"
        case Capability(kind):
            return "capability" if kind == Kind.GET_CAPABILITY else "capability setting"
        case Command(moves=False):
            return "command without motion"
        case Command(data_style=style):
            return "command, pose" if style == CARTESIAN else "command, joints"
        case GpioRequest():
            return "GPIO configuration"
        case GpioResult():
            return "GPIO result"
        case _:
            words = "".join(f" {c.lower()}" if c.isupper() else c for c in type(packet).__name__)
            return words.strip()


def _fields(packet: ToRobot | ToClient) -> Iterator[dict[str, object]]:
    for name, value in packet._asdict().items():
        if name == "kind":
            continue
        text: object = list(value) if isinstance(value, tuple) else value
        if isinstance(packet, Report):
            text = _status_text(name, value, text)
        if isinstance(packet, Command) and name == "data_style":
            text = "0, pose" if value == CARTESIAN else f"0x{value:X}, joints"
        if isinstance(packet, GpioRequest) and name == "lines":
            text = [list(line) for line in packet.lines if line.command]
        unit = _UNITS.get(name, "")
        if isinstance(packet, Command) and name == "position":
            unit = "mm, °" if packet.data_style == CARTESIAN else "°"
        yield {"name": name, "value": text, "unit": unit}


def _status_text(name: str, value: Any, text: object) -> object:
    """Return the meaning of a status of a report."""
    if name == "status":
        return f"{_flags(Status(value & 15))}; rate {value >> 4}"
    if name == "robot_status":
        return _flags(RobotStatus(value & 7))
    if name == "contact_stop" and value in ContactStop._value2member_map_:
        return ContactStop(value).name.lower()
    return text


def _flags(flags: Status | RobotStatus) -> str:
    return ", ".join((one.name or "").lower().replace("_", " ") for one in flags) or "none"


def _problems(packet: ToRobot | ToClient) -> Iterator[str]:
    if isinstance(packet, Command) and not is_finite(packet.position):
        yield "the position contains numbers that are not finite"
    if isinstance(packet, Report) and not is_finite((*packet.pose, *packet.joints)):
        yield "pose or joints contain numbers that are not finite"
    if isinstance(packet, Threshold) and packet.axis > 9:
        yield f"axis {packet.axis} does not exist"


def _lines(raw: bytes) -> Iterator[dict[str, Any]]:
    at = 0
    for line in raw.splitlines(keepends=True):
        if not line.strip():
            at += len(line)
            continue
        try:
            (message,) = LineReader().feed(line.rstrip() + b"\n")
        except (RemoteProtocolError, ValueError) as error:
            yield _noise(line, f"not a line of the Remote Motion Interface: {error}", at)
        else:
            yield _line(message, line, at)
        at += len(line)


def _line(message: rmi.Message, line: bytes, at: int) -> dict[str, Any]:
    key, name = rmi.name_of(message)
    problems = []
    number = message.get("ErrorID")
    if isinstance(number, int) and number:
        problems.append(rmi.describe_error(number))
    is_push = name in ("FRC_SystemFault", "FRC_Terminate")
    return {
        "offset": at,
        "size": len(line),
        "kind": "message",
        "message": name or "line without a name",
        "direction": _FROM_ROBOT if "ErrorID" in message or is_push else _TO_ROBOT,
        "fields": [
            {"name": field, "value": value, "unit": ""} for field, value in message.items() if field != key
        ],
        "problems": problems,
    }


def _noise(raw: bytes, meaning: str, at: int = 0) -> dict[str, Any]:
    return {
        "offset": at,
        "size": len(raw),
        "kind": "noise",
        "meaning": meaning,
        "bytes": raw[:64].hex(" ").upper(),
        "fields": [],
        "problems": [],
    }
