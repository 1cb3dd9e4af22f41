"""The two ends of a computer link, and what a link tells its owner."""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypeAlias


class Role(StrEnum):
    """Which end of the link; the spelling is that of the profile's collision winner."""

    HOST = "host"
    ROBOT = "robot"


class LinkFailure(StrEnum):
    """Why a message was given up."""

    NO_ANSWER = "no answer"
    """Ours: nothing at all came after our bids: cable, power, or the robot has not given the link control."""
    ONLY_NOISE = "only noise"
    """Ours: bytes came after our bids but nothing valid: rate, parity or wiring."""
    BID_REFUSED = "bid refused"
    """Ours: every bid was answered by NAK or silence, at least one by NAK."""
    REPEATS_EXHAUSTED = "repeats exhausted"
    """Ours: a block was not acknowledged, however often it was repeated."""
    WACK_LIMIT = "asked to wait too often"
    ABORTED = "aborted"
    """Ours: the receiver answered a block with EOT."""
    INTERRUPTED = "interrupted"
    """Ours: the receiver bid instead of answering a block. It may have taken the block (its ACK was lost)."""
    EARLY_EOT = "early EOT"
    """Theirs: ended before a valid block came."""
    INCOMPLETE = "incomplete"
    """Theirs: fell silent or began again in the middle."""
    TOO_LONG = "too long"
    """Theirs: more blocks than we keep."""


INCOMING_FAILURES = frozenset((LinkFailure.EARLY_EOT, LinkFailure.INCOMPLETE, LinkFailure.TOO_LONG))
"""Failures that concern a message of the other side, not one of ours."""


class NoticeKind(StrEnum):
    """Events that are worth a line in a log, and a counter."""

    NOISE = "noise"
    STRAY_CONTROL = "stray control byte"
    STRAY_BLOCK = "stray block"
    BAD_BLOCK = "bad block"
    """Bytes that began like a block and cannot be one."""
    BAD_CHECKSUM = "bad checksum"
    """A block that ends where it should, with another check character."""
    GAP = "gap in block"
    NAK_SENT = "NAK sent"
    NAK_RECEIVED = "NAK received"
    REPEAT = "block repeated"
    BID_REPEAT = "bid repeated"
    TIME_OUT = "time-out"
    WACK = "WACK received"
    RVI = "RVI received"
    RELEASED = "line released"
    """Our bid was acknowledged, and no message came for it in time."""
    COLLISION = "collision"
    DUPLICATE = "duplicate dropped"
    MISSING_EOT = "missing EOT"
    LATE_BLOCK = "late block"
    """A further block of a message that was taken as ended."""
    GAVE_UP = "gave up receiving"
    BID_SENT = "bid sent"
    BID_RECEIVED = "bid received"
    """A bid that was acknowledged."""
    ACK_SENT = "ACK sent"
    ACK_RECEIVED = "ACK received"
    TRAILER_AVOIDED = "10 03 avoided"
    """A move gave way by a step, so that its data hold no DLE ETX."""
    TRAILER_SENT = "10 03 in data"
    """The data of an order hold DLE ETX, and DLE travels once."""


ROUTINE = frozenset(
    (
        NoticeKind.BID_SENT,
        NoticeKind.BID_RECEIVED,
        NoticeKind.ACK_SENT,
        NoticeKind.ACK_RECEIVED,
        NoticeKind.TRAILER_AVOIDED,
    )
)
"""Notices of undisturbed exchanges: always counted, told only by a verbose link."""


class MessageReceived(NamedTuple):
    """A message of the other side is complete."""

    telegrams: tuple[bytes, ...]
    """One telegram a block, in order."""


@dataclass(frozen=True, slots=True)
class MessageSent:
    """The oldest message that we queued has been acknowledged, block by block."""


@dataclass(frozen=True, slots=True)
class LinkFailed:
    """A message was given up: our oldest one, or one of the other side (`INCOMING_FAILURES`)."""

    reason: LinkFailure
    text: str
    remedy: str = ""
    """Checks for an operator; empty where none is known."""


class LinkNotice(NamedTuple):
    """Something happened that the link could deal with itself."""

    kind: NoticeKind
    text: str


LinkEvent: TypeAlias = MessageReceived | MessageSent | LinkFailed | LinkNotice
