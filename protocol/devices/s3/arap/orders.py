"""Known facts of an order, as data: one definition gives encoder, decoder, description and emulated answer.

The definitions of `KNOWN_ORDERS` are those of the computer-link specification, section 3; a site adds its own.
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
"""Names that no field may have: a call gives them another meaning."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")
_EMPTY = Payload(layouts.EMPTY)


class DefinitionError(ValueError):
    """A definition of an order cannot be; `path` is where: part, number of the field, entry."""

    def __init__(self, text: str, *path: str | int) -> None:
        super().__init__(text)
        self.path = path


@dataclass(frozen=True)
class Emulation:
    """Answers of an emulated controller: its memory gives back the bytes that were written into it.

    Every field of an order that is no key is stored. A field of the answer has the value of the order's field of that
    name. Else it has the stored value of that name, else its initial value, else 0.
    """

    memory: str = ""
    """Name of the memory; orders that name the same one share it. Empty: nothing is stored."""
    key: tuple[str, ...] = ()
    """Fields of the order that choose the place in the memory, such as the number of a register."""
    initial: Mapping[str, Value] = field(default_factory=dict)
    """Values of the answer's fields, in their units, before anything was written."""


@dataclass(frozen=True)
class OrderDefinition:
    """One order with its answer."""

    name: str
    """How it is called."""
    function: int
    """Function code."""
    order: Payload = _EMPTY
    answer: Payload = _EMPTY
    suffixes: Mapping[int, str] = field(default_factory=lambda: {0: ""})
    """Function suffixes that the order may have, with their meanings; the first is the usual one."""
    mark: Mark = Mark.OBSERVED
    meaning: str = ""
    blocks: Blocks = "one"
    """Whether the order may travel in several blocks; an answer always may."""
    extends: bool = False
    """The fields come beside those of the known order with this function code."""
    emulation: Emulation = Emulation()

    def telegrams(
        self, values: Mapping[str, Value], suffix: int | None, profile: LinkProfile
    ) -> tuple[Telegram, ...]:
        """Encode the order with these values in their units, for a link with this profile.

        Raises LocalProtocolError naming what is unknown, out of range or too long.
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
"""Orders whose payload is known. That their answers carry no data, where none are listed, is assumed."""
_KNOWN_FUNCTIONS = {known.function: known for known in KNOWN_ORDERS}
_EXTENDABLE = _KNOWN_FUNCTIONS.keys() - {FunctionCode.RECEIVE_PROGRAM}


def merged(extension: OrderDefinition) -> OrderDefinition:
    """Return the known order with the fields that an extension adds."""
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
    """Raise DefinitionError for the first thing in a site's definition that cannot be."""
    if not _NAME.fullmatch(definition.name):
        raise DefinitionError("a name is small letters, digits and underscores, a letter first")
    if any(definition.name == known.name for known in KNOWN_ORDERS):
        raise DefinitionError("this name is that of an order whose payload is known; choose another")
    _check_function(definition)
    for suffix in definition.suffixes:
        if not 0 <= suffix <= 0xFFFF:
            raise DefinitionError(f"{suffix} is outside 0 … 65535", "suffixes", str(suffix))
    if not definition.suffixes:
        raise DefinitionError("there must be at least one", "suffixes")
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
    """First byte of the data, the one behind the last, and name of every field."""
    return tuple((item.offset, item.offset + field_size(item), item.name) for item in layout.fields)


def _check_payload(part: str, payload: Payload, taken: _Spans, max_telegram: int) -> None:
    """Check the fields of one direction beside those that are known already."""
    names = [name for _, _, name in taken]
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
        fault = _place_fault(begin, end, (*taken, *spans[:index]), max_telegram)
        if fault:
            raise DefinitionError(fault, part, index, "byte")
    end = HEADER_SIZE + max((end for _, end, _ in (*spans, *(taken if payload.rest else ()))), default=0)
    length = payload.layout.size + HEADER_SIZE
    if not end <= length <= max_telegram:
        entry = (part, len(spans), "byte") if payload.rest else (f"{part}_length",)
        raise DefinitionError(
            f"{length} is not between {end}, where the fields end, and {max_telegram}, where a block ends",
            *entry,
        )


def _place_fault(begin: int, end: int, others: _Spans, max_telegram: int) -> str:
    """Fault of a field that covers these bytes of the data, in words; empty if there is none."""
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
            raise DefinitionError(f"the order has no number {name}", "emulator", "key")
    if emulation.key and not emulation.memory:
        raise DefinitionError("a key needs the name of a memory", "emulator", "key")
    for name, value in emulation.initial.items():
        try:
            definition.answer.encode({name: value})
        except LocalProtocolError as error:
            raise DefinitionError(str(error), "emulator", "initial", name) from error
