"""Messages from a run to the process that serves its page: MessagePack over a pair of local sockets.

The socket keeps the bounds of messages and its buffer is all that can wait. The other way go one word, and requests
of a page to the panel of an emulated controller.
"""

from collections.abc import Mapping
from typing import Any, TypeAlias

import msgspec
from msgspec import Raw, Struct

from hil_bridge.record.topics import TOPICS, Record
from hil_bridge.show.terminal import Health, Scene

RETRACT = b"retract"
"""The only word that the serving process says."""
REQUEST_BYTES = 1 << 12
"""Size of what the serving process says at most."""
MOST_BYTES = 1 << 17
"""Size of a message at most: records that do not fit are dropped."""


class Begin(Struct, tag="begin", frozen=True):
    """Facts of the run; a later one takes the place of an earlier one."""

    scene: Scene
    unix_zero_ns: int
    """Time at 0 of the run's clock, ns since 1970."""


class Devices(Struct, tag="devices", frozen=True):
    """The devices are ready: their facts, JSON by name, as a recording keeps them."""

    facts: Mapping[str, str]


class Records(Struct, tag="records", frozen=True):
    """Records of the run in order, each with the number of its topic."""

    items: list[tuple[int, Raw]]


class Pulse(Struct, tag="pulse", frozen=True):
    """The run's clock and the health of its wires, now and then."""

    now: float
    """s on the run's clock."""
    health: Health
    dropped: int = 0
    """Records that the page was not given, since it did not keep up."""
    check: str = ""
    """Newest finding about the sensor."""
    warning: str = ""
    """Newest warning."""


class End(Struct, tag="end", frozen=True):
    """The run has ended by itself, and how: `RunEnd.as_metadata`."""

    facts: Mapping[str, str]


class Panel(Struct, tag="panel", frozen=True):
    """Controls and faults of an emulated controller, as its panel lists them."""

    robot: str
    controls: Mapping[str, Any]
    faults: Mapping[str, Any]


class PanelState(Struct, tag="state", frozen=True):
    """State of the panel for people, as of `PanelView`."""

    rows: Mapping[str, str]
    at: Mapping[str, str | float]


class PanelResponse(Struct, tag="answered", frozen=True):
    """Response to a request."""

    number: int
    error: str
    """Why the request failed; empty on success."""


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
