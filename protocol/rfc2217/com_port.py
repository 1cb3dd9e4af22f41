"""The COM port control option: its commands, their values, and the settings of a serial port.

Reference: RFC 2217. All facts in this module are [standard].
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.rfc2217.telnet import Option, subnegotiation

FROM_SERVER = 100
"""Offset that a server adds to a command's code."""


class Command(IntEnum):
    """Command of the option, with the code that a client uses. RFC 2217 section 2."""

    SIGNATURE = 0
    SET_BAUDRATE = 1
    SET_DATASIZE = 2
    SET_PARITY = 3
    SET_STOPSIZE = 4
    SET_CONTROL = 5
    NOTIFY_LINESTATE = 6
    NOTIFY_MODEMSTATE = 7
    FLOWCONTROL_SUSPEND = 8
    FLOWCONTROL_RESUME = 9
    SET_LINESTATE_MASK = 10
    SET_MODEMSTATE_MASK = 11
    PURGE_DATA = 12


VALUE_BYTES: dict[Command, int] = dict.fromkeys(Command, 1) | {
    Command.SET_BAUDRATE: 4,
    Command.FLOWCONTROL_SUSPEND: 0,
    Command.FLOWCONTROL_RESUME: 0,
}
"""Size of a command's value in bytes, which are sent most significant byte first. SIGNATURE is missing, because its
text may have any length.
"""


class ComParity(IntEnum):
    """Value of SET-PARITY. 0 requests the current value."""

    NONE = 1
    ODD = 2
    EVEN = 3
    MARK = 4
    SPACE = 5


class StopSize(IntEnum):
    """Value of SET-STOPSIZE. 0 requests the current value."""

    ONE = 1
    TWO = 2
    ONE_AND_A_HALF = 3


class Control(IntEnum):
    """Value of SET-CONTROL."""

    ASK_FLOW = 0
    NO_FLOW = 1
    ASK_BREAK = 4
    BREAK_ON = 5
    BREAK_OFF = 6
    ASK_DTR = 7
    DTR_ON = 8
    DTR_OFF = 9
    ASK_RTS = 10
    RTS_ON = 11
    RTS_OFF = 12
    ASK_INBOUND_FLOW = 13
    NO_INBOUND_FLOW = 14


class LineState(IntFlag):
    """Bits of NOTIFY-LINESTATE and of its mask that report errors."""

    OVERRUN = 2
    PARITY = 4
    FRAMING = 8
    BREAK = 16


ERRORS = LineState.OVERRUN | LineState.PARITY | LineState.FRAMING | LineState.BREAK
READY_MODEM = 0xB0
"""Modem state with carrier, data set ready and clear to send. It represents a line without modem control signals."""


@dataclass(frozen=True, slots=True)
class PortSettings:
    """Settings of a serial port."""

    baudrate: int = 9600
    parity: ComParity = ComParity.NONE
    stop_size: StopSize = StopSize.ONE
    data_size: int = 8
    """Number of data bits per character."""

    def __str__(self) -> str:
        stop = {StopSize.ONE: "1", StopSize.TWO: "2", StopSize.ONE_AND_A_HALF: "1.5"}[self.stop_size]
        return f"{self.baudrate} baud, {self.data_size} data bits, parity {self.parity.name.lower()}, {stop} stop bits"


def encode_command(command: Command, value: int | bytes = b"", *, server: bool = False) -> bytes:
    """Encode a command from a client or from a server. Raises LocalProtocolError if it cannot carry the value."""
    size = VALUE_BYTES[command]
    if isinstance(value, int):
        try:
            value = value.to_bytes(size, "big")
        except OverflowError as error:
            raise LocalProtocolError(f"{command.name} cannot carry {value!r}") from error
    elif command is not Command.SIGNATURE and len(value) != size:
        raise LocalProtocolError(f"{command.name} needs a value of {size} bytes")
    return subnegotiation(Option.COM_PORT, bytes((command + FROM_SERVER * server,)) + value)


def decode_command(data: bytes, *, server: bool) -> tuple[Command, int]:
    """Decode the command and the value of a subnegotiation from a server or a client. The value is 0 for a
    signature and for a command without a value. Raises RemoteProtocolError for an invalid subnegotiation.
    """
    if not data:
        raise RemoteProtocolError("a com port command without a code")
    try:
        command = Command(data[0] - FROM_SERVER * server)
    except ValueError:
        raise RemoteProtocolError(f"unknown com port command {data[0]}") from None
    if command is Command.SIGNATURE:
        return command, 0
    if len(data) - 1 != VALUE_BYTES[command]:
        raise RemoteProtocolError(
            f"{command.name} received with {len(data) - 1} bytes instead of {VALUE_BYTES[command]}"
        )
    return command, int.from_bytes(data[1:], "big")
