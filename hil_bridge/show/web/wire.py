"""Messages from a run to the process that serves its page: MessagePack over a pair of local sockets.

The socket preserves message boundaries, and its buffer limits the amount of waiting data. The opposite direction
carries one command, and requests of a page to the panel of an emulated controller.
"""

from collections.abc import Mapping
from typing import Any, TypeAlias

import msgspec
from msgspec import Raw, Struct

from hil_bridge.record.topics import TOPICS, Record
from hil_bridge.show.charts.cell import CellModel
from hil_bridge.show.terminal import Health, Scene

RETRACT = b"retract"
"""Command to retract and end, the only one that the serving process sends."""
REQUEST_BYTES = 1 << 12
"""Largest message from the serving process, bytes."""
MOST_BYTES = 1 << 17
"""Largest message from the run, bytes; records that do not fit are dropped."""


class Begin(Struct, tag="begin", frozen=True):
    """Facts of the run. A later message replaces an earlier one."""

    scene: Scene
    unix_zero_ns: int
    """UNIX time at which the run's clock was 0, ns."""
    model: CellModel = CellModel()
    """Constant part of the picture of the cell."""


class Devices(Struct, tag="devices", frozen=True):
    """Facts of the devices once they are ready, as JSON by name, as in a recording."""

    facts: Mapping[str, str]


class Records(Struct, tag="records", frozen=True):
    """Records of the run in order, each with the number of its topic."""

    items: list[tuple[int, Raw]]


class Pulse(Struct, tag="pulse", frozen=True):
    """Time on the run's clock and health of its links, sent periodically."""

    now: float
    """Time on the run's clock, s."""
    health: Health
    dropped: int = 0
    """Number of records that were not sent to the page because the page did not keep up."""
    check: str = ""
    """Newest finding about the sensor."""
    warning: str = ""
    """Newest warning."""


class End(Struct, tag="end", frozen=True):
    """Orderly end of the run, with the metadata of `RunEnd.as_metadata`."""

    facts: Mapping[str, str]


class Panel(Struct, tag="panel", frozen=True):
    """Controls and faults of an emulated controller, in the form in which its panel lists them."""

    robot: str
    controls: Mapping[str, Any]
    faults: Mapping[str, Any]


class PanelState(Struct, tag="state", frozen=True):
    """State of the panel for display, as in `PanelView`."""

    rows: Mapping[str, str]
    at: Mapping[str, str | float]


class PanelResponse(Struct, tag="answered", frozen=True):
    """Response to a panel request."""

    number: int
    error: str
    """Reason why the request failed; empty on success."""


class PanelRequest(Struct, frozen=True):
    """Request of a page to the panel. The serving process has checked the token of the client."""

    number: int
    request: Mapping[str, Any]


Message: TypeAlias = Begin | Devices | Records | Pulse | End | Panel | PanelState | PanelResponse

_NUMBERS = {topic.record: number for number, topic in enumerate(TOPICS)}
_encoder = msgspec.msgpack.Encoder(enc_hook=lambda value: value.tolist())
_decoder = msgspec.msgpack.Decoder(Message)
_asked = msgspec.msgpack.Decoder(PanelRequest)
_records = tuple(msgspec.msgpack.Decoder(topic.record) for topic in TOPICS)


def encode_message(message: Message | PanelRequest) -> bytes:
    """Encode a message."""
    return _encoder.encode(message)


def encode_records(records: list[Record]) -> bytes:
    """Encode records as one `Records` message."""
    items: Any = [(_NUMBERS[type(record)], record) for record in records]
    return _encoder.encode(Records(items))


def decode_message(data: bytes) -> Message:
    """Decode a message. Raises msgspec.DecodeError."""
    message: Message = _decoder.decode(data)
    return message


def decode_request(data: bytes) -> PanelRequest:
    """Decode a panel request. Raises msgspec.DecodeError."""
    return _asked.decode(data)


def records_of(message: Records) -> list[Record]:
    """Decode the records of a message. Raises msgspec.DecodeError."""
    return [_records[number].decode(raw) for number, raw in message.items]
