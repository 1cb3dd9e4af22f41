"""A DBC file, as CANoe, SavvyCAN and cantools read it, from the field tables of a device's frames.

Neither multiplexed signals nor extended identifiers are written: no device here has them. Where one identifier carries
payloads of several lengths, its device chooses one: a strict decoder refuses a shorter frame and reads a longer one
as far as the message goes.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from protocol.fields import Field, Layout

ENCODING = "cp1252"
"""Of a DBC file. Source: cantools and the tools of Vector on a western system."""
_PLAIN = str.maketrans({"−": "-", "…": "...", "²": "2", '"': "'", "\\": "/"})
_FLOATS = {"f": 1, "d": 2}
"""Number of a signal that is no whole number, by `struct` character. Source: SIG_VALTYPE_ of the format."""
_HOST = "Host"


class CanMessage(NamedTuple):
    """The frames of one identifier."""

    identifier: int
    """11 bits."""
    name: str
    layout: Layout
    to_host: bool
    """The device sends it, and the host hears it; else the other way round."""


def database(device: str, messages: Sequence[CanMessage]) -> bytes:
    """Return the DBC file of one device, whose node bears its name."""
    node = _name(device)
    parts = ['VERSION ""', "NS_ :", "BS_:", f"BU_: {_HOST} {node}"]
    parts += ["\n".join(_message(message, node)) for message in messages]
    comments = [line for message in messages for line in _comments(message)]
    kinds = [line for message in messages for line in _kinds(message)]
    parts += ["\n".join(lines) for lines in (comments, kinds) if lines]
    return ("\n\n".join(parts) + "\n").encode(ENCODING, "replace")


def _message(message: CanMessage, node: str) -> Iterator[str]:
    sender, receiver = (node, _HOST) if message.to_host else (_HOST, node)
    yield f"BO_ {message.identifier} {_name(message.name)}: {message.layout.size} {sender}"
    for field in message.layout.fields:
        yield f" SG_ {_name(field.name)} : {_place(field, message.layout)} {_worth(field)} {receiver}"


def _place(field: Field, layout: Layout) -> str:
    """First bit, length, order and sign. Bits of a byte count from its lowest; a signal with its high byte first begins
    at its highest bit.
    """
    size = struct.calcsize(f"<{field.format}")
    sign = "+" if field.format.isupper() else "-"
    if layout.byte_order == "<":
        return f"{8 * field.offset}|{8 * size}@1{sign}"
    return f"{8 * field.offset + 7}|{8 * size}@0{sign}"


def _worth(field: Field) -> str:
    """Worth of one raw unit, ends and unit."""
    low, high = 0.0, 0.0  # not told
    if field.format not in _FLOATS:
        bits = 8 * struct.calcsize(f"<{field.format}")
        low, high = (0, 2**bits - 1) if field.format.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    ends = f"{field.value(low)!r}|{field.value(high)!r}"
    return f'({field.scale!r},0) [{ends}] "{field.unit}"'


def _comments(message: CanMessage) -> Iterator[str]:
    for field in message.layout.fields:
        text = ", ".join(f"bit {bit}: {words}" for bit, words in field.bits.items()) or field.meaning
        if text:
            yield f'CM_ SG_ {message.identifier} {_name(field.name)} "{text.translate(_PLAIN)}";'


def _kinds(message: CanMessage) -> Iterator[str]:
    for field in message.layout.fields:
        if kind := _FLOATS.get(field.format):
            yield f"SIG_VALTYPE_ {message.identifier} {_name(field.name)} : {kind};"


def _name(text: str) -> str:
    """Return a name that the format allows."""
    return re.sub(r"\W", "_", text, flags=re.ASCII)
