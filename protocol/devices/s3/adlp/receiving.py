"""Receiving half of one end of the link: the incoming bid, its blocks, and the complete message.

Each public method that returns a `State` performs one `Action` of the table in `transitions`.
"""

from dataclasses import dataclass, field

from protocol.devices.s3.adlp.block import HEADER_SIZE, Block, Control
from protocol.devices.s3.adlp.events import LinkFailed, LinkFailure, MessageReceived, NoticeKind
from protocol.devices.s3.adlp.journal import Count
from protocol.devices.s3.adlp.shared import Shared
from protocol.devices.s3.adlp.transitions import State, Stimulus

MESSAGE_LIMIT = 4096
"""Maximum number of buffered blocks of an incoming message: half a megabyte. Mark: chosen."""

# Bound to module names for speed: before Python 3.12 an enum member lookup is five times slower.
_IDLE, _AWAITING_BLOCK, _AWAITING_MORE = State.IDLE, State.AWAITING_BLOCK, State.AWAITING_MORE
_ACK = Control.ACK
_BID_RECEIVED, _ACK_SENT = NoticeKind.BID_RECEIVED, NoticeKind.ACK_SENT
_BLOCKS_RECEIVED, _MESSAGES_RECEIVED = Count.BLOCKS_RECEIVED, Count.MESSAGES_RECEIVED


@dataclass(slots=True)
class _Message:
    """State of the current incoming message."""

    telegrams: list[bytes] = field(default_factory=list)
    last: Block | None = None
    naks: int = 0
    asked_at: float = 0.0
    """Time at which a block was last requested, by an ACK to a bid or by a NAK, s."""
    block_due: bool = True
    """Whether a block must follow. False after a block has been acknowledged."""


class ReceivingHalf:
    """Receiver that acknowledges blocks one by one and reports the message at its end."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._profile = shared.profile
        self._notice = shared.notice
        self._message = _Message()
        self.block: Block
        """Block that is being processed."""

    def is_bid_too_early(self) -> bool:
        """Return whether the other side cannot have received our last answer yet, which means that an ENQ is not
        genuine.

        The transmission of our ACK and of one character must be over. After a NAK, the rest of the refused block
        may arrive, but no bid (observed).
        """
        shared, message = self._shared, self._message
        return shared.now < message.asked_at + (shared.gap_time if message.naks else shared.time_of(2.5))

    # --- incoming bid

    def accept_bid(self) -> State:
        """Acknowledge a bid and wait for the first block."""
        self._abandon_unfinished("restarted")
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
        # A sender that missed our answer repeats after its own time-out, so wait a little longer.
        shared = self._shared
        self._message.asked_at = shared.now
        shared.arm(self._profile.answer_timeout_s + shared.gap_time)

    # --- incoming blocks

    def accept_block(self) -> State:
        """Acknowledge a block with a correct check character, and store it unless it is a repeat."""
        block, message = self.block, self._message
        if self._repeats_last(block):
            self._notice(NoticeKind.DUPLICATE, "block repeated although it was acknowledged")
        elif len(message.telegrams) >= MESSAGE_LIMIT:
            self._shared.out.append(Control.EOT)
            return self._abandon(LinkFailure.TOO_LONG, f"a message of more than {MESSAGE_LIMIT} blocks")
        else:
            self._shared.journal.count(_BLOCKS_RECEIVED)
            message.telegrams.append(block.telegram)
            message.last = block
        return self._acknowledge_block()

    def _repeats_last(self, block: Block) -> bool:
        """Return whether the STX marks the block as a repeat of the last accepted block."""
        last = self._message.last
        return self._profile.stx_alternation == "toggle" and last is not None and last.stx == block.stx

    def _acknowledge_block(self) -> State:
        self._message.naks = 0
        self._message.block_due = False
        self._put_ack("block acknowledged")
        self._shared.arm(self._shared.gap_time)
        return _AWAITING_MORE

    def refuse_block(self) -> State:
        """Request a block again by NAK, or abandon the message if the limit has been reached."""
        message = self._message
        if message.naks >= self._profile.repeat_limit:
            self._notice(NoticeKind.GAVE_UP, f"no valid block after {message.naks} NAK")
            self._abandon_unfinished("never became valid")
            return _IDLE
        message.naks += 1
        message.block_due = True
        self._notice(NoticeKind.NAK_SENT, f"{message.naks} in a row")
        self._shared.out.append(Control.NAK)
        self._arm_for_block()
        return _AWAITING_BLOCK

    def discard(self) -> State:
        """Start to discard garbage that was received instead of a block. Wait for silence, so that our NAK does not
        collide with the remaining bytes.
        """
        self._shared.arm(self._profile.answer_timeout_s)
        return State.DISCARDING

    def swallow(self) -> State:
        """Discard one more byte of garbage."""
        return State.DISCARDING

    def judge_garbage(self) -> State:
        """Evaluate the garbage after it has ended.

        Assumed: after an acknowledged block, garbage far shorter than any block is a mutilated EOT.
        """
        if not self._message.block_due and self._shared.noise < HEADER_SIZE:
            return self.deliver_unended()
        self._notice(NoticeKind.GAP, f"silence after {self._shared.noise} bytes that are not a block")
        return self.refuse_block()

    def recognise_late(self) -> State:
        """Handle a block that arrives although no message is in progress.

        Our ACK was lost or late, and the message was considered complete. More blocks of it may follow.
        """
        last, block, unended = self._message.last, self.block, self._shared.unended
        if unended and block == last:
            self._notice(NoticeKind.DUPLICATE, "block repeated after its message was considered complete")
            return self._acknowledge_block()
        if unended and not self._repeats_last(block):
            self._notice(NoticeKind.LATE_BLOCK, "block of a message that was considered complete")
            return self.accept_block()
        state = self._shared.state
        self._notice(NoticeKind.STRAY_BLOCK, f"{Stimulus.BLOCK} while {state}")
        return state

    # --- end of the incoming message

    def deliver(self) -> State:
        """Deliver the message, because EOT was received after an acknowledged block."""
        telegrams = tuple(self._message.telegrams)
        self._message.telegrams.clear()
        if telegrams:  # otherwise, it is the repeat of a block that was already delivered
            self._shared.journal.tell(MessageReceived(telegrams), _MESSAGES_RECEIVED)
        return _IDLE

    def deliver_unended(self) -> State:
        """Deliver the message, because silence followed an acknowledged block: the EOT was lost."""
        self._notice(NoticeKind.MISSING_EOT, "message considered complete")
        self._shared.unended = True
        return self.deliver()

    def deliver_accept_bid(self) -> State:
        """Deliver the message and accept a bid, because an ENQ followed an acknowledged block: the EOT was lost,
        and the next message starts.
        """
        self.deliver_unended()
        return self.accept_bid()

    def end_early(self) -> State:
        """Abandon the message, because EOT was received instead of a block."""
        return self._abandon(LinkFailure.EARLY_EOT, "the other side ended its message without a valid block")

    def abandon(self) -> State:
        """Abandon the message, because no block was received in time."""
        self._notice(NoticeKind.TIME_OUT, "no block received")
        self._abandon_unfinished("fell silent")
        return _IDLE

    def _abandon_unfinished(self, how: str) -> None:
        if self._message.telegrams:
            self._abandon(LinkFailure.INCOMPLETE, f"a message of the other side {how} in the middle")

    def _abandon(self, reason: LinkFailure, text: str) -> State:
        self._message.telegrams.clear()
        self._shared.journal.tell(LinkFailed(reason, text), Count.MESSAGES_FAILED)
        return _IDLE
