"""Tables of docs/reference/computer-link.md, generated from the tables that the code itself uses."""

from collections.abc import Callable

from protocol.devices.s3.adlp import HEADER_SIZE, Control, LinkProfile, check_character, encode_block
from protocol.devices.s3.arap import (
    CONTROL_TEXTS,
    HEADER,
    KNOWN_ORDERS,
    REFUSAL,
    SPONTANEOUS,
    TYPE_FLAG,
    TYPE_FLAG_TEXT,
    TYPE_NAMES,
    FunctionCode,
    Mode,
    Payload,
    RefusalCode,
    SpontaneousKind,
    TelegramType,
    field_size,
    read_status,
    refusal_remedy,
    stop_program,
    suffix_text,
    write_mode,
)
from protocol.fields import Field, Layout
from protocol.marks import settings
from tools.pages import table

_TYPES = {**TYPE_NAMES, "d": "f64"}
"""Types of fields. An orders file has no type of eight bytes."""


def control_bytes() -> str:
    """Return the table of control bytes."""
    return table(
        ("byte", "name", "meaning"),
        ((f"`{code:02X}`", code.name.replace("_", " "), CONTROL_TEXTS[code]) for code in Control),
    )


def header() -> str:
    """Return the table of the first bytes of every telegram."""
    return field_table(HEADER, 0)


def types() -> str:
    """Return the table of telegram types and their role in the exchange."""
    flag = f"`+ {TYPE_FLAG:02X}`", f"the same, {TYPE_FLAG_TEXT}"
    return table(("type", "meaning"), [*((f"`{code:02X}`", code.text) for code in TelegramType), flag])


def functions() -> str:
    """Return the function codes, grouped by whether their payload is known."""
    known = {definition.function for definition in KNOWN_ORDERS} | {FunctionCode.SPONTANEOUS}
    names: dict[str, list[str]] = {"known, below": [], "not known": []}
    for code in FunctionCode:
        names["known, below" if code in known else "not known"].append(f"{int(code)} {code.text}")
    return table(("payload", "functions"), ((payload, ", ".join(codes)) for payload, codes in names.items()))


def refusals() -> str:
    """Return the table of refusal codes: their meaning and the remedy."""
    return table(
        ("code", "meaning", "what to do"),
        ((int(code), code.text, refusal_remedy(code)) for code in RefusalCode),
    )


def payloads() -> str:
    """Return the payload tables of every order, answer and message whose payload is known."""
    parts = []
    for definition in KNOWN_ORDERS:
        suffixes = "; ".join(
            f"{suffix} {meaning}".rstrip() for suffix, meaning in definition.suffixes.items()
        )
        parts += [
            f"### {definition.function} {definition.meaning}",
            f"Function suffix: {suffixes}.",
            f"Order, {length(definition.order)}:",
            payload_table(definition.order),
            f"Answer, {length(definition.answer)}:",
            payload_table(definition.answer),
        ]
    kinds = "; ".join(
        f"{int(kind)} {suffix_text(FunctionCode.SPONTANEOUS, kind)}" for kind in SpontaneousKind
    )
    parts += [
        f"### {int(FunctionCode.SPONTANEOUS)} spontaneous, from the S3",
        f"Function suffix: {kinds}.",
        field_table(SPONTANEOUS, HEADER_SIZE),
        "### Refusal of any order",
        field_table(REFUSAL, HEADER_SIZE),
    ]
    return "\n\n".join(parts)


def length(payload: Payload) -> str:
    """Return the size of a complete telegram."""
    least = "at least " if payload.rest else ""
    return f"{least}{payload.layout.size + HEADER_SIZE} bytes"


def payload_table(payload: Payload) -> str:
    """Return the table of a payload's fields. Bytes are counted from the start of the telegram."""
    if not payload.names:
        return "no data"
    if payload.rest is None:
        return field_table(payload.layout, HEADER_SIZE)
    begin = payload.layout.size + HEADER_SIZE
    rest = (f"{begin}…", f"`{payload.rest.name}`", "bytes", "", "", payload.rest.mark, payload.rest.meaning)
    return f"{field_table(payload.layout, HEADER_SIZE)}\n| {' | '.join(map(str, rest))} |"


def field_table(layout: Layout, shift: int) -> str:
    """Return the table of fields with their byte numbers. `shift` is the byte at which the layout begins."""
    return table(
        ("bytes", "name", "type", "unit of one", "range", "mark", "meaning"),
        (
            (
                span(field.offset + shift, field_size(field)),
                f"`{field.name}`",
                _TYPES[field.format],
                step(field),
                ends(field),
                field.mark,
                field.meaning or ", ".join(f"bit {bit}: {words}" for bit, words in field.bits.items()),
            )
            for field in layout.fields
        ),
    )


def span(first: int, size: int) -> str:
    """Return the numbers of the first and last byte, as text."""
    return f"{first}" if size == 1 else f"{first}–{first + size - 1}"


def step(field: Field) -> str:
    """Return the value that one raw unit represents."""
    if field.scale == 1.0:
        return field.unit
    worth = 1.0 / field.scale
    text = f"1/{worth:.0f}" if worth.is_integer() and worth > 1.0 else f"{field.scale:g}"
    return f"{text} {field.unit}".rstrip()


def ends(field: Field) -> str:
    """Return minimum and maximum in the field's unit if they differ from the raw values."""
    if field.scale == 1.0:
        return ""
    low = -(2 ** (8 * field_size(field) - 1)) if field.format.islower() else 0
    high = low + 2 ** (8 * field_size(field)) - 1
    return f"{low * field.scale:.6g} … {high * field.scale:.6g}"


def profile() -> str:
    """Return the settings of the link with their defaults and marks."""
    return table(
        ("setting", "default", "unit", "mark", "meaning"),
        (
            (f"`{item.name}`", f"`{item.default}`", item.info.unit, item.info.mark, item.info.meaning)
            for item in settings(LinkProfile())
        ),
    )


def golden_blocks() -> str:
    """Return example blocks to compare with a capture."""
    orders = (("read status", read_status()), ("stop program", stop_program()))
    return table(
        ("order", "block", "check character"),
        (
            (name, f"`{encode_block(raw).hex(' ').upper()}`", f"`{check_character(raw):02X}`")
            for name, raw in (
                (name, order.encode())
                for name, order in (*orders, ("write mode, operation", write_mode(Mode.OPERATION)))
            )
        ),
    )


TABLES: dict[str, Callable[[], str]] = {
    "control bytes": control_bytes,
    "header": header,
    "types": types,
    "functions": functions,
    "refusals": refusals,
    "payloads": payloads,
    "profile": profile,
    "golden blocks": golden_blocks,
}
