"""Transforms and load envelopes, in the format in which the board's slots store them.

Source: JR3 manual 5907E. The order of the words is as in the public header of Linux's jr3_pci driver.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from protocol.devices.jr3.board.words import from_signed, to_signed
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

TURN_COUNTS = 32768
"""Rotation by 180°, in raw units."""
_HEAD = 3
_THRESHOLD_WORDS = 3
_SIGNED = range(-32768, 32768)


class LinkType(IntEnum):
    """Effect of one link of a transform on the frame in which the wrench is reported."""

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
    """Signed amount: a length in the board's unit, or a rotation where 32768 ≙ 180°. NEGATE negates unless the
    amount is 0.
    """


def encode_transform(links: Sequence[Link]) -> tuple[int, ...]:
    """Encode a transform and its end mark as 2 n + 1 words for n links.

    Raises LocalProtocolError if END is among the links, or an amount does not fit into a signed word.
    """
    words: list[int] = []
    for link in links:
        if link.type is LinkType.END or link.amount not in _SIGNED:
            raise LocalProtocolError(f"a transform cannot hold the link {link.type.name} {link.amount}")
        words += [link.type, from_signed(link.amount)]
    return (*words, LinkType.END)


def decode_transform(words: Sequence[int]) -> tuple[Link, ...]:
    """Decode the links before the end mark. Words after the end mark are ignored.

    Raises RemoteProtocolError if a link type is unknown or the end mark is missing.
    """
    links: list[Link] = []
    for at in range(0, len(words), 2):
        if words[at] == LinkType.END:
            return tuple(links)
        if words[at] > LinkType.NEGATE or at + 1 == len(words):
            break
        links.append(Link(LinkType(words[at]), to_signed(words[at + 1])))
    raise RemoteProtocolError(f"transform has no end mark after {len(links)} valid links")


@dataclass(frozen=True, slots=True)
class Threshold:
    """One comparison of a load envelope."""

    data_address: int
    threshold: int
    """Threshold in signed counts. It is reached when the counts are equal to it."""
    bit_pattern: int
    """Bits of threshold_bits that this threshold sets."""


@dataclass(frozen=True, slots=True)
class LoadEnvelope:
    """Set of comparisons that the board performs at a quarter of the filter's rate."""

    latch_bits: int = 0
    """Bits that remain set until the host resets them."""
    at_least: tuple[Threshold, ...] = ()
    at_most: tuple[Threshold, ...] = ()


def encode_envelope(envelope: LoadEnvelope) -> tuple[int, ...]:
    """Encode a load envelope. With more than four thresholds, it extends into the next slot.

    Raises LocalProtocolError if a threshold does not fit into a signed word.
    """
    words = [from_signed(envelope.latch_bits), len(envelope.at_least), len(envelope.at_most)]
    for item in (*envelope.at_least, *envelope.at_most):
        if item.threshold not in _SIGNED:
            raise LocalProtocolError(f"a load envelope cannot hold the threshold {item.threshold}")
        words += [from_signed(item.data_address), from_signed(item.threshold), from_signed(item.bit_pattern)]
    return tuple(words)


def decode_envelope(words: Sequence[int]) -> LoadEnvelope:
    """Decode a load envelope that starts at the first word. Words after its end are ignored.

    Raises RemoteProtocolError if the envelope declares more thresholds than there are words.
    """
    if len(words) < _HEAD or len(words) < _HEAD + _THRESHOLD_WORDS * (words[1] + words[2]):
        raise RemoteProtocolError("load envelope has more thresholds than its memory")
    latch_bits, least, most = words[:_HEAD]
    items = tuple(
        Threshold(words[at], to_signed(words[at + 1]), words[at + 2])
        for at in range(_HEAD, _HEAD + _THRESHOLD_WORDS * (least + most), _THRESHOLD_WORDS)
    )
    return LoadEnvelope(latch_bits, items[:least], items[least:])
