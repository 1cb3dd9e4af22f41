"""ARAP telegram, consisting of a header and data. Source: computer-link specification, section 3."""

from typing import NamedTuple

from protocol.devices.s3.adlp import HEADER_SIZE, LengthStyle
from protocol.devices.s3.arap.codes import FunctionCode, TelegramType, function_text, suffix_text, type_text
from protocol.devices.s3.arap.layouts import HEADER
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

FROM_PC = 1
"""Value of byte 2 in a telegram from the PC. Mark: observed."""
FROM_ROBOT = 0
"""Value of byte 2 in a telegram from the controller. Any value but 1 is accepted. Mark: observed."""


class Telegram(NamedTuple):
    """One telegram. Its function and type may be unknown; the receiver checks them."""

    function: int
    type: int
    suffix: int = 0
    data: bytes = b""
    from_robot: bool = False

    def encode(self, length_style: LengthStyle = "whole") -> bytes:
        """Encode the telegram. Only a PC may use a length field that counts only the data instead of the entire
        telegram.

        Raises LocalProtocolError if a number does not fit into its field.
        """
        if self.from_robot and length_style != "whole":
            raise LocalProtocolError("a telegram from the controller must state its entire length")
        length = len(self.data) + (HEADER_SIZE if length_style == "whole" else 0)
        source = FROM_ROBOT if self.from_robot else FROM_PC
        return HEADER.pack_row(length, source, 0, self.function, self.type, self.suffix) + self.data

    @classmethod
    def decode(cls, raw: bytes, from_robot: bool) -> "Telegram":
        """Decode the telegram in these bytes, which have a known direction.

        Raises RemoteProtocolError that says which byte is wrong and why.
        """
        if len(raw) < HEADER_SIZE:
            raise RemoteProtocolError(f"a telegram has at least {HEADER_SIZE} bytes, got {len(raw)}")
        length, source, destination, function, type_, suffix = HEADER.unpack_row(raw)
        if length != len(raw) and (from_robot or length + HEADER_SIZE != len(raw)):
            raise RemoteProtocolError(
                f"bytes 0–1: length {length} does not fit a telegram of {len(raw)} bytes"
            )
        if from_robot == (source == FROM_PC):
            expected = "the controller" if from_robot else "the PC"
            raise RemoteProtocolError(f"byte 2: source {source} is not {expected}")
        if destination != 0:
            raise RemoteProtocolError(f"byte 3: destination {destination} is not 0")
        return cls(function, type_, suffix, raw[HEADER_SIZE:], from_robot)

    def __str__(self) -> str:
        meaning = suffix_text(self.function, self.suffix)
        suffix = f" {self.suffix}" + (f" ({meaning})" if meaning else "")
        return (
            f"{function_text(self.function)}{suffix}, {type_text(self.type)}, {len(self.data)} bytes of data"
        )


def response(order: Telegram, data: bytes = b"") -> Telegram:
    """Create the controller's answer to an order. Assumed: its suffix is 0."""
    return Telegram(order.function, TelegramType.RESPONSE, 0, data, from_robot=True)


_READ_STATUS = Telegram(FunctionCode.READ_STATUS, TelegramType.ORDER)


def read_status() -> Telegram:
    """Create the query for position and state."""
    return _READ_STATUS


def stop_program() -> Telegram:
    """Create the order to stop the running program."""
    return Telegram(FunctionCode.STOP_PROGRAM, TelegramType.ORDER)
