"""KUKA Robot Sensor Interface (RSI): telegrams, angles, and the client. Source: project specification of RSI."""

from protocol.devices.rsi.client import RsiClient
from protocol.devices.rsi.describe import describe
from protocol.devices.rsi.elements import axis_tags, pose_tags
from protocol.devices.rsi.ethernet_file import EthernetFile, read_ethernet_file
from protocol.devices.rsi.profile import RsiLink
from protocol.devices.rsi.telegram import (
    ROBOT,
    SENSOR,
    Telegram,
    decode,
    encode,
    fixed,
    number,
    numbers,
)

__all__ = [
    "ROBOT",
    "SENSOR",
    "EthernetFile",
    "RsiClient",
    "RsiLink",
    "Telegram",
    "axis_tags",
    "decode",
    "describe",
    "encode",
    "fixed",
    "number",
    "numbers",
    "pose_tags",
    "read_ethernet_file",
]
