"""Topics of a recording. Schema, encoder and decoder are derived from the types and docstrings of the records.

Messages are JSON with a JSON schema, so that Foxglove and PlotJuggler open a recording directly, and every message
is valid by its schema. JSON supports neither NaN nor infinity. A field with an unknown or non-finite value is
omitted from its message, so no schema requires it. In an array, and among values by name, such a number is null,
which the schema allows. Both are read back as NaN; a field that may be None is read back as None. If such a field
has a finite default, because older messages may lack the field, the message lists the field in `not_finite`.

The readers of Foxglove and Lichtblick accept only a single type name, for fields and for `items`, and otherwise
reject the complete topic: a field cannot be "number or null". They ignore `prefixItems` of arrays, in which null is
allowed. Source: parseJsonSchema.ts of foxglove/studio and Lichtblick-Suite/lichtblick. Standard: JSON Schema
2020-12.
"""

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import msgspec
from msgspec import inspect, structs

from hil_bridge.record import records
from hil_bridge.record.field_docstrings import field_docstrings

Record: TypeAlias = (
    records.CycleRecord
    | records.SensorRecord
    | records.LinkRecord
    | records.WireRecord
    | records.TruthRecord
    | records.EventRecord
    | records.StepRecord
)


@dataclass(frozen=True)
class Topic:
    """Message stream for the records of one type."""

    name: str
    record: type[Record]
    time: str = "at"
    """Name of the field that holds the log time."""

    @property
    def schema_name(self) -> str:
        return f"hil_bridge.{self.record.__name__}"

    @property
    def schema(self) -> Mapping[str, object]:
        """JSON schema of a message, which requires the time field."""
        schema = _schema(self._type)
        required: Any = schema["required"]
        return {
            "$schema": _DIALECT,
            "title": self.schema_name,
            **schema,
            "required": sorted({*required, self.time}),
        }

    @cached_property
    def _type(self) -> inspect.Type:
        return inspect.type_info(self.record)

    @cached_property
    def time_of(self) -> Callable[[Any], float]:
        """Return the time of a record on the run's clock, s."""
        return operator.attrgetter(self.time)

    @cached_property
    def _decoder(self) -> msgspec.json.Decoder[Any]:
        return msgspec.json.Decoder(self.record)

    def timed(self, record: Record, at: float) -> Record:
        """Return a copy of the record with this time, s on the run's clock."""
        return structs.replace(record, **{self.time: at})

    def encode(self, record: Record) -> bytes:
        """Encode a record as compact strict JSON.

        The time of the record must be finite; otherwise the message is invalid by the schema.
        """
        try:
            data = _to_json(record)
        except UnicodeEncodeError:
            data = _to_json(_escape_surrogates(msgspec.to_builtins(record, enc_hook=_plain)))
        if _NULL not in data:  # true for nearly all messages
            return data
        message = _drop_nulls(msgspec.json.decode(data), self._type)
        message.setdefault(self.time)  # no reader accepts a message without a time
        return _to_json(message)

    def decode(self, data: bytes) -> Record:
        """Decode a record. Unknown fields are ignored, and missing fields get their defaults.

        Raises ValueError that names the missing or invalid field.
        """
        try:
            if _NAMED not in data:
                record: Record = self._decoder.decode(data)
                return record
            return msgspec.convert(_with_nan(msgspec.json.decode(data), self._type), self.record)
        except msgspec.ValidationError:  # or a number that represents NaN is missing or null
            fields = msgspec.json.decode(data)
            if isinstance(fields, dict) and self.time not in fields:
                raise
            return msgspec.convert(_with_nan(fields, self._type), self.record)


def schema_of(message: type[msgspec.Struct]) -> dict[str, object]:
    """Return the JSON schema of a message in the form that Foxglove's reader accepts."""
    return {"$schema": _DIALECT, **_schema(inspect.type_info(message))}


def _schema(kind: inspect.Type) -> dict[str, object]:
    """Return the JSON schema of a type in the form that Foxglove's reader accepts.

    The type is always a single name, and an object always has properties.
    """
    match kind:
        case inspect.Metadata(type=inner, extra_json_schema=extra):
            return {**_schema(inner), **(extra or {})}
        case inspect.UnionType():
            return _schema(_of_union(kind))
        case inspect.StructType(cls=cls, fields=fields) | inspect.DataclassType(cls=cls, fields=fields):
            texts = field_docstrings(cls)
            described = {
                field.name: {
                    **_schema(field.type),
                    "description": texts.get(field.name, ""),
                }
                for field in fields
            }
            if any(map(_has_finite_default, fields)):
                described[NOT_FINITE] = _NAMES
            required = [field.name for field in fields if not _may_be_unknown(field.type)]
            return {"type": "object", "properties": described, "required": required}
        case inspect.DictType(value_type=item):
            return {"type": "object", "properties": {}, "additionalProperties": _item(item)}
        case inspect.EnumType(cls=members):
            return {"type": "string", "enum": [one.value for one in members]}
        case inspect.VarTupleType(item_type=item, min_length=least, max_length=most):
            return _array(item, least, most)
        case inspect.TupleType(item_types=items):
            return _array(items[0], len(items), len(items))
        case _:
            return {"type": _WORDS[type(kind)]}


