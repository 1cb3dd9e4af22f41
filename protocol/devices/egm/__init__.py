"""Externally Guided Motion of an ABB robot: its datagrams, and the client that guides it."""

from protocol.devices.egm.client import EgmClient
from protocol.devices.egm.describe import describe
from protocol.devices.egm.joint_unit import JointCheck, JointUnit
from protocol.devices.egm.messages import (
    Answer,
    Guidance,
    Motors,
    PathCorrection,
    Place,
    PoseMm,
    Rapid,
    RobotMessage,
    SensorMessage,
    decode_answer,
    decode_robot,
    encode_answer,
    encode_robot,
    names_external_axes,
)
from protocol.devices.egm.schema import RobotWare
from protocol.devices.egm.units import from_wire, to_wire

__all__ = [
    "Answer",
    "EgmClient",
    "Guidance",
    "JointCheck",
    "JointUnit",
    "Motors",
    "PathCorrection",
    "Place",
    "PoseMm",
    "Rapid",
    "RobotMessage",
    "RobotWare",
    "SensorMessage",
    "decode_answer",
    "decode_robot",
    "describe",
    "encode_answer",
    "encode_robot",
    "from_wire",
    "names_external_axes",
    "to_wire",
]
