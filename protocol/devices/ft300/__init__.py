"""Robotiq FT 300: a stream of messages or Modbus RTU on one serial line."""

from protocol.devices.ft300.client import Ft300Client
from protocol.devices.ft300.describe import describe
from protocol.devices.ft300.messages import BAUDRATE, PERIOD_S, STOP, decode_message, encode_message
from protocol.devices.ft300.profile import Ft300ClientProfile

__all__ = [
    "BAUDRATE",
    "PERIOD_S",
    "STOP",
    "Ft300Client",
    "Ft300ClientProfile",
    "decode_message",
    "describe",
    "encode_message",
]
