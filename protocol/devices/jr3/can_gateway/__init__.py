"""CAN gateway of a JR3 sensor: its frames and the client session."""

from protocol.devices.jr3.can_gateway.client import GatewayClient
from protocol.devices.jr3.can_gateway.describe import describe, parse_frame
from protocol.devices.jr3.can_gateway.messages import (
    GATEWAY_BITRATE,
    Acknowledge,
    Command,
    Op,
    Triple,
    can_messages,
    client_filters,
    decode_acknowledge,
    decode_command,
    decode_triple,
    encode_acknowledge,
    encode_command,
    encode_sample,
    gateway_filters,
    identifier,
    split,
)
from protocol.devices.jr3.can_gateway.profile import GatewayClientProfile
from protocol.devices.jr3.gateway_session import Phase

__all__ = [
    "GATEWAY_BITRATE",
    "Acknowledge",
    "Command",
    "GatewayClient",
    "GatewayClientProfile",
    "Op",
    "Phase",
    "Triple",
    "can_messages",
    "client_filters",
    "decode_acknowledge",
    "decode_command",
    "decode_triple",
    "describe",
    "encode_acknowledge",
    "encode_command",
    "encode_sample",
    "gateway_filters",
    "identifier",
    "parse_frame",
    "split",
]
