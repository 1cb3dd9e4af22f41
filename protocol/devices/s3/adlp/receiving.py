"""The receiving half of one end of the link: the other side's bid, its blocks, and its message once it is complete.

Each public method that returns a `State` does one `Action` of the table in `transitions`.
"""

from dataclasses import dataclass, field

from protocol.devices.s3.adlp.block import HEADER_SIZE, Block, Control
from protocol.devices.s3.adlp.events import LinkFailed, LinkFailure, MessageReceived, NoticeKind
from protocol.devices.s3.adlp.journal import Count
from protocol.devices.s3.adlp.shared import Shared
from protocol.devices.s3.adlp.transitions import State, Stimulus

MESSAGE_LIMIT = 4096
"""Blocks of one incoming message that are kept: half a megabyte. Mark: chosen."""

# Names of this module, for speed: until Python 3.12 an enum's own name costs five times that.
_IDLE, _AWAITING_BLOCK, _AWAITING_MORE = State.IDLE, State.AWAITING_BLOCK, State.AWAITING_MORE
_ACK = Control.ACK
_BID_RECEIVED, _ACK_SENT = NoticeKind.BID_RECEIVED, NoticeKind.ACK_SENT
_BLOCKS_RECEIVED, _MESSAGES_RECEIVED = Count.BLOCKS_RECEIVED, Count.MESSAGES_RECEIVED


@dataclass(slots=True)
class _Message:
    """State of the other side's message under way."""

    telegrams: list[bytes] = field(default_factory=list)
    last: Block | None = None
    naks: int = 0
    asked_at: float = 0.0
    """When a block was last asked for, by ACK to a bid or by NAK, s."""
    block_due: bool = True
    """A block must come; false once one was acknowledged."""


