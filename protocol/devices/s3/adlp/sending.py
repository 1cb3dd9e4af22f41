"""Sending half of one end of the link: the queue, the bid, and the blocks until each is acknowledged.

Each public method that returns a `State` performs one `Action` of the table in `transitions`.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from protocol.devices.s3.adlp.block import LENGTH_STYLES, Control, encode_block, telegram_sizes
from protocol.devices.s3.adlp.events import LinkFailed, LinkFailure, MessageSent, NoticeKind
from protocol.devices.s3.adlp.journal import Count
from protocol.devices.s3.adlp.shared import Shared
from protocol.devices.s3.adlp.transitions import State
from protocol.endpoint import LocalProtocolError

QUEUE_LIMIT = 16
"""Maximum number of queued messages. Mark: chosen."""
HOLDING_SHARE = 0.5
"""Time for which the line is held for an announced message, as a fraction of the time for which the other side
waits for a block. Mark: chosen.
"""

# Bound to module names for speed: before Python 3.12 an enum member lookup is five times slower.
_IDLE, _BIDDING, _HOLDING = State.IDLE, State.BIDDING, State.HOLDING
_AWAITING_ACK = State.AWAITING_ACK
_ENQ, _EOT, _STX, _STX_ODD = Control.ENQ, Control.EOT, Control.STX, Control.STX_ODD
_BID_SENT, _ACK_RECEIVED = NoticeKind.BID_SENT, NoticeKind.ACK_RECEIVED
_BLOCKS_SENT, _MESSAGES_SENT = Count.BLOCKS_SENT, Count.MESSAGES_SENT
_MESSAGE_SENT = MessageSent()


@dataclass(slots=True)
class _Message:
    """Progress of the oldest queued message."""

    index: int = 0
    bids: int = 1
    repeats: int = 0
    wacks: int = 0
    heard: int = 0
    """Number of meaningless bytes received since the first bid."""
    bid_refused: bool = False
    reversed: bool = False
    """Whether the other side has requested the line."""


class SendingHalf:
    """Sender that sends messages one at a time, in the order in which they were queued."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._profile = shared.profile
        self._notice = shared.notice
        self.queue: deque[tuple[bytes, ...]] = deque()
        """Telegrams of the queued messages."""
        self.announced = False
        """Whether a bid is due, or has been sent, for a message that is not queued yet."""
        self._blocks: list[bytes] = []
        """Blocks of the oldest message; empty until they are encoded."""
        self._message = _Message()

    def put(self, telegrams: Sequence[bytes]) -> None:
        """Queue a message. Raises LocalProtocolError if the message cannot be sent or the queue is full."""
        if not telegrams:
            raise LocalProtocolError("a message needs at least one telegram")
        if len(self.queue) >= QUEUE_LIMIT:
            raise LocalProtocolError(f"{QUEUE_LIMIT} messages are waiting already")
        for telegram in telegrams:
            _check_telegram(telegram, self._profile.max_telegram)
        self.queue.append(tuple(telegrams))
        self.announced = False

    def encode_early(self) -> None:
        """Encode the blocks of the oldest message while its bid is being transmitted and neither side waits for the
        blocks.
        """
        if self.queue and not self._blocks:
            self._encode()

    def hear(self, size: int) -> None:
        """Count meaningless bytes. They distinguish a wrong rate from a silent line."""
        self._message.heard += size

    # --- bid

    def bid(self) -> State:
        """Bid for the line, for the oldest message or for an announced one."""
        self._message = _Message()
        return self._put_bid()

    def _put_bid(self) -> State:
        self._notice(_BID_SENT, "ENQ")
        self._shared.out.append(_ENQ)
        self._shared.arm(self._profile.answer_timeout_s)
        return _BIDDING

    def bid_again(self) -> State:
        """Repeat a bid that was not answered in time, up to the limit."""
        message = self._message
        if message.bids >= self._profile.bid_limit:
            return self._give_up(*_explain_silence(message))
        message.bids += 1
        self._notice(NoticeKind.TIME_OUT, "no answer to ENQ")
        self._notice(NoticeKind.BID_REPEAT, f"ENQ sent {message.bids} times")
        return self._put_bid()

    def note_bid_refused(self) -> State:
        """Record a NAK to a bid. Assumed: it means "not now". The next bid follows at the time-out of this bid."""
        self._notice(NoticeKind.NAK_RECEIVED, "bid refused")
        self._message.bid_refused = True
        return _BIDDING

    def send_first(self) -> State:
        """Send the first block after the bid was acknowledged, or hold the line until there is a message."""
        self._notice(_ACK_RECEIVED, "bid acknowledged")
        return self._begin()

    def send_first_reversed(self) -> State:
        """Send the first block after an acknowledge by RVI: do the same as `send_first`, and listen after the
        message.
        """
        self._note_reversed()
        return self._begin()

    def _begin(self) -> State:
        if self._shared.is_overdue():
            return self.bid_again()  # this side was delayed, so the other side no longer waits for a block
        if self.queue:
            return self._put_block()
        self.announced = False
        self._shared.arm(HOLDING_SHARE * self._profile.answer_timeout_s)
        return _HOLDING

    def send_held(self) -> State:
        """Send the message for which the line is held."""
        return self.release() if self._shared.is_overdue() else self._put_block()

    def release(self) -> State:
        """Release the line by EOT, because no message was queued in time."""
        self._notice(NoticeKind.RELEASED, "no message received for the bid in time")
        self._shared.out.append(_EOT)
        return self._after_eot()

    def _after_eot(self) -> State:
        """Return the state after our EOT: idle, or listening if the other side requested the line."""
        if not self._message.reversed:
            return _IDLE
        self._shared.arm(self._profile.answer_timeout_s)
        return State.LISTENING

    def resume(self) -> State:
        """Return to idle, because the other side did not use the line that it had requested, or ended our bid."""
        return _IDLE

    # --- blocks

    def _encode(self) -> None:
        profile = self._profile
        alternation = profile.stx_alternation
        self._blocks = [
            encode_block(telegram, profile.dle_stuffing, _stx(alternation, number, len(telegram)))
            for number, telegram in enumerate(self.queue[0])
        ]

    def _put_block(self) -> State:
        shared = self._shared
        shared.unended = False  # a side that accepts our block has abandoned its own message
        if not self._blocks:
            self._encode()
        block = self._blocks[self._message.index]
        shared.out += block
        shared.arm(self._profile.answer_timeout_s, len(block))
        return _AWAITING_ACK

    def send_next(self) -> State:
        """Send the next block after an acknowledge, or EOT after the last block."""
        self._notice(_ACK_RECEIVED, "block acknowledged")
        return self._continue()

    def send_next_reversed(self) -> State:
        """Send the next block after an acknowledge by RVI: do the same as `send_next`, and listen after the
        message.

        One EOT ends all blocks of a message, so the line can be given up only after the last block.
        """
        self._note_reversed()
        return self._continue()

    def _continue(self) -> State:
        message = self._message
        self._shared.journal.count(_BLOCKS_SENT)
        message.index += 1
        message.repeats = 0
        if message.index < len(self._blocks):
            return self._put_block()
        self._shared.out.append(_EOT)
        self._drop_oldest()
        self._shared.journal.tell(_MESSAGE_SENT, _MESSAGES_SENT)
        return self._after_eot()

    def _note_reversed(self) -> None:
        self._notice(NoticeKind.RVI, "line requested")
        self._message.reversed = True

    def repeat_refused(self) -> State:
        """Repeat a block that was refused by NAK."""
        self._notice(NoticeKind.NAK_RECEIVED, "block refused")
        return self._repeat("refused by NAK")

    def repeat_unanswered(self) -> State:
        """Repeat a block that was not answered in time."""
        self._notice(NoticeKind.TIME_OUT, "no answer to a block")
        return self._repeat("without an answer")

    def _repeat(self, how: str) -> State:
        message = self._message
        if message.repeats >= self._profile.repeat_limit:
            self._shared.out.append(_EOT)
            return self._give_up(
                LinkFailure.REPEATS_EXHAUSTED,
                f"a block was sent {message.repeats + 1} times and not acknowledged; the last time {how}",
            )
        message.repeats += 1
        self._notice(NoticeKind.REPEAT, f"repeat {message.repeats}")
        return self._put_block()

    def wait_longer(self) -> State:
        """Extend the time-out after a WACK to a bid or to a block, up to the limit."""
        message = self._message
        message.wacks += 1
        self._notice(NoticeKind.WACK, f"asked to wait {message.wacks} times")
        if message.wacks > self._profile.wack_limit:
            self._shared.out.append(_EOT)
            return self._give_up(LinkFailure.WACK_LIMIT, f"asked to wait {message.wacks} times (WACK)")
        self._shared.arm(self._profile.answer_timeout_s)
        return self._shared.state

    # --- failure

    def abort(self) -> State:
        """Abandon the message, because the receiver answered a block with EOT."""
        return self._give_up(LinkFailure.ABORTED, "the receiver answered a block with EOT")

    def leave_to_other_side(self) -> State:
        """Abandon our message, because the receiver answered a block with ENQ.

        Assumed: a receiver that bids no longer expects our message. Most likely, it accepted the block, its ACK was
        lost, and it considered the message complete. Repeating the message could execute an order twice.
        """
        return self._give_up(LinkFailure.INTERRUPTED, "the receiver bid (ENQ) instead of answering a block")

    def _drop_oldest(self) -> None:
        if self.queue:
            self.queue.popleft()
        else:  # the bid failed before its message was queued
            self.announced = False
        self._blocks = []

    def _give_up(self, reason: LinkFailure, text: str, remedy: str = "") -> State:
        self._drop_oldest()
        self._shared.journal.tell(LinkFailed(reason, text, remedy), Count.MESSAGES_FAILED)
        return _IDLE


