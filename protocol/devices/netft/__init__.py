"""ATI Net F/T: records over UDP (RDT) and a configuration page over HTTP.

Values come from the sources of the specification and carry their marks. The TCP interface with 16-bit values is not
supported.
"""

from protocol.devices.netft.client import NetFtClient
from protocol.devices.netft.describe import describe
from protocol.devices.netft.page import PAGE, parse_page
from protocol.devices.netft.profile import NetFtClientProfile
from protocol.devices.netft.records import (
    Command,
    Record,
    decode_record,
    encode_record,
    encode_request,
)

__all__ = [
    "PAGE",
    "Command",
    "NetFtClient",
    "NetFtClientProfile",
    "Record",
    "decode_record",
    "describe",
    "encode_record",
    "encode_request",
    "parse_page",
]
