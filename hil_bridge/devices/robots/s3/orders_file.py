"""Orders that a site defines, read from a TOML file.

One table per order, with the order's name; bytes are counted from the first byte of the telegram, so that data begin at
byte 8:

    [read_register]
    function = 6                        # 1 to 255
    meaning = "read a register"
    mark = "observed"                   # observed, derived, standard, assumed (default), chosen
    suffixes = { 0 = "one register" }   # default: 0 alone; the first one is sent unless another is requested
    order_length = 10                   # of the complete telegram, padded with 0; default: where the fields end
    answer_length = 12
    blocks = "one"                      # "several": the order may be longer than a block
    extends = false                     # true: the fields are added to those of a known order
    order = [{ name = "number", byte = 8, type = "u16", meaning = "register number" }]
    answer = [
        { name = "number", byte = 8, type = "u16" },
        { name = "value", byte = 10, type = "s16", scale = 0.1, unit = "V", mark = "assumed" },
    ]
    emulator = { memory = "register", key = ["number"], initial = { value = 1.5 } }

Types are u8 s8 u16 s16 u32 s32 f32, big-endian, and `bytes` for the last field: the rest of the telegram. Source of the
telegram's format: computer-link specification, section 3.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import TOML_LIMIT_BYTES, format_value, parse_toml, read_text
from protocol import fields
from protocol.devices.s3.adlp import HEADER_SIZE
from protocol.devices.s3.arap import (
    FIELD_TYPES,
    DefinitionError,
    Emulation,
    OrderBook,
    OrderDefinition,
    Payload,
    Rest,
    field_size,
)
from protocol.marks import Mark

SUFFIX_DIGITS = 5
"""Maximum number of digits of a function suffix. Standard: a suffix is a 16-bit word (computer-link specification,
section 3).
"""

_MarkName = Literal["observed", "derived", "standard", "assumed", "chosen"]
_TypeName = Literal["u8", "s8", "u16", "s16", "u32", "s32", "f32", "bytes"]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _FieldTable(_Table):
    """Table of a field of an order or of an answer."""

    name: str
    byte: int
    type: _TypeName
    scale: float = 1.0
    unit: str = ""
    mark: _MarkName | None = None
    meaning: str = ""


class _EmulatorTable(_Table):
    """Table that describes the answers of the emulated controller."""

    memory: str = ""
    key: list[str] = []
    initial: dict[str, float] = {}


class _OrderTable(_Table):
    """Table of an order."""

    function: int
    meaning: str = ""
    mark: _MarkName = "assumed"
    suffixes: dict[str, str] = Field(default={"0": ""}, min_length=1)
    order_length: int | None = None
    answer_length: int | None = None
    blocks: Literal["one", "several"] = "one"
    extends: bool = False
    order: list[_FieldTable] = []
    answer: list[_FieldTable] = []
    emulator: _EmulatorTable = _EmulatorTable()


def read_orders(path: Path, max_telegram: int) -> OrderBook:
    """Return the known orders and the orders of a file. Raises ConfigError that names the file and the invalid
    entry.
    """
    return parse_orders(read_text(path, TOML_LIMIT_BYTES), max_telegram, str(path))


def parse_orders(text: str, max_telegram: int, source: str = "orders") -> OrderBook:
    """Return the known orders and the orders that a TOML text defines. Errors as for `read_orders`.

    No field may lie beyond `max_telegram` bytes.
    """
    values = parse_toml(text, source)
    try:
        return OrderBook([_definition(name, value) for name, value in values.items()], max_telegram)
    except DefinitionError as error:
        raise ConfigError(f"{source}: {_format_path(error.path, values)}: {error}") from error


def _format_path(path: Sequence[str | int], values: Any) -> str:
    """Return the path of an entry for display. A field is identified by its name, or by its number, starting at 1,
    if it has no name.
    """
    parts, item = [], values
    for part in path:
        item = item[part] if isinstance(part, int) else item.get(part) if isinstance(item, dict) else None
        name = item.get("name") if isinstance(part, int) and isinstance(item, dict) else None
        parts.append(str(name or part + 1) if isinstance(part, int) else part)
    return ".".join(parts)


def _definition(name: str, value: object) -> OrderDefinition:
    try:
        table = _OrderTable.model_validate(value)
    except ValidationError as error:
        raise _explain(name, error) from error
    for suffix in table.suffixes:
        if not (suffix.isdecimal() and len(suffix) <= SUFFIX_DIGITS):
            raise DefinitionError("a suffix must be a whole number", name, "suffixes", suffix)
    initial = dict(table.emulator.initial)
    return OrderDefinition(
        name,
        table.function,
        _payload(name, "order", table.order, table.order_length, table.mark),
        _payload(name, "answer", table.answer, table.answer_length, table.mark),
        {int(suffix): meaning for suffix, meaning in table.suffixes.items()},
        Mark(table.mark),
        table.meaning,
        table.blocks,
        table.extends,
        Emulation(table.emulator.memory, tuple(table.emulator.key), initial),
    )


def _payload(name: str, part: str, items: list[_FieldTable], length: int | None, mark: _MarkName) -> Payload:
    fixed, rest = list(items), None
    if items and items[-1].type == "bytes":
        last = fixed.pop()
        rest = Rest(last.name, Mark(last.mark or mark), last.meaning)
        if length is not None:
            raise DefinitionError(
                "a field of type bytes sets the length; remove this", name, f"{part}_length"
            )
        if {"scale", "unit"} & last.model_fields_set:
            raise DefinitionError("a field of type bytes has no scale and no unit", name, part, len(fixed))
        length = last.byte
    for index, item in enumerate(fixed):
        if item.type == "bytes":
            raise DefinitionError("only the last field can have the type bytes", name, part, index, "type")
    parsed = tuple(
        fields.Field(
            item.name,
            item.byte - HEADER_SIZE,
            FIELD_TYPES[item.type],
            Mark(item.mark or mark),
            item.meaning,
            item.scale,
            item.unit,
        )
        for item in fixed
        if item.type != "bytes"
    )
    end = max((field.offset + field_size(field) for field in parsed), default=0)
    size = end if length is None else length - HEADER_SIZE
    return Payload(fields.Layout(f"{name} {part}", size, ">", parsed), rest)


def _explain(name: str, error: ValidationError) -> DefinitionError:
    """Return an error for the first invalid entry."""
    first: Any = error.errors()[0]
    got = f", got {format_value(first['input'])}"
    match first["type"]:
        case "extra_forbidden":
            table = _EmulatorTable if "emulator" in first["loc"] else _FieldTable
            known = _OrderTable.model_fields if len(first["loc"]) == 1 else table.model_fields
            text = f"unknown entry; known: {', '.join(known)}"
        case "missing":
            text = "is missing"
        case "model_type":
            text = f"must be a table{got}"
        case _:
            text = first["msg"].replace("Input should", "must", 1) + got
    return DefinitionError(text, name, *first["loc"])
