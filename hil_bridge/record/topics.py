"""The topics of a record. Schema, encoder and decoder come from the records themselves: their types and docstrings.

Messages are JSON with a JSON schema, so that Foxglove and PlotJuggler open a record as it is, and every message is
valid by its schema. JSON knows neither NaN nor infinity. A field whose number is not finite, or whose value is not
known, is left out of its message, so that no schema requires it. Within an array, and among values by name, null
stands for such a number, and the schema says so. Both are read back as NaN; a field that may be None, as None. Of a
field with a finite default, which older messages may lack, `not_finite` beside it tells that its number is not.

The readers of Foxglove and Lichtblick take a type of one word only, of fields and of `items`, and refuse a whole topic
else: a field cannot be "number or null". Of arrays they do not look at `prefixItems`, where null is allowed.
Source: parseJsonSchema.ts of foxglove/studio and Lichtblick-Suite/lichtblick. Standard: JSON Schema 2020-12.
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
    """One stream of records of one type."""

    name: str
    record: type[Record]
    time: str = "at"
    """The field that places a message on the time axis."""

    @property
    def schema_name(self) -> str:
        return f"hil_bridge.{self.record.__name__}"

    @property
    def schema(self) -> Mapping[str, object]:
        """JSON schema of a message; its time is always there."""
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
        """Time of a record on the run's clock, s."""
        return operator.attrgetter(self.time)

    @cached_property
    def _decoder(self) -> msgspec.json.Decoder[Any]:
        return msgspec.json.Decoder(self.record)

    def timed(self, record: Record, at: float) -> Record:
        """Return the same record with this time, s on the run's clock."""
        return structs.replace(record, **{self.time: at})

    def encode(self, record: Record) -> bytes:
        """Encode a record as compact strict JSON.

        Its time must be finite, or its message is not valid by the schema.
        """
        try:
            data = _to_json(record)
        except UnicodeEncodeError:
            data = _to_json(_whole(msgspec.to_builtins(record, enc_hook=_plain)))
        if _NULL not in data:  # as of nearly all messages
            return data
        message = _drop_nulls(msgspec.json.decode(data), self._type)
        message.setdefault(self.time)  # without it nothing reads the message
        return _to_json(message)

    def decode(self, data: bytes) -> Record:
        """Decode the record of a message; unknown fields are ignored, missing ones have their defaults.

        Raises ValueError naming the field that is missing or wrong.
        """
        try:
            if _NAMED not in data:
                record: Record = self._decoder.decode(data)
                return record
            return msgspec.convert(_with_nan(msgspec.json.decode(data), self._type), self.record)
        except msgspec.ValidationError:  # or a number is missing, or null, that stands for NaN
            found = msgspec.json.decode(data)
            if isinstance(found, dict) and self.time not in found:
                raise
            return msgspec.convert(_with_nan(found, self._type), self.record)


def schema_of(message: type[msgspec.Struct]) -> dict[str, object]:
    """JSON schema of a message as Foxglove's reader takes it."""
    return {"$schema": _DIALECT, **_schema(inspect.type_info(message))}


def _schema(kind: inspect.Type) -> dict[str, object]:
    """JSON schema of a type as Foxglove's reader takes it: a type is a single word, and an object always has
    properties.
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
        case inspect.EnumType(cls=words):
            return {"type": "string", "enum": [one.value for one in words]}
        case inspect.VarTupleType(item_type=item, min_length=least, max_length=most):
            return _array(item, least, most)
        case inspect.TupleType(item_types=items):
            return _array(items[0], len(items), len(items))
        case _:
            return {"type": _WORDS[type(kind)]}


def _array(item: inspect.Type, least: int | None, most: int | None) -> dict[str, object]:
    """Return the schema of an array.

    One of numbers needs a maximum length, for only then its schema can allow null in it.
    """
    bounds = {name: bound for name, bound in (("minItems", least), ("maxItems", most)) if bound is not None}
    if not _may_be_unknown(item):
        return {"type": "array", "items": _schema(item), **bounds}
    if most is None:
        raise TypeError("an array of numbers in a record needs a most length: Meta(max_length=…)")
    return {"type": "array", "prefixItems": [_item(item)] * most, "items": _schema(item), **bounds}


def _item(kind: inspect.Type) -> dict[str, object]:
    """Return the schema of a value that is null if it is not known."""
    schema = _schema(kind)
    return {**schema, "type": [schema["type"], "null"]} if _may_be_unknown(kind) else schema


def _has_finite_default(field: inspect.Field) -> bool:
    """Whether it is a number that an older message may lack, and that then has a value all the same."""
    return isinstance(field.type, inspect.FloatType) and not field.required and math.isfinite(field.default)


def _may_be_unknown(kind: inspect.Type) -> bool:
    """Whether a value may be no JSON: NaN, infinite or None."""
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
    """Return the type without None. A number that may be whole counts as one that may have a fraction."""
    present = [one for one in kind.types if not isinstance(one, inspect.NoneType)]
    return next((one for one in present if isinstance(one, inspect.FloatType)), present[0])


def _drop_nulls(value: Any, kind: inspect.Type) -> Any:
    """Return parsed JSON without those fields of records that are null."""
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
    """Return parsed JSON with NaN for every number that is null, or missing where it has no default."""
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
    """Array scalars that are no Python numbers, and arrays."""
    return value.tolist()


def _whole(value: Any) -> object:
    """Escape lone surrogates, which undecodable bytes of a path leave, in a value."""
    match value:
        case str():
            return value.encode(errors="backslashreplace").decode()
        case dict():
            return {_whole(key): _whole(item) for key, item in value.items()}
        case list() | tuple():
            return [_whole(item) for item in value]
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
