"""Field tables: one table gives the encoder, the decoder, the monitor's text and the property test.

A table holds raw integers (or floats) as they lie on the wire; `scale` and `unit` say what a raw value means
and are applied only where an operator or the control side reads it.
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
"""Beyond it a float tells no whole number from the next."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a telegram, frame or memory map."""

    name: str
    offset: int
    """Bytes from the start of the payload."""
    format: str
    """One `struct` character: B H h I i f."""
    mark: Mark
    meaning: str = ""
    scale: float = 1.0
    """SI or display value of one raw unit."""
    unit: str = ""
    bits: Mapping[int, str] = dataclasses.field(default_factory=dict, hash=False)
    """Words for each bit that may be set, of a status."""

    def value(self, raw: float) -> float:
        """Convert a raw value to the field's unit; it stays an integer where one raw unit is 1.

        A scale of one nth divides by n, so that twelve tenths are 1.2 to the last bit.
        """
        if self.scale == 1.0:
            return raw
        inverse = 1.0 / self.scale
        parts = round(inverse) if abs(inverse) < _WHOLE else 0
        return raw / parts if parts and 1.0 / parts == self.scale else raw * self.scale


@dataclass(frozen=True)
class Layout:
    """A payload of fixed size. Bytes that no field covers are sent as 0 and ignored when received."""

    name: str
    size: int
    byte_order: str
    """`>` big-endian or `<` little-endian."""
    fields: tuple[Field, ...]

    @cached_property
    def _packed(self) -> tuple[struct.Struct, tuple[str, ...]]:
        """All fields as one struct with pad bytes between, so that a payload costs one call."""
        text, at, names = self.byte_order, 0, []
        for field in sorted(self.fields, key=lambda f: f.offset):
            if field.offset < at:
                raise ValueError(f"{self.name}: field {field.name} overlaps the one before it")
            text += f"{field.offset - at}x{field.format}"
            at = field.offset + struct.calcsize(self.byte_order + field.format)
            names.append(field.name)
        if at > self.size:
            raise ValueError(f"{self.name}: fields end at {at}, past the size {self.size}")
        return struct.Struct(text + f"{self.size - at}x"), tuple(names)

    def pack(self, values: Mapping[str, float]) -> bytes:
        """Bytes of the payload; fields not named are 0.

        Raises LocalProtocolError for a value that its field cannot hold or a name that is no field.
        """
        _, names = self._packed
        if unknown := values.keys() - set(names):
            raise LocalProtocolError(f"{self.name} has no field {', '.join(sorted(unknown))}")
        return self.pack_row(*(values.get(name, 0) for name in names))

    def pack_row(self, *values: float) -> bytes:
        """Bytes of the payload from a value for every field, by offset: for what is sent a thousand times a second.

        Raises LocalProtocolError for a value that its field cannot hold, and for another number of them.
        """
        try:
            return self._packed[0].pack(*values)
        except struct.error as error:
            raise LocalProtocolError(f"{self.name}: {error}") from error

    def unpack(self, data: bytes) -> dict[str, float]:
        """Raw values by name. Bytes past the size are ignored.

        Raises RemoteProtocolError when the payload is too short.
        """
        return dict(zip(self._packed[1], self.unpack_row(data), strict=True))

    def unpack_row(self, data: bytes) -> tuple[Any, ...]:
        """Raw values by offset; as `unpack`."""
        if len(data) < self.size:
            raise RemoteProtocolError(f"{self.name} needs {self.size} bytes of data, got {len(data)}")
        return self._packed[0].unpack_from(data)

    @property
    def struct(self) -> struct.Struct:
        """The whole payload as one struct, values by offset: for what is read or written every millisecond."""
        return self._packed[0]

    def unpack_exact(self, data: bytes) -> tuple[Any, ...]:
        """As `unpack_row`, where the length tells what a payload is. Raises RemoteProtocolError for another length."""
        if len(data) != self.size:
            raise RemoteProtocolError(f"{self.name} has {self.size} bytes, got {len(data)}")
        return self._packed[0].unpack(data)

    def describe(self, data: bytes) -> list[dict[str, object]]:
        """Every field as name, raw value, value in its unit, mark and meaning: for people to read."""
        raw = self.unpack(data)
        return [describe_field(field, raw[field.name]) for field in self.fields]


def describe_field(field: Field, raw: float) -> dict[str, object]:
    """Describe a raw value of a field for people to read."""
    return {
        "name": field.name,
        "raw": raw,
        "value": field.value(raw),
        "unit": field.unit,
        "mark": field.mark.value,
        "meaning": (bit_words(int(raw), field.bits) or "no error") if field.bits else field.meaning,
    }


def bit_words(status: int, bits: Mapping[int, str]) -> str:
    """Describe the bits of a status; empty for none of them."""
    words = ", ".join(text for bit, text in bits.items() if status >> bit & 1)
    return words or ("an error without a name" if status else "")
