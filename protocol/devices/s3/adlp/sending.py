"""The sending half of one end of the link: the queue, the bid, and the blocks until each is acknowledged.

Each public method that returns a `State` does one `Action` of the table in `transitions`.
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
"""Messages that may wait to be sent. Mark: chosen."""
HOLDING_SHARE = 0.5
"""Share of the time that the other side waits for a block. For so long the line is held for an announced message.
Mark: chosen."""

# Names of this module, for speed: until Python 3.12 an enum's own name costs five times that.
_IDLE, _BIDDING, _HOLDING = State.IDLE, State.BIDDING, State.HOLDING
_AWAITING_ACK = State.AWAITING_ACK
_ENQ, _EOT, _STX, _STX_ODD = Control.ENQ, Control.EOT, Control.STX, Control.STX_ODD
_BID_SENT, _ACK_RECEIVED = NoticeKind.BID_SENT, NoticeKind.ACK_RECEIVED
_BLOCKS_SENT, _MESSAGES_SENT = Count.BLOCKS_SENT, Count.MESSAGES_SENT
_MESSAGE_SENT = MessageSent()


@dataclass(slots=True)
class _Message:
    """State of the oldest queued message under way."""

    index: int = 0
    bids: int = 1
    repeats: int = 0
    wacks: int = 0
    heard: int = 0
    """Bytes that came since the first bid and meant nothing."""
    bid_refused: bool = False
    reversed: bool = False
    """The other side asked for the line."""


class SendingHalf:
    """Messages go out in the order in which they were queued, one at a time."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._profile = shared.profile
        self._notice = shared.notice
        self.queue: deque[tuple[bytes, ...]] = deque()
        """Telegrams of the messages that wait to be sent."""
        self.announced = False
        """A bid is to go out, or has, for a message that is not there yet."""
        self._blocks: list[bytes] = []
        """Blocks of the oldest message; empty until the bid for it has gone out."""
        self._message = _Message()

    def put(self, telegrams: Sequence[bytes]) -> None:
        """Queue a message. Raises LocalProtocolError for one that cannot travel."""
        if not telegrams:
            raise LocalProtocolError("a message needs at least one telegram")
        if len(self.queue) >= QUEUE_LIMIT:
            raise LocalProtocolError(f"{QUEUE_LIMIT} messages are waiting already")
        for telegram in telegrams:
            _check_telegram(telegram, self._profile.max_telegram)
        self.queue.append(tuple(telegrams))
        self.announced = False

    def encode_early(self) -> None:
        """Make the oldest message's blocks while its bid is on the line and no side waits for them yet."""
        if self.queue and not self._blocks:
            self._encode()

    def hear(self, size: int) -> None:
        """Count bytes without meaning: they tell a wrong rate from a silent line."""
        self._message.heard += size

    # --- the bid

    def bid(self) -> State:
        """Ask for the line, for the oldest message or for one that is announced."""
        self._message = _Message()
        return self._put_bid()

    def _put_bid(self) -> State:
        self._notice(_BID_SENT, "ENQ")
        self._shared.out.append(_ENQ)
        self._shared.arm(self._profile.answer_timeout_s)
        return _BIDDING

    def bid_again(self) -> State:
        """No answer to a bid came in time."""
        message = self._message
        if message.bids >= self._profile.bid_limit:
            return self._give_up(*_explain_silence(message))
        message.bids += 1
        self._notice(NoticeKind.TIME_OUT, "no answer to ENQ")
        self._notice(NoticeKind.BID_REPEAT, f"ENQ sent {message.bids} times")
        return self._put_bid()

    def note_bid_refused(self) -> State:
        """NAK to a bid. Assumed: it means "not now"; the next bid comes when this one's time is over."""
        self._notice(NoticeKind.NAK_RECEIVED, "bid refused")
        self._message.bid_refused = True
        return _BIDDING

    def send_first(self) -> State:
        """Send the first block after the bid was acknowledged, or hold the line until there is one."""
        self._notice(_ACK_RECEIVED, "bid acknowledged")
        return self._begin()

    def send_first_reversed(self) -> State:
        """Send the first block after an acknowledge by RVI: as `send_first`, and listen after the message."""
        self._note_reversed()
        return self._begin()

    def _begin(self) -> State:
        if self._shared.is_overdue():
            return self.bid_again()  # held up on this side: the other no longer waits for a block
        if self.queue:
            return self._put_block()
        self.announced = False
        self._shared.arm(HOLDING_SHARE * self._profile.answer_timeout_s)
        return _HOLDING

    def send_held(self) -> State:
        """Send the message for which the line is held."""
        return self.release() if self._shared.is_overdue() else self._put_block()

    def release(self) -> State:
        """Give a held line back."""
        self._notice(NoticeKind.RELEASED, "no message came for the bid in time")
        self._shared.out.append(_EOT)
        return self._leave()

    def _leave(self) -> State:
        """Behind our EOT: idle, unless the other side asked for the line."""
        if not self._message.reversed:
            return _IDLE
        self._shared.arm(self._profile.answer_timeout_s)
        return State.LISTENING

    def resume(self) -> State:
        """Return to idle: the other side did not use the line that it requested, or ended our bid."""
        return _IDLE

    # --- the blocks

    def _encode(self) -> None:
        profile = self._profile
        alternation = profile.stx_alternation
        self._blocks = [
            encode_block(telegram, profile.dle_stuffing, _stx(alternation, number, len(telegram)))
            for number, telegram in enumerate(self.queue[0])
        ]

    def _put_block(self) -> State:
        shared = self._shared
        shared.unended = False  # a side that takes our block has left its own message
        if not self._blocks:
            self._encode()
        block = self._blocks[self._message.index]
        shared.out += block
        shared.arm(self._profile.answer_timeout_s, len(block))
        return _AWAITING_ACK

    def send_next(self) -> State:
        """Send the next block after an acknowledge, or EOT after the last."""
        self._notice(_ACK_RECEIVED, "block acknowledged")
        return self._go_on()

    def send_next_reversed(self) -> State:
        """Send the next block after an acknowledge by RVI: as `send_next`, and listen after the message.

        One EOT ends all blocks of a message, so "as soon as it can" is after the last block of this one.
        """
        self._note_reversed()
        return self._go_on()

    def _go_on(self) -> State:
        message = self._message
        self._shared.journal.count(_BLOCKS_SENT)
        message.index += 1
        message.repeats = 0
        if message.index < len(self._blocks):
            return self._put_block()
        self._shared.out.append(_EOT)
        self._drop_oldest()
        self._shared.journal.tell(_MESSAGE_SENT, _MESSAGES_SENT)
        return self._leave()

    def _note_reversed(self) -> None:
        self._notice(NoticeKind.RVI, "line asked for")
        self._message.reversed = True

    def repeat_refused(self) -> State:
        """NAK to a block."""
        self._notice(NoticeKind.NAK_RECEIVED, "block refused")
        return self._repeat("refused by NAK")

    def repeat_unanswered(self) -> State:
        """No answer to a block came in time."""
        self._notice(NoticeKind.TIME_OUT, "no answer to a block")
        return self._repeat("without an answer")

    def _repeat(self, how: str) -> State:
        message = self._message
        if message.repeats >= self._profile.repeat_limit:
            self._shared.out.append(_EOT)
            return self._give_up(
                LinkFailure.REPEATS_EXHAUSTED,
                f"a block was sent {message.repeats + 1} times and not acknowledged, the last time {how}",
            )
        message.repeats += 1
        self._notice(NoticeKind.REPEAT, f"repeat {message.repeats}")
        return self._put_block()

    def wait_longer(self) -> State:
        """WACK to a bid or to a block."""
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
        """EOT to a block."""
        return self._give_up(LinkFailure.ABORTED, "the receiver answered a block with EOT")

    def leave_to_other_side(self) -> State:
        """ENQ to a block: our message is given up.

        Assumed: a receiver that bids has left our message. Most likely it took the block, its ACK was lost and it
        treated the message as ended. To repeat the message would have an order done twice.
        """
        return self._give_up(LinkFailure.INTERRUPTED, "the receiver bid (ENQ) instead of answering a block")

    def _drop_oldest(self) -> None:
        if self.queue:
            self.queue.popleft()
        else:  # the bid has failed before its message was there
            self.announced = False
        self._blocks = []

    def _give_up(self, reason: LinkFailure, text: str, remedy: str = "") -> State:
        self._drop_oldest()
        self._shared.journal.tell(LinkFailed(reason, text, remedy), Count.MESSAGES_FAILED)
        return _IDLE


