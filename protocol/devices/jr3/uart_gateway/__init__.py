"""UART gateway of a JR3 sensor: its frames and the client session."""

from protocol.devices.jr3.gateway_session import Phase
from protocol.devices.jr3.uart_gateway.client import UartGatewayClient
from protocol.devices.jr3.uart_gateway.describe import describe
from protocol.devices.jr3.uart_gateway.messages import (
    COMMANDS,
    DATA_FRAME_S,
    FROM_GATEWAY,
    UART_BAUDRATE,
    Acknowledge,
    Command,
    Data,
    Frame,
    Op,
    decode_acknowledge,
    decode_command,
    decode_data,
    encode_acknowledge,
    encode_command,
    encode_data,
)
from protocol.devices.jr3.uart_gateway.profile import UartGatewayClientProfile
from protocol.devices.jr3.uart_gateway.reader import Reader

__all__ = [
    "COMMANDS",
    "DATA_FRAME_S",
    "FROM_GATEWAY",
    "UART_BAUDRATE",
    "Acknowledge",
    "Command",
    "Data",
    "Frame",
    "Op",
    "Phase",
    "Reader",
    "UartGatewayClient",
    "UartGatewayClientProfile",
    "decode_acknowledge",
    "decode_command",
    "decode_data",
    "describe",
    "encode_acknowledge",
    "encode_command",
    "encode_data",
]
