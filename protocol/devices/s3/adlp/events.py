"""The two ends of a computer link, and the events that a link reports to its owner."""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypeAlias


class Role(StrEnum):
    """End of the link, spelled as in the profile's setting `collision_winner`."""

    HOST = "host"
    ROBOT = "robot"


class LinkFailure(StrEnum):
    """Reason why a message was abandoned."""

    NO_ANSWER = "no answer"
    """Own message: nothing was received after our bids. Possible causes: cable, power, or link control not enabled
    on the robot.
    """
    ONLY_NOISE = "only noise"
    """Own message: only invalid bytes were received after our bids. Possible causes: rate, parity or wiring."""
    BID_REFUSED = "bid refused"
    """Own message: every bid was answered by NAK or not at all, and at least one by NAK."""
    REPEATS_EXHAUSTED = "repeats exhausted"
    """Own message: a block was not acknowledged despite all repeats."""
    WACK_LIMIT = "asked to wait too often"
    ABORTED = "aborted"
    """Own message: the receiver answered a block with EOT."""
    INTERRUPTED = "interrupted"
    """Own message: the receiver bid for the line instead of answering a block. It may have accepted the block, if
    its ACK was lost.
    """
    EARLY_EOT = "early EOT"
    """Incoming message: it ended before a valid block arrived."""
    INCOMPLETE = "incomplete"
    """Incoming message: it stopped or restarted before its end."""
    TOO_LONG = "too long"
    """Incoming message: it has more blocks than can be buffered."""


INCOMING_FAILURES = frozenset((LinkFailure.EARLY_EOT, LinkFailure.INCOMPLETE, LinkFailure.TOO_LONG))
"""Reasons for the failure of an incoming message; all other reasons are about our own messages."""


class NoticeKind(StrEnum):
    """Kind of an event that is logged and counted."""

    NOISE = "noise"
    STRAY_CONTROL = "stray control byte"
    STRAY_BLOCK = "stray block"
    BAD_BLOCK = "bad block"
    """Bytes that start like a block but cannot be one."""
    BAD_CHECKSUM = "bad checksum"
    """A complete block with a wrong check character."""
    GAP = "gap in block"
    NAK_SENT = "NAK sent"
    NAK_RECEIVED = "NAK received"
    REPEAT = "block repeated"
    BID_REPEAT = "bid repeated"
    TIME_OUT = "time-out"
    WACK = "WACK received"
    RVI = "RVI received"
    RELEASED = "line released"
    """Our bid was acknowledged, but its message was not queued in time, so the line was released."""
    COLLISION = "collision"
    DUPLICATE = "duplicate dropped"
    MISSING_EOT = "missing EOT"
    LATE_BLOCK = "late block"
    """A further block of a message that was considered complete."""
    GAVE_UP = "gave up receiving"
    BID_SENT = "bid sent"
    BID_RECEIVED = "bid received"
    """A bid of the other side was received and acknowledged."""
    ACK_SENT = "ACK sent"
    ACK_RECEIVED = "ACK received"
    TRAILER_AVOIDED = "10 03 avoided"
    """A move was changed by one step so that its data does not contain DLE ETX."""
    TRAILER_SENT = "10 03 in data"
    """The data of an order contains DLE ETX, and DLE is not doubled."""


ROUTINE = frozenset(
    (
        NoticeKind.BID_SENT,
        NoticeKind.BID_RECEIVED,
        NoticeKind.ACK_SENT,
        NoticeKind.ACK_RECEIVED,
        NoticeKind.TRAILER_AVOIDED,
    )
)
"""Notices of undisturbed exchanges. They are always counted, but only a verbose link reports them."""


class MessageReceived(NamedTuple):
    """A complete message of the other side was received."""

    telegrams: tuple[bytes, ...]
    """Telegrams of the message in order, one per block."""


@dataclass(frozen=True, slots=True)
class MessageSent:
    """All blocks of the oldest queued message have been acknowledged."""


@dataclass(frozen=True, slots=True)
class LinkFailed:
    """A message was abandoned: our oldest queued one, or an incoming one if the reason is in `INCOMING_FAILURES`."""

    reason: LinkFailure
    text: str
    remedy: str = ""
    """Checks that an operator should make; empty if none is known."""


class LinkNotice(NamedTuple):
    """A condition that the link handled without its owner."""

    kind: NoticeKind
    text: str


LinkEvent: TypeAlias = MessageReceived | MessageSent | LinkFailed | LinkNotice
