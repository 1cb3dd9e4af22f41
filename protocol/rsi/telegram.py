"""Telegrams of KUKA's Robot Sensor Interface: one XML document a datagram, and the numbers in it.

A telegram is a root with a type, elements, and the controller's clock, IPOC, as its last element. A value is named as
the Ethernet configuration of the controller names it: `RKorr.X` is the attribute X of the element RKorr, `DiO` is the
text of the element DiO.

Source: project specification of RSI, sections 2 and 3. Marks stand beside what was assumed.
"""

import math
import re
from collections.abc import Iterable, Mapping
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
"""Spellings of the root's attribute; both were observed."""
POSE_AXES = ("X", "Y", "Z", "A", "B", "C")
"""Attributes of a Cartesian value in the vendor's order: mm, then degrees."""
CLOCK = "IPOC"
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_CLOCK = re.compile(r"[0-9]{1,19}")
_LONGEST_NUMBER = 64
"""Chosen: characters of a number that is read."""


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


def encode(telegram: Telegram, type_attribute: str = ROOT_TYPES[0]) -> bytes:
    """The telegram in the vendor's form: one line, tags of one element side by side, IPOC last."""
    parts = [f'<{telegram.root} {type_attribute}="{_escaped(telegram.type)}">']
    inside = ""
    for tag, text in telegram.values.items():
        element, dot, attribute = tag.partition(".")
        if inside and inside != element:
            parts.append("/>")
            inside = ""
        if not dot:
            parts.append(f"<{element}>{_escaped(text)}</{element}>")
            continue
        if not inside:
            parts.append(f"<{element}")
            inside = element
        parts.append(f' {attribute}="{_escaped(text)}"')
    if inside:
        parts.append("/>")
    parts.append(f"<{CLOCK}>{telegram.ipoc}</{CLOCK}></{telegram.root}>")
    return "".join(parts).encode()


def decode(raw: bytes) -> Telegram:
    """The telegram in a datagram. Any order and any white space will do (assumed of the controller, too).

    Raises RemoteProtocolError for one that is too long, not well-formed, or has no clock. A document type, an entity
    and a prolog are refused before they are read.
    """
    if len(raw) > LARGEST_BYTES:
        raise RemoteProtocolError(f"a telegram of {len(raw)} bytes is longer than {LARGEST_BYTES}")
    if b"<!" in raw or b"<?" in raw:
        raise RemoteProtocolError("a telegram has neither a prolog nor a document type")
    try:
        root = ElementTree.fromstring(raw.decode())
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
    clock = values.pop(CLOCK, "")
    if not _CLOCK.fullmatch(clock) or int(clock) > LARGEST_IPOC:
        raise RemoteProtocolError(f"{CLOCK} is {clock[:24]!r}, not a whole number of ms")
    type_name = next((root.attrib[name] for name in ROOT_TYPES if name in root.attrib), "")
    return Telegram(root.tag, type_name, values, int(clock))


def number(text: str) -> float:
    """The number in a value. Raises RemoteProtocolError for anything else, as NaN, and for one that is too large."""
    if len(text) > _LONGEST_NUMBER or not _NUMBER.fullmatch(text):
        raise RemoteProtocolError(f"{text[:24]!r} is no number")
    value = float(text)
    if not abs(value) <= LARGEST_NUMBER:
        raise RemoteProtocolError(f"{text[:24]!r} is too large")
    return value


def numbers(values: Mapping[str, str], tags: Iterable[str]) -> list[float] | None:
    """The numbers of these tags; None where one of them is missing. Raises RemoteProtocolError as `number`."""
    texts = [values.get(tag) for tag in tags]
    found = [text for text in texts if text is not None]
    return [number(text) for text in found] if len(found) == len(texts) else None


def fixed(value: float, decimals: int) -> str:
    """A number as both sides write it: fixed point, no plus, no exponent, and no minus before zero."""
    if not math.isfinite(value):
        raise ValueError(f"{value} cannot be sent")
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def pose_tags(element: str) -> tuple[str, ...]:
    """Tags of a Cartesian element, as `RIst` or `RKorr`, in the vendor's order."""
    return tuple(f"{element}.{axis}" for axis in POSE_AXES)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
