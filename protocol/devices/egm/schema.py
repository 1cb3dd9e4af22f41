"""Protocol Buffers 2 messages of ABB's Externally Guided Motion, as two separate descriptor pools.

RobotWare 6 and 7 encode the measured force differently, and RobotWare 7 has more fields. Each schema has its own
pool, so neither clashes with a module that a plug-in has generated from ABB's file. Both schemas skip unknown
fields.

Source of the field names and numbers: `proto/egm.proto` of abb_libegm [O:lib] for RobotWare 6.10, ABBRobotEGM 1.0.7
[O:flo] for RobotWare 7.
"""

from enum import StrEnum
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory


class RobotWare(StrEnum):
    """Version of the controller software that determines the messages."""

    RW6_06 = "6.06"
    """Lacks the time of a position and the utilisation rate."""
    RW6_10 = "6.10"
    RW7 = "7"
    """Adds the move index, collision and RAPID data, and encodes the measured force differently."""


_PACKAGE = "abb.egm"
_LABELS = {"o": 1, "q": 2, "r": 3}
"""Numbers of the field labels in a descriptor: optional, required, repeated."""
_TYPES = {"double": 1, "uint64": 4, "bool": 8, "uint32": 13}
"""Numbers of the field types in a descriptor. Any other type name is a message or an enumeration."""
_ENUM, _MESSAGE = 14, 11

_ENUMS = {
    "EgmHeader.MessageType": (
        "MSGTYPE_UNDEFINED",
        "MSGTYPE_COMMAND",
        "MSGTYPE_DATA",
        "MSGTYPE_CORRECTION",
        "MSGTYPE_PATH_CORRECTION",
    ),
    "EgmMotorState.MotorStateType": ("MOTORS_UNDEFINED", "MOTORS_ON", "MOTORS_OFF"),
    "EgmMCIState.MCIStateType": ("MCI_UNDEFINED", "MCI_ERROR", "MCI_STOPPED", "MCI_RUNNING"),
    "EgmRapidCtrlExecState.RapidCtrlExecStateType": ("RAPID_UNDEFINED", "RAPID_STOPPED", "RAPID_RUNNING"),
}
"""Names of the enumeration values, numbered from 0, by the message that contains the enumeration."""

_BOTH = {
    "EgmHeader": "1o uint32 seqno, 2o uint32 tm, 3o EgmHeader.MessageType mtype",
    "EgmCartesian": "1q double x, 2q double y, 3q double z",
    "EgmQuaternion": "1q double u0, 2q double u1, 3q double u2, 4q double u3",
    "EgmEuler": "1q double x, 2q double y, 3q double z",
    "EgmClock": "1q uint64 sec, 2q uint64 usec",
    "EgmPose": "1o EgmCartesian pos, 2o EgmQuaternion orient, 3o EgmEuler euler",
    "EgmCartesianSpeed": "1r double value",
    "EgmJoints": "1r double joints",
    "EgmSpeedRef": "1o EgmJoints joints, 2o EgmCartesianSpeed cartesians, 3o EgmJoints externalJoints",
    "EgmPathCorr": "1q EgmCartesian pos, 2q uint32 age",
    "EgmMotorState": "1q EgmMotorState.MotorStateType state",
    "EgmMCIState": "1q EgmMCIState.MCIStateType state",
    "EgmRapidCtrlExecState": "1q EgmRapidCtrlExecState.RapidCtrlExecStateType state",
    "EgmTestSignals": "1r double signals",
    "EgmSensorPathCorr": "1o EgmHeader header, 2o EgmPathCorr pathCorr",
}
_PLACE = "1o EgmJoints joints, 2o EgmPose cartesian, 3o EgmJoints externalJoints, 4o EgmClock time"
_ROBOT = (
    "1o EgmHeader header, 2o EgmFeedBack feedBack, 3o EgmPlanned planned, 4o EgmMotorState motorState, "
    "5o EgmMCIState mciState, 6o bool mciConvergenceMet, 7o EgmTestSignals testSignals, "
    "8o EgmRapidCtrlExecState rapidExecState, 9o EgmMeasuredForce measuredForce, 10o double utilizationRate"
)
_SENSOR = "1o EgmHeader header, 2o EgmPlanned planned, 3o EgmSpeedRef speedRef"
_RW6 = {
    **_BOTH,
    "EgmPlanned": _PLACE,
    "EgmFeedBack": _PLACE,
    "EgmMeasuredForce": "1r double force",
    "EgmRobot": _ROBOT,
    "EgmSensor": _SENSOR,
}
_RW7 = {
    **_BOTH,
    "EgmTimestamp": "1o uint64 sec, 2o uint64 nsec",
    "EgmPlanned": f"{_PLACE}, 5o EgmTimestamp timeStamp",
    "EgmFeedBack": f"{_PLACE}, 5o EgmTimestamp timeStamp",
    "EgmMeasuredForce": "1o bool fcActive, 2r double force",
    "EgmCollisionInfo": "1o bool collsionTriggered, 2r double collDetQuota",  # spelling as in ABB's file
    "EgmRAPIDdata": "1o bool digVal, 2r double dnum",
    "EgmRobot": f"{_ROBOT}, 11o uint32 moveIndex, 12o EgmCollisionInfo CollisionInfo, "
    "13o EgmRAPIDdata RAPIDfromRobot, 14o EgmJoints torqueRef",
    "EgmSensor": f"{_SENSOR}, 4o EgmRAPIDdata RAPIDtoRobot",
}
"""Fields of each message: number, followed by o, q or r for optional, required or repeated; type; name."""


def _classes(messages: dict[str, str]) -> dict[str, Any]:
    """Create a class for each message in a separate descriptor pool."""
    file = descriptor_pb2.FileDescriptorProto(name="egm.proto", package=_PACKAGE, syntax="proto2")
    for name, fields in messages.items():
        message = file.message_type.add(name=name)
        for field in fields.split(", "):
            number, kind, called = field.split()
            one = message.field.add(name=called, number=int(number[:-1]))
            one.label = _LABELS[number[-1]]  # type: ignore[assignment]
            one.type = _TYPES.get(kind, _ENUM if kind in _ENUMS else _MESSAGE)  # type: ignore[assignment]
            if kind not in _TYPES:
                one.type_name = f".{_PACKAGE}.{kind}"
        for enumeration, names in _ENUMS.items():
            holder, _, called = enumeration.partition(".")
            if holder == name:
                numbered = message.enum_type.add(name=called)
                for number_, word in enumerate(names):
                    numbered.value.add(name=word, number=number_)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {
        name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.{name}"))
        for name in messages
    }


_CLASSES = {"6": _classes(_RW6), "7": _classes(_RW7)}


def message_class(name: str, version: RobotWare = RobotWare.RW7) -> Any:
    """Return the class of a message in the schema of a RobotWare version."""
    return _CLASSES["7" if version is RobotWare.RW7 else "6"][name]
