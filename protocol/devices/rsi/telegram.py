"""Telegrams of KUKA's Robot Sensor Interface: one XML document a datagram, and the numbers in it.

A telegram is a root with a type, elements, and the controller's clock, IPOC, as its last element. A value is named as
the Ethernet configuration of the controller names it: `RKorr.X` is the attribute X of the element RKorr, `DiO` is the
text of the element DiO.

Source: project specification of RSI, sections 2 and 3. Marks stand beside what was assumed.
"""

import math
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import NamedTuple
from xml.etree import ElementTree

from protocol.endpoint import RemoteProtocolError

LARGEST_BYTES = 8192
"""Chosen: longest telegram that is read. A robot's has 250 … 600 bytes (observed); all 64 channels fit, too."""
LARGEST_IPOC = 2**63 - 1
"""Derived: all public clients keep the clock in 64 bits with a sign."""
LARGEST_NUMBER = 1e9
"""Chosen: a value beyond it is no position, angle or correction."""
ROBOT, SENSOR = "Rob", "Sen"
"""Roots: from the robot, and to it."""
ROOT_TYPES = ("Type", "TYPE")
"""Spellings of the root's attribute; both were observed: in the vendor's client library, and in others' simulators."""
CLOCK = "IPOC"
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_CLOCK = re.compile(r"[0-9]{1,19}")
_LONGEST_NUMBER = 64
"""Chosen: characters of a number that is read."""
_SPECIAL = re.compile('[&<"]')
_ATTRIBUTE, _ELEMENT = '"([!#-%(-;=?-~]*)"', ">([!#-%'-;=?-~]+)<"
"""Texts that need no more than to be cut out: of printable ASCII, without space, markup or quotes."""
_FORMS_MAX = 64
"""Chosen: forms of telegrams that are kept. A robot and its client have one each."""


class Telegram(NamedTuple):
    """A telegram of either direction."""

    root: str
    """`Rob` or `Sen`."""
    type: str
    """Name in the root: KUKA, or the SENTYPE of the controller's configuration."""
    values: Mapping[str, str]
    """Texts by tag, in the order of the telegram, without IPOC."""
    ipoc: int
    """Clock of the controller, ms; an answer repeats that of the telegram that it answers."""


class _Form(NamedTuple):
    """All telegrams that differ in their texts alone."""

    root: str
    tags: tuple[str, ...]
    pattern: re.Pattern[str]
    """With a group for type, each value and clock."""


_known: list[_Form] = []
"""Forms of the vendor's kind that were read."""


def encode(telegram: Telegram, type_attribute: str = ROOT_TYPES[0]) -> bytes:
    """Encode the telegram in the vendor's form: one line, tags of one element side by side, IPOC last.

    Observed: the vendor's own client library (kuka_external_control_sdk) finds each number by its place in that form.
    """
    form = _form(telegram.root, type_attribute, tuple(telegram.values))
    texts = (telegram.type, *telegram.values.values())
    if _SPECIAL.search("".join(texts)):
        texts = tuple(map(_escaped, texts))
    return (form % (*texts, telegram.ipoc)).encode()


@lru_cache(maxsize=_FORMS_MAX)
def _form(root: str, type_attribute: str, tags: tuple[str, ...]) -> str:
    """Return the vendor's form of a telegram with these tags, with a place for each text: a side sends one form all the
    time.
    """
    parts = [f'<{root} {type_attribute}="%s">']
    inside = ""
    for tag in tags:
        element, dot, attribute = tag.replace("%", "%%").partition(".")
        if inside and inside != element:
            parts.append("/>")
            inside = ""
        if not dot:
            parts.append(f"<{element}>%s</{element}>")
            continue
        if not inside:
            parts.append(f"<{element}")
            inside = element
        parts.append(f' {attribute}="%s"')
    if inside:
        parts.append("/>")
    parts.append(f"<{CLOCK}>%d</{CLOCK}></{root}>")
    return "".join(parts)


