"""A datagram of either direction put into words, for people to read."""

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
"""Units by a part of a field's path; the first that fits."""


def describe(raw: bytes) -> list[dict[str, Any]]:
    """One datagram, as one item: `offset`, `size`, `kind` ("message" or "noise"), and of a message `message`,
    `direction`, `fields` with units, and `problems`. Never raises for what the bytes are.
    """
    message, kind = _read(raw)
    if message is None or kind not in _NAMES:
        return [
            {
                "offset": 0,
                "size": len(raw),
                "kind": "noise",
                "meaning": "no datagram of EGM, or one that is damaged or cut off",
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
    """Return the message named by its header, and its type; None for bytes that are not a message."""
    for name in ("EgmSensor", "EgmRobot", "EgmSensorPathCorr"):
        message = _parsed(name, raw)
        if message is None or _NAMES.get(message.header.mtype, ("",))[0] != name:
            continue
        if name == "EgmRobot" and not message.measuredForce.ListFields():
            message = _parsed(name, raw, RobotWare.RW6_10) or message
        return message, message.header.mtype
    return None, MessageType.UNDEFINED


def _parsed(name: str, raw: bytes, version: RobotWare = RobotWare.RW7) -> Any:
    message = message_class(name, version)()
    try:
        message.ParseFromString(bytes(raw))
    except DecodeError:
        return None
    return message


def _fields(message: Any, path: str) -> Iterator[dict[str, object]]:
    """Every field that was sent, in order."""
    for field, value in message.ListFields():
        name = f"{path}{field.name}"
        if field.message_type is not None:
            yield from _fields(value, f"{name}.")
            continue
        shown: object = value
        if field.enum_type is not None:
            shown = field.enum_type.values_by_number[value].name
        elif not isinstance(value, (bool, int, float)):
            shown = list(value)
        yield {"name": name, "value": shown, "unit": _unit(name)}


def _unit(name: str) -> str:
    return next((unit for part, unit in _UNITS if part in name), "")


def _problems(raw: bytes, kind: int) -> Iterator[str]:
    try:
        message: RobotMessage | Answer = decode_robot(raw) if kind == MessageType.DATA else decode_answer(raw)
    except RemoteProtocolError as error:
        yield f"it is not heeded: {error}"
        return
    if isinstance(message, RobotMessage):
        yield from _robot_problems(message)


def _robot_problems(message: RobotMessage) -> Iterator[str]:
    """Parts for want of which abb_libegm gives no answer at all [O:lib]."""
    for name, place in (("feedBack", message.feedback), ("planned", message.planned)):
        if place is None or place.pose is None:
            yield f"{name} holds no pose: no client can guide by it"
        elif len(place.joints_deg) != VALUES_MAX:
            yield f"{name} holds {len(place.joints_deg)} joints, not {VALUES_MAX}: abb_libegm does not answer"
    if message.feedback is not None and message.feedback.time_us is None:
        yield "feedBack holds no time: RobotWare before 6.07, of which some readings are in rad"
    if len(message.dnum) > DNUM_MAX:
        yield f"RAPIDfromRobot holds {len(message.dnum)} numbers, more than {DNUM_MAX}"
