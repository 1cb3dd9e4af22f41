"""Parser of the Ethernet configuration of a controller, the XML file that its ETHERNET object reads.

Source: project specification of RSI, section 2.
"""

from collections.abc import Mapping
from typing import NamedTuple
from xml.etree import ElementTree

ELEMENTS_MOST = 128
"""Maximum number of elements per direction. Chosen. An ETHERNET object has 64 channels; DEF_ elements use no
channel.
"""
_DEFINED = "DEF_"
_LONGEST = 40
"""Maximum number of characters in a tag, a name or an address. Chosen."""


class Received(NamedTuple):
    """Settings of an answer's element that the controller reads."""

    channel: str
    """Output of the ETHERNET object, 1 to 64, or INTERNAL (INDX)."""
    holds: bool
    """Whether the element keeps its value in a cycle without an answer (HOLDON); otherwise the value becomes 0.
    Assumed default: it keeps the value.
    """


class EthernetFile(NamedTuple):
    """Communication settings in a controller's Ethernet configuration."""

    host: str
    """Address to which the controller sends; empty if it is not set."""
    port: str
    sentype: str
    sends_alone: bool
    """Whether the controller reads no answers (ONLYSEND)."""
    sends: tuple[str, ...]
    """Tags in the controller's telegrams as on the wire, without `DEF_`."""
    receives: Mapping[str, Received]
    """Elements that the controller reads in an answer, by tag."""


class _NoDoctype(ElementTree.TreeBuilder):
    """Tree builder that rejects document types, because their entities could expand without limit."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Raise ValueError for any document type."""
        raise ValueError(f"it has a document type, {name[:20]!r}; remove it")


def read_ethernet_file(data: bytes) -> EthernetFile:
    """Parse the contents of an Ethernet configuration file. Raises ValueError with the reason if they are invalid."""
    try:
        root = ElementTree.fromstring(data, ElementTree.XMLParser(target=_NoDoctype()))
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"invalid XML: {error}") from None
    if root.tag != "ROOT" or root.find("CONFIG") is None:
        raise ValueError("its root must be ROOT with a CONFIG in it, as in an Ethernet configuration of RSI")
    holds: dict[str, Received] = {}
    sent, received = (root.findall(f"{name}/ELEMENTS/ELEMENT") for name in ("SEND", "RECEIVE"))
    if max(len(sent), len(received)) > ELEMENTS_MOST:
        raise ValueError(f"more than {ELEMENTS_MOST} elements in one direction")
    for element in received:
        tag = _tag(element)
        hold = element.get("HOLDON", "1").strip()
        if hold not in ("0", "1"):
            raise ValueError(f"HOLDON of {tag!r} must be 0 or 1, got {hold[:20]!r}")
        if tag in holds:
            raise ValueError(f"{tag!r} is in RECEIVE twice")
        holds[tag] = Received(element.get("INDX", "").strip(), hold == "1")
    only = _plain_text("ONLYSEND", root.findtext("CONFIG/ONLYSEND", "FALSE")).upper()
    if only not in ("TRUE", "FALSE"):
        raise ValueError(f"ONLYSEND must be TRUE or FALSE, got {only!r}")
    host, port, sentype = (
        _plain_text(name, root.findtext(f"CONFIG/{name}", "")) for name in ("IP_NUMBER", "PORT", "SENTYPE")
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
    tag = _plain_text("TAG", element.get("TAG", ""))
    if not tag:
        raise ValueError("an ELEMENT has no TAG")
    return tag.removeprefix(_DEFINED)


def _plain_text(name: str, text: str) -> str:
    """Return a value without surrounding white space. Raises ValueError if it is too long or not printable."""
    text = text.strip()
    if len(text) > _LONGEST or not text.isprintable():
        raise ValueError(f"{name} is not a plain word: {text[:_LONGEST]!r}")
    return text
