"""Frames between a JR3 sensor's CAN gateway and its client: identifiers, payload tables, encoders, decoders.

Source: firmware roboticslab-uc3m/jr3-mbed-firmware-can, consulted for facts. The bus runs at 1 Mbit/s. An 11-bit
identifier combines an op and a node. Payloads are little-endian.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache

from protocol.can.dbc import CanMessage
from protocol.can.frame import CanFilter, CanFrame
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

GATEWAY_BITRATE = 1_000_000
"""Bit rate, bit/s. Source: the firmware."""
NODES = range(1, 128)

_OP_MASK = 0x780
_NODE_MASK = 0x07F


class Op(IntEnum):
    """Kind of a frame: the upper four bits of its identifier."""

    SYNC = 0x080
    """Request for one sample, sent as the bare identifier without a node."""
    ACKNOWLEDGE = 0x100
    START_SYNC = 0x180
    START_ASYNC = 0x200
    STOP = 0x280
    ZERO = 0x300
    SET_FILTER = 0x380
    GET_STATE = 0x400
    GET_FORCE_FULL_SCALES = 0x480
    GET_MOMENT_FULL_SCALES = 0x500
    RESET = 0x580
    FORCES = 0x600
    MOMENTS = 0x680
    BOOT_UP = 0x700
    GRIPPER = 0x780
    """Pulse width of a gripper motor. Only gateways built with gripper support accept it."""


FROM_GATEWAY = frozenset({Op.ACKNOWLEDGE, Op.FORCES, Op.MOMENTS, Op.BOOT_UP})
ACKNOWLEDGED = frozenset(Op) - FROM_GATEWAY - {Op.SYNC, Op.GRIPPER}
"""Commands that the gateway acknowledges."""


FULL_SCALES = payload_layout(
    "full scales",
    7,
    STATE,
    *axis_fields(
        "xyz", Field("", 1, "H", Mark.OBSERVED, "forces in N, moments in N·m×10, as requested", 1.0, "")
    ),
)
FORCES = payload_layout(
    "forces",
    8,
    *axis_fields(AXES[:3], Field("", 0, "h", Mark.OBSERVED, "force", 1 / FULL_SCALE_COUNTS, "of full scale")),
    counter_field(6),
)
MOMENTS = payload_layout(
    "moments",
    8,
    *axis_fields(
        AXES[3:], Field("", 0, "h", Mark.OBSERVED, "moment", 1 / FULL_SCALE_COUNTS, "of full scale")
    ),
    counter_field(6),
)
GRIPPER = payload_layout(
    "gripper", 4, Field("pwm", 0, "f", Mark.OBSERVED, "pulse width, −100 … 100", 1.0, "%")
)

LAYOUTS: Mapping[Op, Layout] = dict.fromkeys(Op, EMPTY) | {
    Op.ACKNOWLEDGE: ACKNOWLEDGE,
    Op.START_SYNC: CUTOFF,
    Op.START_ASYNC: START,
    Op.SET_FILTER: CUTOFF,
    Op.FORCES: FORCES,
    Op.MOMENTS: MOMENTS,
    Op.GRIPPER: GRIPPER,
}
"""Payload layout of each op. An acknowledge of seven bytes or more is decoded with FULL_SCALES instead."""


def can_messages(identifiers: Iterable[int]) -> Sequence[CanMessage]:
    """Return the frames of the gateway that uses these identifiers; without identifiers, of node 1.

    The description of an acknowledge contains only its state. An acknowledge that carries full scales is longer,
    and strict decoders reject a frame that is shorter than its message.
    """
    node = next((node for node in (each & _NODE_MASK for each in identifiers) if node), 1)
    return [
        CanMessage(op if op is Op.SYNC else op | node, op.name, layout, op in FROM_GATEWAY)
        for op, layout in LAYOUTS.items()
    ]


@dataclass(frozen=True, slots=True)
class Command:
    """Message from a client to a gateway. Fields that the op does not carry are 0."""

    op: Op
    node: int = 0
    """Node number, 1 … 127; 0 only for SYNC."""
    cutoff_centihertz: int = 0
    """Cut-off in units of 0.01 Hz; 0 means unfiltered."""
    period_us: int = 0


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """Response of a gateway. Only the order of responses shows which command it acknowledges."""

    state: int
    """State of the gateway: a `GatewayState`, or any other value that the gateway sent."""
    full_scales: tuple[int, int, int] | None = None
    """Full scales of x, y and z in wire units: N for forces, N·m×10 for moments; None if the frame has none."""


@dataclass(frozen=True, slots=True)
class Triple:
    """Half a sample: three forces or three moments."""

    counts: tuple[int, int, int]
    counter: int
    """Number of sensor samples since the start, modulo 65536. Both halves of a sample have the same counter."""


def split(identifier: int) -> tuple[int, int]:
    """Split an 11-bit identifier into op and node. The op may be one that `Op` does not define (000)."""
    return identifier & _OP_MASK, identifier & _NODE_MASK


def identifier(op: Op, node: int) -> int:
    """Return the identifier of an op for a node. SYNC has no node and ignores it.

    Raises LocalProtocolError if the node is outside 1 … 127.
    """
    if op is Op.SYNC:
        return int(op)
    if node not in NODES:
        raise LocalProtocolError(f"a gateway's node is 1 … 127, got {node}")
    return op + node


def client_filters(node: int) -> tuple[CanFilter, ...]:
    """Return filters for a client of this node: the node's samples, and the acknowledges and boot-up messages of
    every gateway.

    The messages of other gateways distinguish a wrong node number from a dead bus.
    """
    return (
        *(CanFilter(identifier(op, node)) for op in (Op.FORCES, Op.MOMENTS)),
        *(CanFilter(int(op), _OP_MASK) for op in (Op.ACKNOWLEDGE, Op.BOOT_UP)),
    )


def gateway_filters(node: int) -> tuple[CanFilter, ...]:
    """Return filters for a gateway: SYNC, and all frames addressed to its node."""
    return CanFilter(int(Op.SYNC)), CanFilter(node, _NODE_MASK)


def encode_command(command: Command) -> CanFrame:
    """Encode a command. Raises LocalProtocolError if only gateways send this op, or if a value does not fit."""
    if command.op in FROM_GATEWAY or command.op is Op.GRIPPER:
        raise LocalProtocolError(f"{command.op.name} is not a command to the sensor")
    layout = LAYOUTS[command.op]
    raw = {"cutoff": command.cutoff_centihertz, "period": command.period_us}
    data = layout.pack({field.name: raw[field.name] for field in layout.fields})
    return CanFrame(identifier(command.op, command.node), data)


def decode_command(frame: CanFrame) -> Command:
    """Decode a command as the gateway does: an incomplete value counts as 0.

    Raises RemoteProtocolError if the identifier is not that of a command.
    """
    op, node = split(frame.identifier)
    if op not in ACKNOWLEDGED and frame.identifier != Op.SYNC:
        raise RemoteProtocolError(f"identifier {frame.identifier:03X} is not a command to a gateway")
    cutoff, period = read_start(frame.data)
    size = LAYOUTS[Op(op)].size
    return Command(Op(op), node, cutoff if size >= CUTOFF.size else 0, period if size >= START.size else 0)


def encode_acknowledge(node: int, acknowledge: Acknowledge) -> CanFrame:
    """Encode an acknowledge. Raises LocalProtocolError if a value does not fit."""
    target = identifier(Op.ACKNOWLEDGE, node)
    if acknowledge.full_scales is None:
        return CanFrame(target, ACKNOWLEDGE.pack({"state": acknowledge.state}))
    x, y, z = acknowledge.full_scales
    return CanFrame(target, FULL_SCALES.pack({"state": acknowledge.state, "x": x, "y": y, "z": z}))


def decode_acknowledge(data: bytes) -> Acknowledge:
    """Decode an acknowledge. Raises RemoteProtocolError if even the state is missing."""
    if len(data) < FULL_SCALES.size:
        return Acknowledge(int(ACKNOWLEDGE.unpack(data)["state"]))
    raw = FULL_SCALES.unpack(data)
    return Acknowledge(int(raw["state"]), (int(raw["x"]), int(raw["y"]), int(raw["z"])))


def encode_sample(node: int, counts: Sequence[int], counter: int) -> tuple[CanFrame, CanFrame]:
    """Encode a sample of six counts as a force frame and a moment frame, in the order in which they are sent.

    Raises LocalProtocolError if a value does not fit.
    """
    fx, fy, fz, mx, my, mz = counts
    forces = FORCES.pack_row(fx, fy, fz, counter)
    moments = MOMENTS.pack_row(mx, my, mz, counter)
    force_id, moment_id = _sample_identifiers(node)
    return CanFrame(force_id, forces), CanFrame(moment_id, moments)


@cache
def _sample_identifiers(node: int) -> tuple[int, int]:
    return identifier(Op.FORCES, node), identifier(Op.MOMENTS, node)


def decode_triple(data: bytes, layout: Layout) -> Triple:
    """Decode half a sample with the layout FORCES or MOMENTS. Raises RemoteProtocolError if the data is too short."""
    x, y, z, counter = layout.unpack_row(data)
    return Triple((x, y, z), counter)
