"""Definitions of orders as data. One definition determines the encoder, the decoder, the description and the
emulated answer.

The definitions in `KNOWN_ORDERS` are from the computer-link specification, section 3. A site adds its own
definitions.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

from protocol.devices.s3.adlp import HEADER_SIZE, LinkProfile
from protocol.devices.s3.arap import layouts
from protocol.devices.s3.arap.blocks import split_telegram
from protocol.devices.s3.arap.codes import FunctionCode, TelegramType, function_text, suffixes_of
from protocol.devices.s3.arap.payload import Payload, Rest, Value, field_size
from protocol.devices.s3.arap.telegram import Telegram
from protocol.endpoint import LocalProtocolError
from protocol.fields import Layout
from protocol.marks import Mark

Blocks: TypeAlias = Literal["one", "several"]
RESERVED_NAMES = frozenset(("suffix",))
"""Names that no field may have, because they have another meaning in a call."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")
_EMPTY = Payload(layouts.EMPTY)


class DefinitionError(ValueError):
    """Invalid definition of an order. `path` is the location of the error: part, number of the field, entry."""

    def __init__(self, text: str, *path: str | int) -> None:
        super().__init__(text)
        self.path = path


@dataclass(frozen=True)
class Emulation:
    """Rules for the answers of an emulated controller, whose memory returns the values that were written to it.

    Every field of an order that is not a key is stored. A field of the answer has the value of the order's field
    with the same name. If the order has none, the answer's field has the stored value with that name; if none is
    stored, its initial value; and if it has none, 0.
    """

    memory: str = ""
    """Name of the memory. Orders with the same name share one memory. If it is empty, nothing is stored."""
    key: tuple[str, ...] = ()
    """Fields of the order that select the location in the memory, such as the number of a register."""
    initial: Mapping[str, Value] = field(default_factory=dict)
    """Initial values of the answer's fields, in the units of the fields."""


@dataclass(frozen=True)
class OrderDefinition:
    """Definition of one order and its answer."""

    name: str
    """Name with which the order is called."""
    function: int
    """Function code of the order."""
    order: Payload = _EMPTY
    answer: Payload = _EMPTY
    suffixes: Mapping[int, str] = field(default_factory=lambda: {0: ""})
    """Function suffixes that the order may have, with their meanings. The first one is the default."""
    mark: Mark = Mark.OBSERVED
    meaning: str = ""
    blocks: Blocks = "one"
    """Whether the order may be sent in several blocks. An answer always may."""
    extends: bool = False
    """Whether the fields are added to the fields of the known order with this function code."""
    emulation: Emulation = Emulation()

    def telegrams(
        self, values: Mapping[str, Value], suffix: int | None, profile: LinkProfile
    ) -> tuple[Telegram, ...]:
        """Encode the order with these values, given in the units of the fields, for a link with this profile.

        Raises LocalProtocolError that names what is unknown, out of range or too long.
        """
        chosen = next(iter(self.suffixes)) if suffix is None else suffix
        if chosen not in self.suffixes:
            known = ", ".join(map(str, self.suffixes))
            raise LocalProtocolError(f"{self.name} has no suffix {chosen}, only {known}")
        data = self.order.encode(values)
        if self.function == FunctionCode.MOVE:
            data = data.ljust(profile.move_length - HEADER_SIZE, b"\0")
        length = len(data) + HEADER_SIZE
        if self.blocks == "one" and length > profile.max_telegram:
            raise LocalProtocolError(
                f"{self.name}: a telegram of {length} bytes is too long for a block of {profile.max_telegram}"
            )
        return split_telegram(Telegram(self.function, TelegramType.ORDER, chosen, data), profile.max_telegram)


def _known(
    function: FunctionCode, order: Layout, answer: Payload = _EMPTY, suffixes: Sequence[int] = (0,)
) -> OrderDefinition:
    meanings = suffixes_of(function) or dict.fromkeys(suffixes, "")
    name = function_text(function).replace(" ", "_")
    return OrderDefinition(name, function, Payload(order), answer, meanings, meaning=function_text(function))


KNOWN_ORDERS = (
    _known(FunctionCode.START_PROGRAM, layouts.START_PROGRAM),
    _known(FunctionCode.STOP_PROGRAM, layouts.STOP_PROGRAM),
    _known(FunctionCode.READ_STATUS, layouts.READ_STATUS, Payload(layouts.STATUS)),
    _known(FunctionCode.WRITE_MODE, layouts.WRITE_MODE),
    _known(FunctionCode.MOVE, layouts.MOVE),
    _known(
        FunctionCode.RECEIVE_PROGRAM,
        layouts.RECEIVE_PROGRAM,
        Payload(layouts.PROGRAM_ANSWER, Rest("content", Mark.OBSERVED, "the program's bytes")),
        (1,),
    ),
)
"""Orders with a known payload. Assumed: where no answer is listed, the answer carries no data."""
_KNOWN_FUNCTIONS = {known.function: known for known in KNOWN_ORDERS}
_EXTENDABLE = _KNOWN_FUNCTIONS.keys() - {FunctionCode.RECEIVE_PROGRAM}


def merged(extension: OrderDefinition) -> OrderDefinition:
    """Return the known order together with the fields that an extension adds."""
    known = _KNOWN_FUNCTIONS[extension.function]
    return replace(
        extension,
        order=_merge(known.order, extension.order),
        answer=_merge(known.answer, extension.answer),
        suffixes={**known.suffixes, **extension.suffixes},
    )


