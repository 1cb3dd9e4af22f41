"""DBC files as read by CANoe, SavvyCAN and cantools, generated from the field tables of a device's frames.

Multiplexed signals and extended identifiers are not written, because no device here uses them. Where one identifier
carries payloads of several lengths, the device's module chooses one of them. A strict decoder rejects a frame
shorter than the message in the DBC file, and decodes a longer frame up to the length of that message.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from protocol.fields import Field, Layout

ENCODING = "cp1252"
"""Encoding of a DBC file. Source: cantools, and Vector's tools on a Western-locale system."""
_PLAIN = str.maketrans({"−": "-", "…": "...", "²": "2", '"': "'", "\\": "/"})
_FLOATS = {"f": 1, "d": 2}
"""Code of a non-integer signal type, by `struct` character. Source: SIG_VALTYPE_ of the format."""
_HOST = "Host"


class CanMessage(NamedTuple):
    """All frames with one identifier."""

    identifier: int
    """Identifier of the frames, 11 bits."""
    name: str
    layout: Layout
    to_host: bool
    """Whether the device sends the frame to the host; otherwise the host sends it."""


def database(device: str, messages: Sequence[CanMessage]) -> bytes:
    """Return the DBC file of one device. The file has one node with the name of the device."""
    node = _name(device)
    parts = ['VERSION ""', "NS_ :", "BS_:", f"BU_: {_HOST} {node}"]
    parts += ["\n".join(_message(message, node)) for message in messages]
    comments = [line for message in messages for line in _comments(message)]
    kinds = [line for message in messages for line in _value_types(message)]
    parts += ["\n".join(lines) for lines in (comments, kinds) if lines]
    return ("\n\n".join(parts) + "\n").encode(ENCODING, "replace")


def _message(message: CanMessage, node: str) -> Iterator[str]:
    sender, receiver = (node, _HOST) if message.to_host else (_HOST, node)
    yield f"BO_ {message.identifier} {_name(message.name)}: {message.layout.size} {sender}"
    for field in message.layout.fields:
        yield f" SG_ {_name(field.name)} : {_signal_position(field, message.layout)} {_scaling(field)} {receiver}"


def _signal_position(field: Field, layout: Layout) -> str:
    """Return the first bit, length, byte order and sign of a signal.

    Bits are numbered from the lowest bit of a byte. A big-endian signal starts at its highest bit.
    """
    size = struct.calcsize(f"<{field.format}")
    sign = "+" if field.format.isupper() else "-"
    if layout.byte_order == "<":
        return f"{8 * field.offset}|{8 * size}@1{sign}"
    return f"{8 * field.offset + 7}|{8 * size}@0{sign}"


def _scaling(field: Field) -> str:
    """Return the scale factor, limits and unit of a field."""
    low, high = 0.0, 0.0  # unknown
    if field.format not in _FLOATS:
        bits = 8 * struct.calcsize(f"<{field.format}")
        low, high = (0, 2**bits - 1) if field.format.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    ends = f"{field.value(low)!r}|{field.value(high)!r}"
    return f'({field.scale!r},0) [{ends}] "{field.unit}"'


def _comments(message: CanMessage) -> Iterator[str]:
    for field in message.layout.fields:
        text = ", ".join(f"bit {bit}: {meaning}" for bit, meaning in field.bits.items()) or field.meaning
        if text:
            yield f'CM_ SG_ {message.identifier} {_name(field.name)} "{text.translate(_PLAIN)}";'


def _value_types(message: CanMessage) -> Iterator[str]:
    for field in message.layout.fields:
        if kind := _FLOATS.get(field.format):
            yield f"SIG_VALTYPE_ {message.identifier} {_name(field.name)} : {kind};"


def _name(text: str) -> str:
    """Convert a name to the form that the DBC format allows."""
    return re.sub(r"\W", "_", text, flags=re.ASCII)
