"""Frames between a JR3 sensor's UART gateway and its client: ops, payload tables, encoders, decoders.

Source: firmware roboticslab-uc3m/jr3-mbed-firmware-usb, consulted for facts. The line runs at 115200 baud, 8N1. A
frame consists of `<`, two digits for the op, the payload, and `>`. There is no escaping and no checksum. A payload
may contain both delimiters, so only the length defined for the op determines where its frame ends.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from protocol.devices.jr3.counts import FULL_SCALE_COUNTS
from protocol.devices.jr3.firmware import (
    ACKNOWLEDGE,
    CUTOFF,
    EMPTY,
    START,
    STATE,
    axis_fields,
    counter_field,
    payload_layout,
    read_start,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark
from protocol.wrench import AXES

UART_BAUDRATE = 115_200
"""Baud rate of the line, which has 8 data bits, no parity and one stop bit. Source: the firmware."""
BITS_PER_BYTE = 10
OPENING, CLOSING = b"<", b">"
HEAD_SIZE = 3
"""Number of bytes before the payload: the opening delimiter and the two digits."""
OVERHEAD = HEAD_SIZE + 1


class Op(IntEnum):
    """Kind of a frame, encoded as two digits."""

    ACKNOWLEDGE = 1
    START = 2
    STOP = 3
    ZERO = 4
    SET_FILTER = 5
    GET_STATE = 6
    GET_FULL_SCALES = 7
    RESET = 8
    DATA = 9
    BOOT_UP = 10


FROM_GATEWAY = frozenset({Op.ACKNOWLEDGE, Op.DATA, Op.BOOT_UP})
COMMANDS = frozenset(Op) - FROM_GATEWAY
"""Commands, all of which are acknowledged."""

FULL_SCALES = payload_layout(
    "full scales",
    13,
    STATE,
    *axis_fields(AXES[:3], Field("", 1, "H", Mark.OBSERVED, "full scale of the force", 1.0, "N")),
    *axis_fields(AXES[3:], Field("", 7, "H", Mark.OBSERVED, "full scale of the moment", 0.1, "N·m")),
)
DATA = payload_layout(
    "data",
    14,
    *axis_fields(AXES[:3], Field("", 0, "h", Mark.OBSERVED, "force", 1 / FULL_SCALE_COUNTS, "of full scale")),
    *axis_fields(
        AXES[3:], Field("", 6, "h", Mark.OBSERVED, "moment", 1 / FULL_SCALE_COUNTS, "of full scale")
    ),
    counter_field(12),
)

LAYOUTS: Mapping[Op, tuple[Layout, ...]] = dict.fromkeys(Op, (EMPTY,)) | {
    Op.ACKNOWLEDGE: (ACKNOWLEDGE, FULL_SCALES),
    Op.START: (START,),
    Op.SET_FILTER: (CUTOFF,),
    Op.DATA: (DATA,),
}
"""Possible payload layouts of each op, shortest first."""
DATA_FRAME_S = (DATA.size + OVERHEAD) * BITS_PER_BYTE / UART_BAUDRATE
"""Transmission time of one data frame, s. It allows at most 640 frames per second."""


class Frame(NamedTuple):
    """A frame with a payload length that its op allows."""

    op: Op
    payload: bytes = b""

    def __bytes__(self) -> bytes:
        return b"%b%02d%b%b" % (OPENING, self.op, self.payload, CLOSING)


@dataclass(frozen=True, slots=True)
class Command:
    """Message from a client to a gateway. Fields that the op does not carry are 0."""

    op: Op
    cutoff_centihertz: int = 0
    """Cut-off in units of 0.01 Hz; 0 means unfiltered."""
    period_us: int = 0


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """Response of a gateway. Only the order of responses shows which command it acknowledges."""

    state: int
    """State of the gateway: a `GatewayState`, or any other value that the gateway sent."""
    full_scales: tuple[int, ...] | None = None
    """Full scales of fx fy fz mx my mz in wire units, N and N·m×10; None if the frame has none."""


class Data(NamedTuple):
    """One sample."""

    counts: tuple[int, int, int, int, int, int]
    counter: int
    """Number of sensor samples since the start, modulo 65536."""


def encode_command(command: Command) -> bytes:
    """Encode a command.

    Raises LocalProtocolError if only gateways send this op, or if a value does not fit. It also refuses a value
    that contains the byte of a delimiter, because the gateway scans for delimiters at every position.
    """
    if command.op in FROM_GATEWAY:
        raise LocalProtocolError(f"{command.op.name} is not a command to the sensor")
    (layout,) = LAYOUTS[command.op]
    raw = {"cutoff": command.cutoff_centihertz, "period": command.period_us}
    payload = layout.pack({field.name: raw[field.name] for field in layout.fields})
    if holds_delimiter(payload):
        raise LocalProtocolError(
            f"{layout.name} {payload.hex(' ').upper()} contains 3C or 3E, which the gateway interprets as < or >"
        )
    return bytes(Frame(command.op, payload))


def decode_command(op: int, payload: bytes) -> Command:
    """Decode a command as the gateway does: an incomplete value counts as 0.

    Raises RemoteProtocolError if the op is not a command.
    """
    if op not in COMMANDS:
        raise RemoteProtocolError(f"{op:02d} is not a command to a gateway")
    cutoff, period = read_start(payload)
    (layout,) = LAYOUTS[Op(op)]
    return Command(
        Op(op), cutoff if layout.size >= CUTOFF.size else 0, period if layout.size >= START.size else 0
    )


def encode_acknowledge(acknowledge: Acknowledge) -> bytes:
    """Encode an acknowledge. Raises LocalProtocolError if a value does not fit."""
    if acknowledge.full_scales is None:
        return bytes(Frame(Op.ACKNOWLEDGE, ACKNOWLEDGE.pack({"state": acknowledge.state})))
    scales = dict(zip(AXES, acknowledge.full_scales, strict=True))
    return bytes(Frame(Op.ACKNOWLEDGE, FULL_SCALES.pack({"state": acknowledge.state, **scales})))


def decode_acknowledge(payload: bytes) -> Acknowledge:
    """Decode an acknowledge. Raises RemoteProtocolError if even the state is missing."""
    if len(payload) < FULL_SCALES.size:
        return Acknowledge(int(ACKNOWLEDGE.unpack(payload)["state"]))
    state, *scales = (int(value) for value in FULL_SCALES.unpack(payload).values())
    return Acknowledge(state, tuple(scales))


def encode_data(counts: Sequence[int], counter: int) -> bytes:
    """Encode a sample of six counts. Raises LocalProtocolError if a value does not fit."""
    return bytes(Frame(Op.DATA, DATA.pack_row(*counts, counter)))


def decode_data(payload: bytes) -> Data:
    """Decode a sample. Raises RemoteProtocolError if it is too short."""
    fx, fy, fz, mx, my, mz, counter = DATA.unpack_row(payload)
    return Data((fx, fy, fz, mx, my, mz), counter)


def holds_delimiter(payload: bytes) -> bool:
    """Return whether the gateway, which scans received data for delimiters, would misread this payload."""
    return OPENING in payload or CLOSING in payload


def sendable_near(value: int, size: int) -> tuple[int, ...]:
    """Return the value itself if its encoding in `size` bytes contains no delimiter; otherwise, return the nearest
    lower and higher values without a delimiter.
    """

    def misread(number: int) -> bool:
        return holds_delimiter(number.to_bytes(size, "little"))

    if not misread(value):
        return (value,)
    below = above = value
    while misread(below):
        below -= 1
    while misread(above):
        above += 1
    return below, above