def _stx(alternation: str, number: int, size: int) -> int:
    """Return the STX of a block. `number` is its index in the message, from 0; `size` is the size of its telegram."""
    counted = {"off": 0, "toggle": number, "parity": size}[alternation]
    return _STX_ODD if counted % 2 else _STX


def _check_telegram(telegram: bytes, max_telegram: int) -> None:
    """Raise LocalProtocolError if no receiver could decode the telegram."""
    if len(telegram) > max_telegram:
        raise LocalProtocolError(
            f"a telegram of {len(telegram)} bytes is too long for a block of {max_telegram}"
        )
    if len(telegram) not in telegram_sizes(int.from_bytes(telegram[:2], "big"), LENGTH_STYLES):
        raise LocalProtocolError(
            f"a telegram of {len(telegram)} bytes has a wrong length field: its end could not be found"
        )


def _explain_silence(message: _Message) -> tuple[LinkFailure, str, str]:
    """Return the reason why no bid for a message was acknowledged: the failure, its text, and checks for an
    operator.
    """
    if message.bid_refused:
        return LinkFailure.BID_REFUSED, f"{message.bids} bids (ENQ) were refused by NAK", ""
    if message.heard:
        text = f"{message.bids} bids (ENQ) were answered by {message.heard} meaningless bytes"
        return LinkFailure.ONLY_NOISE, text, "check the rate and the parity on both sides"
    return (
        LinkFailure.NO_ANSWER,
        f"nothing received after {message.bids} bids (ENQ)",
        "check cable and power, rate and parity, and that the robot has enabled link control",
    )
