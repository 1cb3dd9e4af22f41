"""Transforms and load envelopes as they lie in their slots.

Source: JR3 manual 5907E; the order of words after the public header of Linux's jr3_pci driver.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from protocol.devices.jr3.board.words import from_signed, to_signed
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

TURN_COUNTS = 32768
"""Amount of a rotation that means 180°."""
_HEAD = 3
_THRESHOLD_WORDS = 3
_SIGNED = range(-32768, 32768)


class LinkType(IntEnum):
    """Effect of one link of a transform on the frame in which the wrench is told."""

    END = 0
    TRANSLATE_X = 1
    TRANSLATE_Y = 2
    TRANSLATE_Z = 3
    ROTATE_X = 4
    ROTATE_Y = 5
    ROTATE_Z = 6
    NEGATE = 7


@dataclass(frozen=True, slots=True)
class Link:
    """One link of a transform."""

    type: LinkType
    amount: int
    """Signed: lengths in the board's unit, rotations with 32768 ≙ 180°; NEGATE negates unless it is 0."""


def encode_transform(links: Sequence[Link]) -> tuple[int, ...]:
    """Words of a transform, end mark included: 2 n + 1 of them.

    Raises LocalProtocolError for an END among the links or an amount that is no signed word.
    """
    words: list[int] = []
    for link in links:
        if link.type is LinkType.END or link.amount not in _SIGNED:
            raise LocalProtocolError(f"a transform cannot hold the link {link.type.name} {link.amount}")
        words += [link.type, from_signed(link.amount)]
    return (*words, LinkType.END)


def decode_transform(words: Sequence[int]) -> tuple[Link, ...]:
    """Links up to the end mark; what follows it is ignored.

    Raises RemoteProtocolError for an unknown type and when no end mark comes.
    """
    links: list[Link] = []
    for at in range(0, len(words), 2):
        if words[at] == LinkType.END:
            return tuple(links)
        if words[at] > LinkType.NEGATE or at + 1 == len(words):
            break
        links.append(Link(LinkType(words[at]), to_signed(words[at + 1])))
    raise RemoteProtocolError(f"transform has no end mark after {len(links)} good links")


@dataclass(frozen=True, slots=True)
class Threshold:
    """One comparison of a load envelope."""

    data_address: int
    threshold: int
    """Signed counts, met counts as reached."""
    bit_pattern: int
    """Bits of threshold_bits that it sets."""


@dataclass(frozen=True, slots=True)
class LoadEnvelope:
    """Comparisons that the board makes at a quarter of the filter's rate."""

    latch_bits: int = 0
    """Bits that stay set until the host resets them."""
    at_least: tuple[Threshold, ...] = ()
    at_most: tuple[Threshold, ...] = ()


def encode_envelope(envelope: LoadEnvelope) -> tuple[int, ...]:
    """Words of a load envelope; with more than four thresholds it runs on into the next slot.

    Raises LocalProtocolError for a threshold that is no signed word.
    """
    words = [from_signed(envelope.latch_bits), len(envelope.at_least), len(envelope.at_most)]
    for item in (*envelope.at_least, *envelope.at_most):
        if item.threshold not in _SIGNED:
            raise LocalProtocolError(f"a load envelope cannot hold the threshold {item.threshold}")
        words += [from_signed(item.data_address), from_signed(item.threshold), from_signed(item.bit_pattern)]
    return tuple(words)


def decode_envelope(words: Sequence[int]) -> LoadEnvelope:
    """Return a load envelope from the start of its slot; words past its end are ignored.

    Raises RemoteProtocolError when it says more thresholds than there are words.
    """
    if len(words) < _HEAD or len(words) < _HEAD + _THRESHOLD_WORDS * (words[1] + words[2]):
        raise RemoteProtocolError("load envelope has more thresholds than its memory")
    latch_bits, least, most = words[:_HEAD]
    items = tuple(
        Threshold(words[at], to_signed(words[at + 1]), words[at + 2])
        for at in range(_HEAD, _HEAD + _THRESHOLD_WORDS * (least + most), _THRESHOLD_WORDS)
    )
    return LoadEnvelope(latch_bits, items[:least], items[least:])
