"""Data of a telegram as named values in display units: fields at fixed offsets, optionally followed by any number
of bytes.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from protocol.endpoint import LocalProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark

Value: TypeAlias = float | bytes
"""Value of a field: a number in the field's unit, an integer if one raw unit is 1, or bytes."""

FIELD_TYPES = {"u8": "B", "s8": "b", "u16": "H", "s16": "h", "u32": "I", "s32": "i", "f32": "f"}
"""`struct` character of each field type, by the name of the type in an orders file. All types are big-endian."""
TYPE_NAMES = {character: name for name, character in FIELD_TYPES.items()}
"""Name of each field type by its `struct` character, the inverse of `FIELD_TYPES`."""
_FLOAT_LIMIT = float.fromhex("0x1.fffffep+127")
"""Largest single-precision number."""


@dataclass(frozen=True, slots=True)
class Rest:
    """Field that consists of all bytes after the fixed fields."""

    name: str
    mark: Mark
    meaning: str = ""


@dataclass(frozen=True)
class Payload:
    """Format of the data after the header of a telegram, with all blocks joined."""

    layout: Layout
    """Fields at fixed offsets. The size of this layout is the minimum size of the data."""
    rest: Rest | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all fields in order."""
        return (*(field.name for field in self.layout.fields), *((self.rest.name,) if self.rest else ()))

    def encode(self, values: Mapping[str, Value]) -> bytes:
        """Encode these values, given in the units of the fields. A field that is not named is 0 or empty.

        Raises LocalProtocolError that names a field that is unknown or has an invalid value.
        """
        if unknown := sorted(values.keys() - set(self.names)):
            known = f"it has {', '.join(self.names)}" if self.names else "it has none"
            raise LocalProtocolError(f"{self.layout.name} has no field {unknown[0]}: {known}")
        fixed = {
            field.name: self._raw(field, values[field.name])
            for field in self.layout.fields
            if field.name in values
        }
        data = self.layout.pack(fixed)
        if self.rest is None:
            return data
        rest = values.get(self.rest.name, b"")
        if not isinstance(rest, bytes):
            raise LocalProtocolError(f"{self.layout.name}: {self.rest.name} must be bytes, got {rest!r}")
        return data + rest

    def decode(self, data: bytes) -> dict[str, Value]:
        """Decode the data to values by name, in the units of the fields. Raises RemoteProtocolError if the data is
        too short.
        """
        raw = self.layout.unpack(data)
        values: dict[str, Value] = {f.name: f.value(raw[f.name]) for f in self.layout.fields}
        if self.rest is not None:
            values[self.rest.name] = data[self.layout.size :]
        return values

    def describe(self, data: bytes) -> list[dict[str, object]]:
        """Describe every field for display, in the same format as `Layout.describe`."""
        items = self.layout.describe(data)
        if self.rest is not None:
            items.append(describe_rest(self.rest, data[self.layout.size :]))
        return items

    def _raw(self, field: Field, value: Value) -> float:
        where = f"{self.layout.name}: {field.name}"
        if isinstance(value, (bool, bytes, str)) or not math.isfinite(value):
            raise LocalProtocolError(f"{where} must be a number, got {value!r}")
        raw = value / field.scale
        if math.isfinite(raw) and field.format != "f":
            if field.scale == 1.0 and value != round(value):
                raise LocalProtocolError(f"{where} must be a whole number, got {value:g}")
            raw = round(raw)
        low, high = limits(field.format)
        if not low <= raw <= high:
            ends = sorted((low * field.scale, high * field.scale))
            unit = f" {field.unit}" if field.unit else ""
            raise LocalProtocolError(f"{where} = {value:g} is outside {ends[0]:g} … {ends[1]:g}{unit}")
        return raw


def field_size(field: Field) -> int:
    """Return the size of a field in bytes."""
    return struct.calcsize(">" + field.format)


def limits(format_: str) -> tuple[float, float]:
    """Return the smallest and largest raw value of a `struct` character."""
    if format_ == "f":
        return -_FLOAT_LIMIT, _FLOAT_LIMIT
    bits = 8 * struct.calcsize(">" + format_)
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if format_.islower() else (0, (1 << bits) - 1)


def describe_rest(rest: Rest, data: bytes) -> dict[str, object]:
    """Describe a field with any number of bytes for display."""
    text = data.hex(" ").upper()
    return {
        "name": rest.name,
        "raw": text,
        "value": text,
        "unit": "",
        "mark": rest.mark.value,
        "meaning": rest.meaning,
    }
