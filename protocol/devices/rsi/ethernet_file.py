"""The Ethernet configuration of a controller, an XML file on its disk, as its ETHERNET object reads it.

Source: project specification of RSI, section 2.
"""

from collections.abc import Mapping
from typing import NamedTuple
from xml.etree import ElementTree

ELEMENTS_MOST = 128
"""Chosen: elements of a direction. An ETHERNET object has 64 channels, and each DEF_ has no channel."""
_DEFINED = "DEF_"
_LONGEST = 40
"""Chosen: characters of a tag, a name or an address."""


class Received(NamedTuple):
    """An element that the controller takes from an answer."""

    channel: str
    """INDX: output of the ETHERNET object, 1 to 64, or INTERNAL."""
    holds: bool
    """It keeps its value in a cycle without an answer, else it falls to 0. Assumed: it keeps where HOLDON is absent."""


class EthernetFile(NamedTuple):
    """What a controller's Ethernet configuration says of its wire."""

    host: str
    """Address that it sends to; empty where it names none."""
    port: str
    sentype: str
    sends_alone: bool
    """ONLYSEND: it takes no answers."""
    sends: tuple[str, ...]
    """Tags of its telegrams as they are on the wire, without `DEF_`."""
    receives: Mapping[str, Received]
    """Elements of an answer by tag."""


class _NoDoctype(ElementTree.TreeBuilder):
    """A tree without a document type, whose entities could grow without end."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Raise ValueError."""
        raise ValueError(f"it has a document type, {name[:20]!r}; remove it")


def read_ethernet_file(data: bytes) -> EthernetFile:
    """Read the contents of a file. Raises ValueError with the reason for an invalid one."""
    try:
        root = ElementTree.fromstring(data, ElementTree.XMLParser(target=_NoDoctype()))
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"no XML that can be read: {error}") from None
    if root.tag != "ROOT" or root.find("CONFIG") is None:
        raise ValueError("its root must be ROOT with a CONFIG in it, as of an Ethernet configuration of RSI")
    holds: dict[str, Received] = {}
    sent, received = (root.findall(f"{name}/ELEMENTS/ELEMENT") for name in ("SEND", "RECEIVE"))
    if max(len(sent), len(received)) > ELEMENTS_MOST:
        raise ValueError(f"more than {ELEMENTS_MOST} elements of a direction")
    for element in received:
        tag = _tag(element)
        hold = element.get("HOLDON", "1").strip()
        if hold not in ("0", "1"):
            raise ValueError(f"HOLDON of {tag!r} must be 0 or 1, got {hold[:20]!r}")
        if tag in holds:
            raise ValueError(f"{tag!r} is in RECEIVE twice")
        holds[tag] = Received(element.get("INDX", "").strip(), hold == "1")
    only = _word("ONLYSEND", root.findtext("CONFIG/ONLYSEND", "FALSE")).upper()
    if only not in ("TRUE", "FALSE"):
        raise ValueError(f"ONLYSEND must be TRUE or FALSE, got {only!r}")
    host, port, sentype = (
        _word(name, root.findtext(f"CONFIG/{name}", "")) for name in ("IP_NUMBER", "PORT", "SENTYPE")
    )
    return EthernetFile(
        host,
        port,
        sentype,
        only == "TRUE",
        tuple(map(_tag, sent)),
        holds,
    )


def _tag(element: ElementTree.Element) -> str:
    tag = _word("TAG", element.get("TAG", ""))
    if not tag:
        raise ValueError("an ELEMENT has no TAG")
    return tag.removeprefix(_DEFINED)


def _word(name: str, text: str) -> str:
    """Return a value without surrounding space. Raises ValueError for one that is long or cannot be printed."""
    text = text.strip()
    if len(text) > _LONGEST or not text.isprintable():
        raise ValueError(f"{name} is no plain word: {text[:_LONGEST]!r}")
    return text