def decode(raw: bytes) -> Telegram:
    """Decode the telegram in a datagram, in any order and with any white space (assumed of the controller, too).

    Raises RemoteProtocolError for one that is too long, not well-formed, or has no clock. A document type, an entity
    and a prolog are refused before they are read.
    """
    if len(raw) > LARGEST_BYTES:
        raise RemoteProtocolError(f"a telegram of {len(raw)} bytes is longer than {LARGEST_BYTES}")
    try:
        text = raw.decode()
    except UnicodeDecodeError as error:
        raise RemoteProtocolError(f"no telegram: byte {error.start} is no text in UTF-8") from None
    for form in _known:
        if found := form.pattern.fullmatch(text):
            kind, *values, clock = found.groups()
            return Telegram(form.root, kind, dict(zip(form.tags, values, strict=True)), _ipoc(clock))
    telegram = _parsed(text)
    _learn(telegram, raw)
    return telegram


def _learn(telegram: Telegram, raw: bytes) -> None:
    """Keep the form of a telegram that is in the vendor's: others of it are read by that alone."""
    tags = tuple(telegram.values)
    for attribute in ROOT_TYPES:
        if len(_known) < _FORMS_MAX and encode(telegram, attribute) == raw:
            text = re.escape(_form(telegram.root, attribute, tags))
            for place, group in (('"%s"', _ATTRIBUTE), (">%s<", _ELEMENT), (">%d<", _ELEMENT), ("%%", "%")):
                text = text.replace(place, group)
            form = _Form(telegram.root, tags, re.compile(text))
            if form not in _known:
                _known.append(form)


def _parsed(text: str) -> Telegram:
    """Parse a telegram of any form."""
    if "<!" in text or "<?" in text:
        raise RemoteProtocolError("a telegram has neither a prolog nor a document type")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise RemoteProtocolError(f"no telegram: {error}") from None
    if root.tag not in (ROBOT, SENSOR):
        raise RemoteProtocolError(f"no telegram: the root is {root.tag[:20]!r}, not {ROBOT} or {SENSOR}")
    values: dict[str, str] = {}
    for element in root:
        if element.attrib or not (element.text or "").strip():
            for name, text in element.attrib.items():
                values.setdefault(f"{element.tag}.{name}", text.strip())
        else:
            values.setdefault(element.tag, (element.text or "").strip())
    ipoc = _ipoc(values.pop(CLOCK, ""))
    type_name = next((root.attrib[name] for name in ROOT_TYPES if name in root.attrib), "")
    return Telegram(root.tag, type_name, values, ipoc)


def _ipoc(clock: str) -> int:
    if not _CLOCK.fullmatch(clock) or int(clock) > LARGEST_IPOC:
        raise RemoteProtocolError(f"{CLOCK} is {clock[:24]!r}, not a whole number of ms")
    return int(clock)


def number(text: str) -> float:
    """Parse a number. Raises RemoteProtocolError for anything else, such as NaN, and for one that is too large."""
    if len(text) > _LONGEST_NUMBER or not _NUMBER.fullmatch(text):
        raise RemoteProtocolError(f"{text[:24]!r} is not a number")
    value = float(text)
    if not abs(value) <= LARGEST_NUMBER:
        raise RemoteProtocolError(f"{text[:24]!r} is too large")
    return value


def numbers(values: Mapping[str, str], tags: Iterable[str]) -> list[float] | None:
    """Parse the numbers of these tags; None if one is missing. Raises RemoteProtocolError as `number` does."""
    texts = [values.get(tag) for tag in tags]
    found = [text for text in texts if text is not None]
    return [number(text) for text in found] if len(found) == len(texts) else None


def fixed(value: float, decimals: int) -> str:
    """Format a number as both sides do: fixed point, no plus, no exponent, and no minus before zero."""
    if not math.isfinite(value):
        raise ValueError(f"{value} cannot be sent")
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
