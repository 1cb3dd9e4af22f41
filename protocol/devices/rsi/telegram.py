"""Telegrams of KUKA's Robot Sensor Interface: one XML document per datagram, and the numbers in it.

A telegram is a root element with a type. It contains elements, the last of which is the controller's clock, IPOC.
Values are named as in the Ethernet configuration of the controller: `RKorr.X` is the attribute X of the element
RKorr, `DiO` is the text of the element DiO.

Source: project specification of RSI, sections 2 and 3. Marks indicate assumptions.
"""

import math
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import NamedTuple
from xml.etree import ElementTree

from protocol.endpoint import RemoteProtocolError

LARGEST_BYTES = 8192
"""Maximum number of bytes in a telegram. Chosen: a robot's telegram has 250 … 600 bytes (observed), and all 64
channels fit, too.
"""
LARGEST_IPOC = 2**63 - 1
"""Largest value of the clock. Derived: all public clients store the clock as a signed 64-bit integer."""
LARGEST_NUMBER = 1e9
"""Largest magnitude of a number. Chosen: no position, angle or correction is larger."""
ROBOT, SENSOR = "Rob", "Sen"
"""Names of the root element in a telegram from the robot and in an answer."""
ROOT_TYPES = ("Type", "TYPE")
"""Spellings of the root's type attribute. Both were observed: one in the vendor's client library, the other in
third-party simulators.
"""
CLOCK = "IPOC"
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_CLOCK = re.compile(r"[0-9]{1,19}")
_LONGEST_NUMBER = 64
"""Maximum number of characters in a number. Chosen."""
_SPECIAL = re.compile('[&<"]')
_ATTRIBUTE, _ELEMENT = '"([!#-%(-;=?-~]*)"', ">([!#-%'-;=?-~]+)<"
"""Patterns of texts that need no unescaping: printable ASCII, without space, markup or quotes."""
_FORMS_MAX = 64
"""Maximum number of telegram forms that are cached. Chosen: a robot and its client have one form each."""


class Telegram(NamedTuple):
    """A telegram in either direction."""

    root: str
    """Name of the root element, `Rob` or `Sen`."""
    type: str
    """Type in the root element: KUKA, or the SENTYPE of the controller's configuration."""
    values: Mapping[str, str]
    """Texts by tag, in the order of the telegram, without IPOC."""
    ipoc: int
    """Clock of the controller, ms. An answer repeats the clock of the telegram that it answers."""


class _Form(NamedTuple):
    """Form common to all telegrams that differ only in their texts."""

    root: str
    tags: tuple[str, ...]
    pattern: re.Pattern[str]
    """Pattern with a group for the type, for each value, and for the clock."""


_forms: list[_Form] = []
"""Cached forms of the parsed telegrams that were in the vendor's format."""


def encode(telegram: Telegram, type_attribute: str = ROOT_TYPES[0]) -> bytes:
    """Encode the telegram in the vendor's format: one line, tags of one element next to each other, IPOC last.

    Observed: the vendor's own client library (kuka_external_control_sdk) locates each number by its position in
    this format.
    """
    form = _form(telegram.root, type_attribute, tuple(telegram.values))
    texts = (telegram.type, *telegram.values.values())
    if _SPECIAL.search("".join(texts)):
        texts = tuple(map(_escape, texts))
    return (form % (*texts, telegram.ipoc)).encode()


@lru_cache(maxsize=_FORMS_MAX)
def _form(root: str, type_attribute: str, tags: tuple[str, ...]) -> str:
    """Return a telegram with these tags in the vendor's format, with a placeholder for each text. The result is
    cached, because each side always sends the same form.
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
    """Decode the telegram in a datagram. Tags may be in any order and with any white space (assumed for the
    controller, too).

    Raises RemoteProtocolError if the telegram is too long, is not well-formed, or has no clock. A document type, an
    entity or a prolog is rejected before parsing.
    """
    if len(raw) > LARGEST_BYTES:
        raise RemoteProtocolError(f"a telegram of {len(raw)} bytes is longer than {LARGEST_BYTES}")
    try:
        text = raw.decode()
    except UnicodeDecodeError as error:
        raise RemoteProtocolError(f"not a telegram: byte {error.start} is not valid UTF-8") from None
    for form in _forms:
        if match := form.pattern.fullmatch(text):
            kind, *values, clock = match.groups()
            return Telegram(form.root, kind, dict(zip(form.tags, values, strict=True)), _ipoc(clock))
    telegram = _parse(text)
    _cache_form(telegram, raw)
    return telegram


def _cache_form(telegram: Telegram, raw: bytes) -> None:
    """Cache the form of a telegram in the vendor's format, so that similar telegrams need no XML parser."""
    tags = tuple(telegram.values)
    for attribute in ROOT_TYPES:
        if len(_forms) < _FORMS_MAX and encode(telegram, attribute) == raw:
            text = re.escape(_form(telegram.root, attribute, tags))
            for place, group in (('"%s"', _ATTRIBUTE), (">%s<", _ELEMENT), (">%d<", _ELEMENT), ("%%", "%")):
                text = text.replace(place, group)
            form = _Form(telegram.root, tags, re.compile(text))
            if form not in _forms:
                _forms.append(form)


def _parse(text: str) -> Telegram:
    """Parse a telegram of any form with the XML parser."""
    if "<!" in text or "<?" in text:
        raise RemoteProtocolError("a telegram must not have a prolog or a document type")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise RemoteProtocolError(f"not a telegram: {error}") from None
    if root.tag not in (ROBOT, SENSOR):
        raise RemoteProtocolError(f"not a telegram: the root is {root.tag[:20]!r}, not {ROBOT} or {SENSOR}")
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
    """Parse a number. Raises RemoteProtocolError for any other text, such as NaN, and for a number that is too
    large.
    """
    if len(text) > _LONGEST_NUMBER or not _NUMBER.fullmatch(text):
        raise RemoteProtocolError(f"{text[:24]!r} is not a number")
    value = float(text)
    if not abs(value) <= LARGEST_NUMBER:
        raise RemoteProtocolError(f"{text[:24]!r} is too large")
    return value


def numbers(values: Mapping[str, str], tags: Iterable[str]) -> list[float] | None:
    """Parse the numbers of these tags; None if one is missing. Raises RemoteProtocolError if a text is not a valid
    number.
    """
    texts = [values.get(tag) for tag in tags]
    present = [text for text in texts if text is not None]
    return [number(text) for text in present] if len(present) == len(texts) else None


def fixed(value: float, decimals: int) -> str:
    """Format a number in the format that both sides use: fixed point, without a plus, an exponent, or a minus
    before zero.
    """
    if not math.isfinite(value):
        raise ValueError(f"{value} cannot be sent")
    text = f"{value:.{decimals}f}"
    return text[1:] if text[0] == "-" and not text.strip("-0.") else text


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