def _merge(known: Payload, more: Payload) -> Payload:
    layout = replace(
        more.layout,
        size=max(known.layout.size, more.layout.size),
        fields=known.layout.fields + more.layout.fields,
    )
    return Payload(layout, more.rest)


def check_definition(definition: OrderDefinition, max_telegram: int) -> None:
    """Raise DefinitionError for the first error in a site's definition."""
    if not _NAME.fullmatch(definition.name):
        raise DefinitionError(
            "a name consists of lower-case letters, digits and underscores, and starts with a letter"
        )
    if any(definition.name == known.name for known in KNOWN_ORDERS):
        raise DefinitionError("this name belongs to an order with a known payload; choose another")
    _check_function(definition)
    for suffix in definition.suffixes:
        if not 0 <= suffix <= 0xFFFF:
            raise DefinitionError(f"{suffix} is outside 0 … 65535", "suffixes", str(suffix))
    if not definition.suffixes:
        raise DefinitionError("at least one is required", "suffixes")
    if definition.blocks == "several" and definition.order.rest is None:
        raise DefinitionError("only an order with a field of type bytes needs several blocks", "blocks")
    known = _KNOWN_FUNCTIONS.get(definition.function)
    _check_payload("order", definition.order, _spans(known.order.layout) if known else (), max_telegram)
    _check_payload("answer", definition.answer, _spans(known.answer.layout) if known else (), max_telegram)
    _check_emulation(definition)


def _check_function(definition: OrderDefinition) -> None:
    function = definition.function
    if not 1 <= function <= 0xFF:
        raise DefinitionError(f"{function} is outside 1 … 255", "function")
    if definition.extends:
        if function not in _EXTENDABLE:
            codes = ", ".join(str(int(code)) for code in sorted(_EXTENDABLE))
            raise DefinitionError(f"only the functions {codes} can be extended", "extends")
    elif function in _KNOWN_FUNCTIONS or function == FunctionCode.SPONTANEOUS:
        hint = ", or extends = true to add fields" if function in _EXTENDABLE else ""
        raise DefinitionError(
            f"the payload of {function} ({function_text(function)}) is known; use another code{hint}",
            "function",
        )


_Spans: TypeAlias = tuple[tuple[int, int, str], ...]


def _spans(layout: Layout) -> _Spans:
    """Return, for every field, its first data byte, the byte after its last one, and its name."""
    return tuple((item.offset, item.offset + field_size(item), item.name) for item in layout.fields)


def _check_payload(part: str, payload: Payload, occupied: _Spans, max_telegram: int) -> None:
    """Check the fields of one direction together with the known fields. Raises DefinitionError."""
    names = [name for _, _, name in occupied]
    for index, name in enumerate(payload.names):
        if not _NAME.fullmatch(name) or name in RESERVED_NAMES:
            raise DefinitionError(f"{name!r} cannot be the name of a field", part, index, "name")
        if name in names:
            raise DefinitionError(f"the name {name} is used twice", part, index, "name")
        names.append(name)
    for index, item in enumerate(payload.layout.fields):
        if not (math.isfinite(item.scale) and item.scale):
            raise DefinitionError("must be a number other than 0", part, index, "scale")
    spans = _spans(payload.layout)
    for index, (begin, end, _) in enumerate(spans):
        fault = _position_fault(begin, end, (*occupied, *spans[:index]), max_telegram)
        if fault:
            raise DefinitionError(fault, part, index, "byte")
    end = HEADER_SIZE + max((end for _, end, _ in (*spans, *(occupied if payload.rest else ()))), default=0)
    length = payload.layout.size + HEADER_SIZE
    if not end <= length <= max_telegram:
        entry = (part, len(spans), "byte") if payload.rest else (f"{part}_length",)
        raise DefinitionError(
            f"{length} must be between {end}, the end of the fields, and {max_telegram}, the end of a block",
            *entry,
        )


def _position_fault(begin: int, end: int, others: _Spans, max_telegram: int) -> str:
    """Return the reason why a field may not occupy these bytes of the data; empty if it may."""
    first, last = begin + HEADER_SIZE, end + HEADER_SIZE - 1
    if begin < 0:
        return f"{first} is inside the header; data begin at byte {HEADER_SIZE}"
    if last >= max_telegram:
        return f"the field ends with byte {last}, past a block of {max_telegram} bytes"
    for other_begin, other_end, name in others:
        if begin < other_end and other_begin < end:
            there = f"{other_begin + HEADER_SIZE} to {other_end + HEADER_SIZE - 1}"
            return f"bytes {first} to {last} overlap the field {name} at {there}"
    return ""


def _check_emulation(definition: OrderDefinition) -> None:
    emulation = definition.emulation
    fixed = [item.name for item in definition.order.layout.fields]
    for name in emulation.key:
        if name not in fixed:
            raise DefinitionError(f"the order has no numeric field {name}", "emulator", "key")
    if emulation.key and not emulation.memory:
        raise DefinitionError("a key requires the name of a memory", "emulator", "key")
    for name, value in emulation.initial.items():
        try:
            definition.answer.encode({name: value})
        except LocalProtocolError as error:
            raise DefinitionError(str(error), "emulator", "initial", name) from error
