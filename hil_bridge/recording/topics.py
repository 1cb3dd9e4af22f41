"""The topics of a record. Schema, encoder and decoder come from the records themselves: their types and docstrings.

Messages are JSON with a JSON schema, so that Foxglove and PlotJuggler open a record as it is. A number
that is not finite is written as null and read back as NaN: JSON knows neither NaN nor infinity.
"""

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import msgspec
from msgspec import inspect

from hil_bridge.field_docstrings import field_docstrings
from hil_bridge.recording.records import (
    CycleRecord,
    EventRecord,
    LinkRecord,
    SensorRecord,
    TruthRecord,
    WireRecord,
)

Record: TypeAlias = CycleRecord | SensorRecord | LinkRecord | WireRecord | TruthRecord | EventRecord


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
        """JSON schema of a message."""
        return {"title": self.schema_name, **_schema(inspect.type_info(self.record))}

    @cached_property
    def time_of(self) -> Callable[[Any], float]:
        """Time of a record on the run's clock, s."""
        return operator.attrgetter(self.time)

    @cached_property
    def _decoder(self) -> msgspec.json.Decoder[Record]:
        return msgspec.json.Decoder(self.record)

    def encode(self, record: Record) -> bytes:
        """A record as compact strict JSON."""
        try:
            return _to_json(record)
        except UnicodeEncodeError:
            return _to_json(_whole(msgspec.to_builtins(record, enc_hook=_plain)))

    def decode(self, data: bytes) -> Record:
        """The record of a message; fields that are unknown are ignored, those to come since have their defaults.

        Raises ValueError naming the field that is missing or wrong.
        """
        try:
            return self._decoder.decode(data)
        except msgspec.ValidationError:  # or there is a null that stands for NaN
            message = _with_nan(msgspec.json.decode(data), inspect.type_info(self.record))
            return msgspec.convert(message, self.record)


def _schema(kind: inspect.Type) -> dict[str, object]:
    """JSON schema of a type as Foxglove's reader takes it. A type is a single word even where null is possible, and an
    object always has properties.
    """
    match kind:
        case inspect.UnionType():
            return _schema(_not_null(kind))
        case inspect.StructType(cls=cls, fields=fields):
            texts = field_docstrings(cls)
            described = {
                field.name: {**_schema(field.type), "description": texts.get(field.name, "")}
                for field in fields
            }
            return {"type": "object", "properties": described}
        case inspect.DictType():
            return {"type": "object", "properties": {}}
        case inspect.VarTupleType(item_type=item):
            return {"type": "array", "items": _schema(item)}
        case inspect.TupleType(item_types=items):
            return {"type": "array", "items": _schema(items[0])}
        case _:
            return {"type": _WORDS[type(kind)]}


_WORDS: Mapping[type[inspect.Type], str] = {
    inspect.FloatType: "number",
    inspect.IntType: "integer",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
}


def _not_null(kind: inspect.UnionType) -> inspect.Type:
    return next(one for one in kind.types if not isinstance(one, inspect.NoneType))


def _with_nan(value: Any, kind: inspect.Type) -> Any:
    """Parsed JSON with NaN for every null that stands where a number must be."""
    match kind, value:
        case inspect.FloatType(), None:
            return math.nan
        case inspect.UnionType(), _ if value is not None:
            return _with_nan(value, _not_null(kind))
        case inspect.StructType(fields=fields), dict():
            known = {field.name: field.type for field in fields}
            return {name: _with_nan(value[name], known[name]) for name in known.keys() & value.keys()}
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
    """The same with half characters, as undecodable bytes of a path leave them, written out."""
    match value:
        case str():
            return value.encode(errors="backslashreplace").decode()
        case dict():
            return {_whole(key): _whole(item) for key, item in value.items()}
        case list() | tuple():
            return [_whole(item) for item in value]
        case _:
            return value


_to_json = msgspec.json.Encoder(enc_hook=_plain).encode

CYCLE = Topic("/cycle", CycleRecord, "controlled_at")
SENSOR = Topic("/sensor", SensorRecord)
LINK = Topic("/link", LinkRecord)
WIRE = Topic("/wire", WireRecord)
TRUTH = Topic("/truth", TruthRecord)
EVENT = Topic("/event", EventRecord)
TOPICS = (CYCLE, SENSOR, LINK, WIRE, TRUTH, EVENT)
