"""Textual description of EGM datagrams of either direction."""

from collections.abc import Iterator
from typing import Any

from google.protobuf.message import DecodeError

from protocol.devices.egm.messages import (
    DNUM_MAX,
    VALUES_MAX,
    Answer,
    MessageType,
    RobotMessage,
    decode_answer,
    decode_robot,
)
from protocol.devices.egm.schema import RobotWare, message_class
from protocol.endpoint import RemoteProtocolError

_NAMES = {
    MessageType.DATA: ("EgmRobot", "from robot"),
    MessageType.CORRECTION: ("EgmSensor", "to robot"),
    MessageType.PATH_CORRECTION: ("EgmSensorPathCorr", "to robot"),
}
_UNITS: tuple[tuple[str, str], ...] = (
    ("header.tm", "ms"),
    ("pathCorr.age", "ms"),
    ("time.sec", "s"),
    ("time.usec", "µs"),
    ("timeStamp.sec", "s"),
    ("timeStamp.nsec", "ns"),
    ("utilizationRate", "%"),
    ("measuredForce.force", "N, N·m"),
    ("speedRef.cartesians.value", "mm/s, °/s"),
    ("speedRef.joints.joints", "°/s"),
    ("externalJoints.joints", "° or mm"),
    ("joints.joints", "°"),
    ("euler.", "°"),
    ("pos.", "mm"),
)
"""Unit of a field, by a part of the field's path. The first match applies."""


def describe(raw: bytes) -> list[dict[str, Any]]:
    """Describe a datagram as a list with one item: `offset`, `size`, `kind` ("message" or "noise"), and for a
    message `message`, `direction`, `fields` with units, and `problems`. Never raises, regardless of the contents.
    """
    message, kind = _read(raw)
    if message is None or kind not in _NAMES:
        return [
            {
                "offset": 0,
                "size": len(raw),
                "kind": "noise",
                "meaning": "not an EGM datagram, or a damaged or truncated one",
                "bytes": raw.hex(" ").upper(),
            }
        ]
    name, direction = _NAMES[MessageType(kind)]
    return [
        {
            "offset": 0,
            "size": len(raw),
            "kind": "message",
            "message": name,
            "direction": direction,
            "fields": list(_fields(message, "")),
            "problems": list(_problems(raw, kind)),
        }
    ]


def _read(raw: bytes) -> tuple[Any, int]:
    """Decode the message and return it with its type, which its header names; None if the bytes are not a message."""
    for name in ("EgmSensor", "EgmRobot", "EgmSensorPathCorr"):
        message = _parse(name, raw)
        if message is None or _NAMES.get(message.header.mtype, ("",))[0] != name:
            continue
        if name == "EgmRobot" and not message.measuredForce.ListFields():
            message = _parse(name, raw, RobotWare.RW6_10) or message
        return message, message.header.mtype
    return None, MessageType.UNDEFINED


def _parse(name: str, raw: bytes, version: RobotWare = RobotWare.RW7) -> Any:
    message = message_class(name, version)()
    try:
        message.ParseFromString(bytes(raw))
    except DecodeError:
        return None
    return message


def _fields(message: Any, path: str) -> Iterator[dict[str, object]]:
    """Return every field present in the message, in order."""
    for field, value in message.ListFields():
        name = f"{path}{field.name}"
        if field.message_type is not None:
            yield from _fields(value, f"{name}.")
            continue
        text: object = value
        if field.enum_type is not None:
            text = field.enum_type.values_by_number[value].name
        elif not isinstance(value, (bool, int, float)):
            text = list(value)
        yield {"name": name, "value": text, "unit": _unit(name)}


def _unit(name: str) -> str:
    return next((unit for part, unit in _UNITS if part in name), "")


def _problems(raw: bytes, kind: int) -> Iterator[str]:
    try:
        message: RobotMessage | Answer = decode_robot(raw) if kind == MessageType.DATA else decode_answer(raw)
    except RemoteProtocolError as error:
        yield f"it is ignored: {error}"
        return
    if isinstance(message, RobotMessage):
        yield from _robot_problems(message)


def _robot_problems(message: RobotMessage) -> Iterator[str]:
    """Return the missing parts without which abb_libegm does not answer at all [O:lib]."""
    for name, place in (("feedBack", message.feedback), ("planned", message.planned)):
        if place is None or place.pose is None:
            yield f"{name} holds no pose: no client can guide the robot with it"
        elif len(place.joints_deg) != VALUES_MAX:
            yield f"{name} holds {len(place.joints_deg)} joints, not {VALUES_MAX}: abb_libegm does not answer"
    if message.feedback is not None and message.feedback.time_us is None:
        yield "feedBack holds no time: RobotWare before 6.07, of which some readings are in rad"
    if len(message.dnum) > DNUM_MAX:
        yield f"RAPIDfromRobot holds {len(message.dnum)} numbers, more than {DNUM_MAX}"