def _stx(alternation: str, number: int, size: int) -> int:
    """How the block of a message with this number, from 0, begins; `size` is its telegram's."""
    counted = {"off": 0, "toggle": number, "parity": size}[alternation]
    return _STX_ODD if counted % 2 else _STX


def _check_telegram(telegram: bytes, max_telegram: int) -> None:
    """Raise LocalProtocolError for a telegram that no receiver could take."""
    if len(telegram) > max_telegram:
        raise LocalProtocolError(
            f"a telegram of {len(telegram)} bytes is too long for a block of {max_telegram}"
        )
    if len(telegram) not in telegram_sizes(int.from_bytes(telegram[:2], "big"), LENGTH_STYLES):
        raise LocalProtocolError(
            f"a telegram of {len(telegram)} bytes states another length: its end could not be found"
        )


def _explain_silence(message: _Message) -> tuple[LinkFailure, str, str]:
    """Why no bid for a message was acknowledged: the failure, its text, and checks for an operator."""
    if message.bid_refused:
        return LinkFailure.BID_REFUSED, f"{message.bids} bids (ENQ) were refused by NAK", ""
    if message.heard:
        text = f"{message.bids} bids (ENQ) were answered by {message.heard} bytes without meaning"
        return LinkFailure.ONLY_NOISE, text, "check the rate and the parity on both sides"
    return (
        LinkFailure.NO_ANSWER,
        f"nothing came after {message.bids} bids (ENQ)",
        "check cable and power, rate and parity, and that the robot has given the link control",
    )
