"""Field tables, each of which defines an encoder, a decoder, the monitor's text and a property test.

A table uses raw integers (or floats) as encoded on the wire. `scale` and `unit` give the meaning of a raw value.
They are applied only where an operator or the control side reads the value.
"""

import dataclasses
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.marks import Mark

_WHOLE = 2.0**53
"""Limit above which a float cannot represent every integer."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a telegram, frame or memory map."""

    name: str
    offset: int
    """Offset from the start of the payload, in bytes."""
    format: str
    """`struct` character of the value, one of B H h I i f."""
    mark: Mark
    meaning: str = ""
    scale: float = 1.0
    """Size of one raw unit, in SI or display units."""
    unit: str = ""
    bits: Mapping[int, str] = dataclasses.field(default_factory=dict, hash=False)
    """Meaning of each status bit by its number."""

    def value(self, raw: float) -> float:
        """Convert a raw value to the field's unit. The value remains an integer if one raw unit is 1.

        For a scale of 1/n, the value is divided by n, so that twelve tenths are exactly 1.2.
        """
        if self.scale == 1.0:
            return raw
        inverse = 1.0 / self.scale
        parts = round(inverse) if abs(inverse) < _WHOLE else 0
        return raw / parts if parts and 1.0 / parts == self.scale else raw * self.scale


@dataclass(frozen=True)
class Layout:
    """Payload of fixed size. Bytes that no field covers are sent as 0 and ignored on reception."""

    name: str
    size: int
    byte_order: str
    """Byte order, `>` for big-endian or `<` for little-endian."""
    fields: tuple[Field, ...]

    @cached_property
    def _packed(self) -> tuple[struct.Struct, tuple[str, ...]]:
        """All fields as one struct with pad bytes between them, so that one call encodes or decodes a payload, and
        their names.
        """
        text, at, names = self.byte_order, 0, []
        for field in sorted(self.fields, key=lambda f: f.offset):
            if field.offset < at:
                raise ValueError(f"{self.name}: field {field.name} overlaps the one before it")
            text += f"{field.offset - at}x{field.format}"
            at = field.offset + struct.calcsize(self.byte_order + field.format)
            names.append(field.name)
        if at > self.size:
            raise ValueError(f"{self.name}: fields end at {at}, beyond the size {self.size}")
        return struct.Struct(text + f"{self.size - at}x"), tuple(names)

    def pack(self, values: Mapping[str, float]) -> bytes:
        """Encode the payload from raw values by name. Fields that are not named are 0.

        Raises LocalProtocolError if a value does not fit into its field, or if no field has a given name.
        """
        _, names = self._packed
        if unknown := values.keys() - set(names):
            raise LocalProtocolError(f"{self.name} has no field {', '.join(sorted(unknown))}")
        return self.pack_row(*(values.get(name, 0) for name in names))

    def pack_row(self, *values: float) -> bytes:
        """Encode the payload from the raw values of all fields, ordered by offset. It is fast enough for payloads
        sent at 1 kHz.

        Raises LocalProtocolError if a value does not fit into its field, or if the number of values is wrong.
        """
        try:
            return self._packed[0].pack(*values)
        except struct.error as error:
            raise LocalProtocolError(f"{self.name}: {error}") from error

    def unpack(self, data: bytes) -> dict[str, float]:
        """Decode the payload to raw values by name. Bytes beyond the size are ignored.

        Raises RemoteProtocolError if the payload is too short.
        """
        return dict(zip(self._packed[1], self.unpack_row(data), strict=True))

    def unpack_row(self, data: bytes) -> tuple[Any, ...]:
        """Decode the payload like `unpack`, but to a tuple ordered by offset."""
        if len(data) < self.size:
            raise RemoteProtocolError(f"{self.name} needs {self.size} bytes of data, got {len(data)}")
        return self._packed[0].unpack_from(data)

    @property
    def struct(self) -> struct.Struct:
        """The entire payload as one struct, with values ordered by offset. It is fast enough for payloads sent at 1
        kHz.
        """
        return self._packed[0]

    def unpack_exact(self, data: bytes) -> tuple[Any, ...]:
        """Decode a payload of exactly this size to a tuple ordered by offset. Raises RemoteProtocolError if the
        length is wrong.
        """
        if len(data) != self.size:
            raise RemoteProtocolError(f"{self.name} has {self.size} bytes, got {len(data)}")
        return self._packed[0].unpack(data)

    def describe(self, data: bytes) -> list[dict[str, object]]:
        """Describe every field for display: name, raw value, value in its unit, mark and meaning."""
        raw = self.unpack(data)
        return [describe_field(field, raw[field.name]) for field in self.fields]


def describe_field(field: Field, raw: float) -> dict[str, object]:
    """Describe the raw value of one field for display."""
    return {
        "name": field.name,
        "raw": raw,
        "value": field.value(raw),
        "unit": field.unit,
        "mark": field.mark.value,
        "meaning": (describe_bits(int(raw), field.bits) or "no error") if field.bits else field.meaning,
    }


def describe_bits(status: int, bits: Mapping[int, str]) -> str:
    """Describe the bits that are set in a status; empty if no bit is set."""
    texts = ", ".join(text for bit, text in bits.items() if status >> bit & 1)
    return texts or ("unnamed error" if status else "")