class ReceivingHalf:
    """Blocks are acknowledged one by one; a message is told when it has ended."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._profile = shared.profile
        self._notice = shared.notice
        self._message = _Message()
        self.block: Block
        """The block that is being judged."""

    def hears_bid_too_early(self) -> bool:
        """Whether our last answer cannot have been heard by now, so that an ENQ is none.

        Our ACK and a character have to pass. Behind a NAK the rest of its block may come, and no bid (observed).
        """
        shared, message = self._shared, self._message
        return shared.now < message.asked_at + (shared.gap_time if message.naks else shared.time_of(2.5))

    # --- the other side's bid

    def accept_bid(self) -> State:
        """Acknowledge a bid and wait for the first block."""
        self._lose_unfinished("restarted")
        self._message = _Message()
        self._shared.unended = False
        self._notice(_BID_RECEIVED, "ENQ")
        self._put_ack("bid acknowledged")
        self._arm_for_block()
        return _AWAITING_BLOCK

    def _put_ack(self, text: str) -> None:
        self._notice(_ACK_SENT, text)
        self._shared.out.append(_ACK)

    def _arm_for_block(self) -> None:
        # A sender that missed our answer repeats after its own time-out: be there a little longer.
        shared = self._shared
        self._message.asked_at = shared.now
        shared.arm(self._profile.answer_timeout_s + shared.gap_time)

    # --- its blocks

    def accept_block(self) -> State:
        """Accept a block with a valid check character: keep it, unless it is a repeat, and acknowledge it."""
        block, message = self.block, self._message
        if self._repeats_last(block):
            self._notice(NoticeKind.DUPLICATE, "block repeated though it was acknowledged")
        elif len(message.telegrams) >= MESSAGE_LIMIT:
            self._shared.out.append(Control.EOT)
            return self._lose(LinkFailure.TOO_LONG, f"a message of more than {MESSAGE_LIMIT} blocks")
        else:
            self._shared.journal.count(_BLOCKS_RECEIVED)
            message.telegrams.append(block.telegram)
            message.last = block
        return self._acknowledge_block()

    def _repeats_last(self, block: Block) -> bool:
        """Its STX says that it is the block that was accepted last."""
        last = self._message.last
        return self._profile.stx_alternation == "toggle" and last is not None and last.stx == block.stx

    def _acknowledge_block(self) -> State:
        self._message.naks = 0
        self._message.block_due = False
        self._put_ack("block acknowledged")
        self._shared.arm(self._shared.gap_time)
        return _AWAITING_MORE

    def refuse_block(self) -> State:
        """Ask for a block again by NAK, so often and then no more."""
        message = self._message
        if message.naks >= self._profile.repeat_limit:
            self._notice(NoticeKind.GAVE_UP, f"no valid block after {message.naks} NAK")
            self._lose_unfinished("never became valid")
            return _IDLE
        message.naks += 1
        message.block_due = True
        self._notice(NoticeKind.NAK_SENT, f"{message.naks} in a row")
        self._shared.out.append(Control.NAK)
        self._arm_for_block()
        return _AWAITING_BLOCK

    def discard(self) -> State:
        """Garbage came where a block should: wait for silence, so that our NAK does not meet the rest."""
        self._shared.arm(self._profile.answer_timeout_s)
        return State.DISCARDING

    def swallow(self) -> State:
        """One more byte of the garbage."""
        return State.DISCARDING

    def judge_garbage(self) -> State:
        """Judge the bytes received since garbage began.

        Assumed: after an acknowledged block, garbage far shorter than any block is a mutilated EOT.
        """
        if not self._message.block_due and self._shared.noise < HEADER_SIZE:
            return self.deliver_unended()
        self._notice(NoticeKind.GAP, f"silence after {self._shared.noise} bytes that are no block")
        return self.refuse_block()

    def recognise_late(self) -> State:
        """Recognise a block that arrives although no message is open.

        Our ACK was lost or late, and the message taken as ended meanwhile. More blocks of it may follow.
        """
        last, block, unended = self._message.last, self.block, self._shared.unended
        if unended and block == last:
            self._notice(NoticeKind.DUPLICATE, "block repeated after its message was taken as ended")
            return self._acknowledge_block()
        if unended and not self._repeats_last(block):
            self._notice(NoticeKind.LATE_BLOCK, "block of a message that was taken as ended")
            return self.accept_block()
        state = self._shared.state
        self._notice(NoticeKind.STRAY_BLOCK, f"{Stimulus.BLOCK} while {state}")
        return state

    # --- the end of its message

    def deliver(self) -> State:
        """EOT behind an acknowledged block: the message is complete."""
        telegrams = tuple(self._message.telegrams)
        self._message.telegrams.clear()
        if telegrams:  # else the repeat of a block that was delivered before
            self._shared.journal.tell(MessageReceived(telegrams), _MESSAGES_RECEIVED)
        return _IDLE

    def deliver_unended(self) -> State:
        """Silence behind an acknowledged block: the EOT was lost."""
        self._notice(NoticeKind.MISSING_EOT, "message taken as ended")
        self._shared.unended = True
        return self.deliver()

    def deliver_accept_bid(self) -> State:
        """ENQ behind an acknowledged block: the EOT was lost, and the next message begins."""
        self.deliver_unended()
        return self.accept_bid()

    def end_early(self) -> State:
        """EOT where a block should come."""
        return self._lose(LinkFailure.EARLY_EOT, "the other side ended its message without a valid block")

    def abandon(self) -> State:
        """Silence where a block should come."""
        self._notice(NoticeKind.TIME_OUT, "no block came")
        self._lose_unfinished("fell silent")
        return _IDLE

    def _lose_unfinished(self, how: str) -> None:
        if self._message.telegrams:
            self._lose(LinkFailure.INCOMPLETE, f"a message of the other side {how} in the middle")

    def _lose(self, reason: LinkFailure, text: str) -> State:
        self._message.telegrams.clear()
        self._shared.journal.tell(LinkFailed(reason, text), Count.MESSAGES_FAILED)
        return _IDLE
