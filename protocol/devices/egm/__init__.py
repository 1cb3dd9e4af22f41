"""Externally Guided Motion (EGM) of an ABB robot: its messages, and the client that guides the robot."""

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
    has_external_axes,
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
    "has_external_axes",
    "to_wire",
]
