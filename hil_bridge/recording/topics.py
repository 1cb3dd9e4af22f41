"""The topics of a record: one table gives the JSON schema, the encoder and the decoder of each.

Messages are JSON with a JSON schema, so that Foxglove and PlotJuggler open a record as it is. A number
that is not finite is written as null and read back as NaN: JSON knows neither NaN nor infinity.
"""

import inspect
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import msgspec
import msgspec.structs

from hil_bridge.control.loop import Sample
from hil_bridge.recording.records import CycleRecord, EventRecord, LinkRecord, SensorRecord, TruthRecord

Record: TypeAlias = CycleRecord | SensorRecord | LinkRecord | TruthRecord | EventRecord


def _number(value: object) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError("is not a number")
    return float(value)


def _optional_number(value: object) -> float | None:
    return None if value is None else _number(value)


def _integer(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError("is not a whole number")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError("is not a text")
    return value


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError("is neither true nor false")
    return value


def _numbers_by_name(value: object) -> dict[str, float]:
    if not isinstance(value, dict):
        raise ValueError("is not an object")
    return {str(name): _number(number) for name, number in value.items()}


class Kind(NamedTuple):
    """What a column holds.

    A schema's type is a single word even where null is possible, and an object always has properties:
    Foxglove's schema reader takes nothing else.
    """

    schema: Mapping[str, object]
    """JSON schema of the column."""
    decode: Callable[[object], Any]
    """Parsed JSON to the record's value; raises ValueError."""


def _list_of(item: Kind, count: int | None = None) -> Kind:
    def decode(value: object) -> tuple[Any, ...]:
        if not isinstance(value, list) or (count is not None and len(value) != count):
            raise ValueError("is not a list" if count is None else f"is not a list of {count}")
        return tuple(item.decode(element) for element in value)

    return Kind({"type": "array", "items": item.schema}, decode)


def _object_of(record: type[Any], kinds: Mapping[str, Kind]) -> Kind:
    """A whole value of its own, or null for None. Every field is kept, also those to come; what an older recording
    does not hold stands at its default.
    """
    optional = {field.name for field in msgspec.structs.fields(record) if not field.required}

    def decode(value: object) -> Any:
        if value is None:
            return None
        if not isinstance(value, dict):
            raise ValueError("is not an object")
        if missing := kinds.keys() - value.keys() - optional:
            raise ValueError(f"lacks {', '.join(sorted(missing))}")
        return record(**{name: kind.decode(value[name]) for name, kind in kinds.items() if name in value})

    schema = {"type": "object", "properties": {name: kind.schema for name, kind in kinds.items()}}
    return Kind(schema, decode)


NUMBER = Kind({"type": "number"}, _number)
OPTIONAL_NUMBER = Kind({"type": "number"}, _optional_number)
INTEGER = Kind({"type": "integer"}, _integer)
TEXT = Kind({"type": "string"}, _text)
FLAG = Kind({"type": "boolean"}, _flag)
NUMBERS_BY_NAME = Kind({"type": "object", "properties": {}}, _numbers_by_name)
VECTOR = _list_of(NUMBER, 3)
QUATERNION = _list_of(NUMBER, 4)
WRENCH = _list_of(NUMBER, 6)
JOINTS = _list_of(NUMBER, 6)
COUNTS = _list_of(INTEGER, 6)
TEXTS = _list_of(TEXT)
_KINDS = {
    "float": NUMBER,
    "int": INTEGER,
    "bool": FLAG,
    "str": TEXT,
    "tuple[float, float, float]": VECTOR,
    "tuple[float, ...]": _list_of(NUMBER),
    "tuple[int, ...]": _list_of(INTEGER),
    "float | None": OPTIONAL_NUMBER,
}
SAMPLE = _object_of(
    Sample, {name: _KINDS[inspect.formatannotation(kind)] for name, kind in Sample.__annotations__.items()}
)


@dataclass(frozen=True)
class Topic:
    """One stream of records of one type."""

    name: str
    record: type[Record]
    time: str
    """The column that places a message on the time axis."""
    columns: tuple[tuple[str, Kind, str], ...]
    """Name as in the record, kind, meaning with unit."""
    added: tuple[str, ...] = ()
    """Columns that older records lack; they have the record's defaults."""

    @property
    def schema_name(self) -> str:
        return f"hil_bridge.{self.record.__name__}"

    @property
    def schema(self) -> dict[str, object]:
        """JSON schema of a message."""
        properties = {name: {**kind.schema, "description": text} for name, kind, text in self.columns}
        return {"title": self.schema_name, "type": "object", "properties": properties}

    @cached_property
    def time_of(self) -> Callable[[Any], float]:
        """Time of a record on the run's clock, s."""
        return operator.attrgetter(self.time)

    def encode(self, record: Record) -> bytes:
        """A record as compact strict JSON."""
        try:
            return _to_json(record)
        except UnicodeEncodeError:
            return _to_json(_whole(msgspec.to_builtins(record, enc_hook=_plain)))

    def decode(self, data: bytes) -> Record:
        """The record of a message; columns that are unknown are ignored.

        Raises ValueError naming the column that is missing or wrong.
        """
        message = msgspec.json.decode(data)
        if not isinstance(message, dict):
            raise ValueError("the message is not an object")
        values = {}
        for name, kind, _ in self.columns:
            if name not in message:
                if name in self.added:
                    continue
                raise ValueError(f"{name} is missing")
            try:
                values[name] = kind.decode(message[name])
            except (ValueError, OverflowError) as error:
                raise ValueError(f"{name} {error}") from error
        return self.record(**values)


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


CYCLE = Topic(
    "/cycle",
    CycleRecord,
    "controlled_at",
    (
        ("cycle", INTEGER, "number of the control cycle"),
        ("phase", TEXT, "connect, tare, approach, track, retract or end"),
        ("started_at", NUMBER, "s, the status order is handed to the link"),
        ("status_at", NUMBER, "s, the status answer is complete"),
        ("sensor_at", NUMBER, "s, arrival of the sensor frame used"),
        ("controlled_at", NUMBER, "s, controller and supervisor are done"),
        ("sent_at", NUMBER, "s, the move order is handed to the link, whose bid may be out already"),
        ("answered_at", NUMBER, "s, the move order's answer is complete"),
        ("sensor_sequence", INTEGER, "frame counter of the sensor frame used"),
        ("force", NUMBER, "N along the approach direction, positive while pressing"),
        ("force_reference", NUMBER, "N"),
        ("wrench", WRENCH, "fx fy fz mx my mz on the tool in the tool frame, N and N·m"),
        ("position", VECTOR, "m, reported tool position in the robot base frame"),
        ("quaternion", QUATERNION, "reported orientation, tool in base, w x y z"),
        ("depth", NUMBER, "m along the approach direction from the start point, reported"),
        ("depth_commanded", NUMBER, "m along the approach direction from the start point, as sent"),
        ("travel_commanded", NUMBER, "m along the tangential direction from the start point"),
        ("correction", NUMBER, "m, the feedback law's part"),
        ("stiffness", OPTIONAL_NUMBER, "N/m, estimate of the contact stiffness"),
        ("gain", NUMBER, "factor of the adaptation on the feedback law's output"),
        ("held", FLAG, "the controller chose not to move"),
        ("in_contact", FLAG, "the tool touches the surface"),
        ("verdict", TEXT, "allow, clamp or stop"),
        ("reasons", TEXTS, "why the supervisor clamped or stopped"),
        ("explanation", NUMBERS_BY_NAME, "what else explains the controller's answer"),
        (
            "target",
            VECTOR,
            "m, tool position that was allowed, robot base frame, before rounding to device steps",
        ),
        ("start", VECTOR, "m, reported tool position at the start point"),
        ("asked", TEXT, "why the run was asked to finish before this decision, or empty"),
        ("sample", SAMPLE, "all that the decision was given"),
        ("status_transmitted_at", NUMBER, "s, the status order's last character has left the line, reckoned"),
        ("decoded_at", NUMBER, "s, the sensor frame used had been decoded"),
        ("proposed_at", NUMBER, "s, the controller is done"),
        ("transmitted_at", NUMBER, "s, the move order's last character has left the line, reckoned"),
        ("sensor_counter", INTEGER, "counter of the sensor frame used, as the device sent it"),
    ),
)
SENSOR = Topic(
    "/sensor",
    SensorRecord,
    "at",
    (
        ("at", NUMBER, "s, arrival of the frame"),
        ("sequence", INTEGER, "frame counter"),
        ("counts", COUNTS, "fx fy fz mx my mz, full scale = 16384"),
    ),
)
LINK = Topic(
    "/link",
    LinkRecord,
    "at",
    (
        ("at", NUMBER, "s, the first piece was sent or received"),
        (
            "pieces",
            TEXTS,
            "log of the computer link: s since `at`, then tx or rx as the PC sees it and bytes, or -- and an event",
        ),
    ),
)
TRUTH = Topic(
    "/truth",
    TruthRecord,
    "at",
    (
        ("cycle", INTEGER, "number of the control cycle"),
        ("at", NUMBER, "s, the moment of position, force and joints: the end of the cycle"),
        ("sampled_at", NUMBER, "s, the sensor measured the sample that the controller was given"),
        ("motion_at", NUMBER, "s, the position loops took the first set point that the cycle's order caused"),
        ("position", VECTOR, "m, true tool position in the robot base frame"),
        ("force", VECTOR, "N, force of the surface on the tool tip in the robot base frame"),
        ("joints_deg", JOINTS, "°, axes 1 to 6"),
        ("faults", TEXTS, "injected faults that were under way"),
    ),
    added=("faults",),
)
EVENT = Topic(
    "/event",
    EventRecord,
    "at",
    (
        ("at", NUMBER, "s"),
        ("kind", TEXT, "what sort of event"),
        ("text", TEXT, "what happened"),
    ),
)
TOPICS = (CYCLE, SENSOR, LINK, TRUTH, EVENT)
