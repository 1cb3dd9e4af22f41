"""Robotiq FT 300: a stream of messages or Modbus RTU over a serial line, or text from the vendor's URCap over TCP."""

from protocol.devices.ft300.client import Ft300Client
from protocol.devices.ft300.describe import describe
from protocol.devices.ft300.messages import BAUDRATE, PERIOD_S, STOP, decode_message, encode_message
from protocol.devices.ft300.profile import Ft300ClientProfile
from protocol.devices.ft300.urcap import URCAP_PORT, describe_texts, encode_text
from protocol.devices.ft300.urcap_client import UrcapClient

__all__ = [
    "BAUDRATE",
    "PERIOD_S",
    "STOP",
    "URCAP_PORT",
    "Ft300Client",
    "Ft300ClientProfile",
    "UrcapClient",
    "decode_message",
    "describe",
    "describe_texts",
    "encode_message",
    "encode_text",
]
