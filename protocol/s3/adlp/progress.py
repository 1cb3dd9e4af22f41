"""What an end of the link remembers of the message on its way out and of the one on its way in."""

from dataclasses import dataclass

from protocol.endpoint import LocalProtocolError
from protocol.s3.adlp.block import LENGTH_STYLES, Block, telegram_sizes
from protocol.s3.adlp.events import LinkFailure


@dataclass(slots=True)
class Sending:
    """The oldest queued message on its way."""

    index: int = 0
    bids: int = 1
    repeats: int = 0
    wacks: int = 0
    heard: int = 0
    """Bytes that came since the first bid and meant nothing."""
    bid_refused: bool = False
    reversed: bool = False
    """The other side asked for the line."""


@dataclass(slots=True)
class Receiving:
    """The message of the other side on its way."""

    telegrams: list[bytes]
    last: Block | None = None
    naks: int = 0
    asked_at: float = 0.0
    """When a block was last asked for, by ACK to a bid or by NAK, s."""
    block_due: bool = True
    """A block must come; false once one was acknowledged."""


def check_telegram(telegram: bytes, max_telegram: int) -> None:
    """Raise LocalProtocolError for a telegram that no receiver could take."""
    if len(telegram) > max_telegram:
        raise LocalProtocolError(
            f"a telegram of {len(telegram)} bytes is too long for a block of {max_telegram}"
        )
    if len(telegram) not in telegram_sizes(int.from_bytes(telegram[:2], "big"), LENGTH_STYLES):
        raise LocalProtocolError(
            f"a telegram of {len(telegram)} bytes states another length: nobody could find its end"
        )


def unanswered(sending: Sending) -> tuple[LinkFailure, str]:
    """Why no bid for a message was acknowledged, by what came instead, and what a person can check."""
    if sending.bid_refused:
        return LinkFailure.BID_REFUSED, f"{sending.bids} bids (ENQ) were refused by NAK"
    if sending.heard:
        return LinkFailure.ONLY_NOISE, (
            f"{sending.bids} bids (ENQ) were answered by {sending.heard} bytes without meaning: "
            "check the rate and the parity on both sides"
        )
    return LinkFailure.NO_ANSWER, (
        f"nothing came after {sending.bids} bids (ENQ): check cable and power, rate and parity, "
        "and that the robot has given the link control"
    )
