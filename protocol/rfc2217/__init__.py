"""Serial port over TCP: Telnet with the COM port control option (RFC 2217), client and server.

References: RFC 854 and 855 (Telnet), RFC 856 (binary transmission), RFC 858 (suppress go-ahead), RFC 2217 (COM port
control).
"""

from protocol.rfc2217.client import ComPortClient, PortFailed, PortReady
from protocol.rfc2217.com_port import (
    Command,
    ComParity,
    Control,
    LineState,
    PortSettings,
    StopSize,
    decode_command,
    encode_command,
)
from protocol.rfc2217.server import BreakSet, ComPortServer, SettingsChanged
from protocol.rfc2217.session import LineStateChanged, Malformed, SerialData
from protocol.rfc2217.telnet import (
    Garbled,
    Negotiation,
    Option,
    Payload,
    Subnegotiation,
    TelnetReader,
    Verb,
    escaped,
    negotiation,
    subnegotiation,
)

__all__ = [
    "BreakSet",
    "ComParity",
    "ComPortClient",
    "ComPortServer",
    "Command",
    "Control",
    "Garbled",
    "LineState",
    "LineStateChanged",
    "Malformed",
    "Negotiation",
    "Option",
    "Payload",
    "PortFailed",
    "PortReady",
    "PortSettings",
    "SerialData",
    "SettingsChanged",
    "StopSize",
    "Subnegotiation",
    "TelnetReader",
    "Verb",
    "decode_command",
    "encode_command",
    "escaped",
    "negotiation",
    "subnegotiation",
]