def _array(item: inspect.Type, least: int | None, most: int | None) -> dict[str, object]:
    """Return the schema of an array.

    An array of numbers needs a maximum length, because only then can its schema allow null.
    """
    bounds = {name: bound for name, bound in (("minItems", least), ("maxItems", most)) if bound is not None}
    if not _may_be_unknown(item):
        return {"type": "array", "items": _schema(item), **bounds}
    if most is None:
        raise TypeError("an array of numbers in a record needs a maximum length: Meta(max_length=…)")
    return {"type": "array", "prefixItems": [_item(item)] * most, "items": _schema(item), **bounds}


def _item(kind: inspect.Type) -> dict[str, object]:
    """Return the schema of a value that is null if unknown."""
    schema = _schema(kind)
    return {**schema, "type": [schema["type"], "null"]} if _may_be_unknown(kind) else schema


def _has_finite_default(field: inspect.Field) -> bool:
    """Return whether a field is a number that has a finite default and that an older message may lack."""
    return isinstance(field.type, inspect.FloatType) and not field.required and math.isfinite(field.default)


def _may_be_unknown(kind: inspect.Type) -> bool:
    """Return whether a value may be one that JSON cannot represent: NaN, infinite or None."""
    match kind:
        case inspect.Metadata(type=inner):
            return _may_be_unknown(inner)
        case inspect.UnionType(types=types):
            return any(map(_may_be_unknown, types))
        case _:
            return isinstance(kind, (inspect.FloatType, inspect.NoneType))


_WORDS: Mapping[type[inspect.Type], str] = {
    inspect.FloatType: "number",
    inspect.IntType: "integer",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
}


def _of_union(kind: inspect.UnionType) -> inspect.Type:
    """Return the type of a union, ignoring None. A union of int and float counts as float."""
    present = [one for one in kind.types if not isinstance(one, inspect.NoneType)]
    return next((one for one in present if isinstance(one, inspect.FloatType)), present[0])


def _drop_nulls(value: Any, kind: inspect.Type) -> Any:
    """Return parsed JSON without the fields of a record that are null."""
    match kind, value:
        case inspect.UnionType(), _ if value is not None:
            return _drop_nulls(value, _of_union(kind))
        case inspect.StructType(fields=fields) | inspect.DataclassType(fields=fields), dict():
            types = {field.name: field.type for field in fields}
            known = {name: _drop_nulls(each, types[name]) for name, each in value.items() if each is not None}
            lost = [field.name for field in fields if _has_finite_default(field) and field.name not in known]
            return {**known, NOT_FINITE: lost} if lost else known
        case _:
            return value


def _with_nan(value: Any, kind: inspect.Type) -> Any:
    """Return parsed JSON with NaN for every number that is null, or that is missing and has no default."""
    match kind, value:
        case inspect.Metadata(type=inner), _:
            return _with_nan(value, inner)
        case inspect.FloatType(), None:
            return math.nan
        case inspect.UnionType(), None:
            return None if any(isinstance(one, inspect.NoneType) for one in kind.types) else math.nan
        case inspect.UnionType(), _:
            return _with_nan(value, _of_union(kind))
        case inspect.StructType(fields=fields) | inspect.DataclassType(fields=fields), dict():
            known = {field.name: field.type for field in fields}
            lost = value.get(NOT_FINITE)
            named = lost if isinstance(lost, list) else ()
            missing = {
                field.name: math.nan
                for field in fields
                if isinstance(field.type, inspect.FloatType) and (field.required or field.name in named)
            }
            there = {name: _with_nan(value[name], known[name]) for name in known.keys() & value.keys()}
            return missing | there
        case inspect.DictType(value_type=item), dict():
            return {name: _with_nan(each, item) for name, each in value.items()}
        case inspect.VarTupleType(item_type=item), list():
            return [_with_nan(each, item) for each in value]
        case inspect.TupleType(item_types=items), list():
            return [_with_nan(each, items[0]) for each in value]
        case _:
            return value


def _plain(value: Any) -> object:
    """Convert NumPy scalars and arrays to Python values."""
    return value.tolist()


def _escape_surrogates(value: Any) -> object:
    """Escape lone surrogates in a value, which result from undecodable bytes in a path."""
    match value:
        case str():
            return value.encode(errors="backslashreplace").decode()
        case dict():
            return {_escape_surrogates(key): _escape_surrogates(item) for key, item in value.items()}
        case list() | tuple():
            return [_escape_surrogates(item) for item in value]
        case _:
            return value


NOT_FINITE = "not_finite"
_NAMED = f'"{NOT_FINITE}"'.encode()
_NAMES: dict[str, object] = {
    "type": "array",
    "items": {"type": "string"},
    "description": "Names of the fields that are left out because their numbers are not finite.",
}
_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_NULL = b"null"
_to_json = msgspec.json.Encoder(enc_hook=_plain).encode

CYCLE = Topic("/cycle", records.CycleRecord, "controlled_at")
SENSOR = Topic("/sensor", records.SensorRecord)
LINK = Topic("/link", records.LinkRecord)
WIRE = Topic("/wire", records.WireRecord)
TRUTH = Topic("/truth", records.TruthRecord)
EVENT = Topic("/event", records.EventRecord)
STEP = Topic("/step", records.StepRecord)
TOPICS = (CYCLE, SENSOR, LINK, WIRE, TRUTH, EVENT, STEP)
RECORDS = frozenset(topic.record for topic in TOPICS)
"""Types of all records."""
