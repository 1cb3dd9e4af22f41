"""Frames between a JR3 sensor's UART gateway and its client: ops, payload tables, encoders, decoders.

Source: firmware roboticslab-uc3m/jr3-mbed-firmware-usb, read for facts. 115200 baud, 8N1; a frame is `<`, two
digits that name the op, the payload and `>`. Nothing is escaped and nothing checked: a payload may hold both
delimiters, so only the length that the op has tells where its frame ends.
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
"""8 data bits, no parity, one stop bit. Source: the firmware."""
BITS_PER_BYTE = 10
OPENING, CLOSING = b"<", b">"
HEAD_SIZE = 3
"""The opening and the two digits."""
OVERHEAD = HEAD_SIZE + 1


class Op(IntEnum):
    """The number that two digits name."""

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
"""All of them are acknowledged."""

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
"""Payloads that an op may have, shortest first."""
DATA_FRAME_S = (DATA.size + OVERHEAD) * BITS_PER_BYTE / UART_BAUDRATE
"""Time of one frame of data on the line, s: no more than 640 a second pass."""


class Frame(NamedTuple):
    """One frame whose payload has a length that its op allows."""

    op: Op
    payload: bytes = b""

    def __bytes__(self) -> bytes:
        return b"%b%02d%b%b" % (OPENING, self.op, self.payload, CLOSING)


@dataclass(frozen=True, slots=True)
class Command:
    """Message of a client to a gateway. Fields that the op does not carry are 0."""

    op: Op
    cutoff_centihertz: int = 0
    """0 = unfiltered."""
    period_us: int = 0


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """A gateway's answer. Which command it answers is known only by order."""

    state: int
    """A GatewayState, or whatever else the gateway said."""
    full_scales: tuple[int, ...] | None = None
    """fx fy fz mx my mz as they lie on the wire: N and N·m×10."""


class Data(NamedTuple):
    """One sample."""

    counts: tuple[int, int, int, int, int, int]
    counter: int
    """Sensor samples since the start, modulo 65536."""


def encode_command(command: Command) -> bytes:
    """Encode a command.

    Raises LocalProtocolError for an op that only gateways send and for values that do not fit. It also refuses
    values with a byte that the gateway would take for a delimiter. It looks for delimiters, whatever stands before.
    """
    if command.op in FROM_GATEWAY:
        raise LocalProtocolError(f"{command.op.name} is no command to the sensor")
    (layout,) = LAYOUTS[command.op]
    raw = {"cutoff": command.cutoff_centihertz, "period": command.period_us}
    payload = layout.pack({field.name: raw[field.name] for field in layout.fields})
    if holds_delimiter(payload):
        raise LocalProtocolError(
            f"{layout.name} {payload.hex(' ').upper()} holds 3C or 3E, which the gateway takes for < or >"
        )
    return bytes(Frame(command.op, payload))


def decode_command(op: int, payload: bytes) -> Command:
    """Decode a command as the gateway does: an incomplete value counts as 0.

    Raises RemoteProtocolError for an op that is no command.
    """
    if op not in COMMANDS:
        raise RemoteProtocolError(f"{op:02d} is no command to a gateway")
    cutoff, period = read_start(payload)
    (layout,) = LAYOUTS[Op(op)]
    return Command(
        Op(op), cutoff if layout.size >= CUTOFF.size else 0, period if layout.size >= START.size else 0
    )


def encode_acknowledge(acknowledge: Acknowledge) -> bytes:
    """Encode an acknowledge. Raises LocalProtocolError for values that do not fit."""
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
    """Encode a sample of six counts. Raises LocalProtocolError for values that do not fit."""
    return bytes(Frame(Op.DATA, DATA.pack_row(*counts, counter)))


def decode_data(payload: bytes) -> Data:
    """Decode a sample. Raises RemoteProtocolError if it is too short."""
    fx, fy, fz, mx, my, mz, counter = DATA.unpack_row(payload)
    return Data((fx, fy, fz, mx, my, mz), counter)


def holds_delimiter(payload: bytes) -> bool:
    """Whether the gateway, which looks for delimiters in what it receives, would misread this payload."""
    return OPENING in payload or CLOSING in payload


def sendable_near(value: int, size: int) -> tuple[int, ...]:
    """Return the value itself if the gateway reads it as it is sent, in `size` bytes; otherwise the nearest below and
    above that it does.
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
