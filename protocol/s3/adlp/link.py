"""One end of an ADLP-10 link, PC or robot, without I/O. What it does when is in `transitions`."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from protocol.endpoint import LocalProtocolError
from protocol.s3.adlp.block import (
    HEADER_SIZE,
    LENGTH_STYLES,
    Block,
    BlockFormat,
    BlockScanner,
    Control,
    Flaw,
    Token,
    encode_block,
)
from protocol.s3.adlp.events import (
    LinkEvent,
    LinkFailed,
    LinkFailure,
    MessageReceived,
    MessageSent,
    NoticeKind,
    Role,
)
from protocol.s3.adlp.journal import Count, Journal
from protocol.s3.adlp.profile import LengthStyle, LinkProfile
from protocol.s3.adlp.progress import Receiving, Sending, check_telegram, unanswered
from protocol.s3.adlp.transitions import TRANSITIONS, Action, State, Stimulus

QUEUE_LIMIT = 16
"""Messages that may wait to be sent. Mark: chosen."""
MESSAGE_LIMIT = 4096
"""Blocks of one incoming message that are kept: half a megabyte. Mark: chosen."""
GARBAGE_SIZE = 5
"""After so many meaningless bytes in one run a control byte is one more of them, until the line falls silent:
else the data of a mutilated block would be answered. Mark: chosen (STX, length and addresses of a block)."""
HOLDING_SHARE = 0.5
"""Of the time that the other side waits for a block, so long is a line held for a message that is on its way here.
Mark: chosen."""

_ACCEPTED_STYLES: dict[str, tuple[LengthStyle, ...]] = {
    "both": LENGTH_STYLES,
    "whole": ("whole",),
    "data": ("data",),
}
_CONTROL_STIMULI = {
    Control.ENQ: Stimulus.ENQ,
    Control.ACK: Stimulus.ACK,
    Control.NAK: Stimulus.NAK,
    Control.WACK: Stimulus.WACK,
    Control.RVI: Stimulus.RVI,
    Control.EOT: Stimulus.EOT,
}
_ANSWERS = frozenset((Control.ACK, Control.NAK, Control.WACK, Control.RVI))
_RECEIVING = frozenset((State.AWAITING_BLOCK, State.AWAITING_MORE, State.DISCARDING))

# Asked for with every byte, by names of this module: until Python 3.12 an enum's own name costs five times that.
_IDLE, _BIDDING, _HOLDING, _DISCARDING = State.IDLE, State.BIDDING, State.HOLDING, State.DISCARDING
_AWAITING_ACK, _AWAITING_BLOCK, _AWAITING_MORE = State.AWAITING_ACK, State.AWAITING_BLOCK, State.AWAITING_MORE
_BLOCK, _BAD_CHECKSUM = Stimulus.BLOCK, Stimulus.BAD_CHECKSUM
_NOISE, _MUTILATED = Stimulus.NOISE, Stimulus.MUTILATED
_ENQ, _ACK, _EOT = Control.ENQ, Control.ACK, Control.EOT
_STX, _STX_ODD = Control.STX, Control.STX_ODD
_SEND = Stimulus.SEND
_BID_SENT, _BID_RECEIVED = NoticeKind.BID_SENT, NoticeKind.BID_RECEIVED
_ACK_SENT, _ACK_RECEIVED = NoticeKind.ACK_SENT, NoticeKind.ACK_RECEIVED
_MESSAGE_SENT = MessageSent()


class Link:
    """An endpoint for bytes. Messages go out in the order in which they were queued, one at a time."""

    def __init__(self, role: Role, profile: LinkProfile) -> None:
        self._role = role
        self._profile = profile
        styles = _ACCEPTED_STYLES[profile.accepted_lengths] if role is Role.ROBOT else LENGTH_STYLES[:1]
        self._scanner = BlockScanner(BlockFormat(profile.dle_stuffing, styles, profile.max_telegram))
        self._gap_time = profile.gap_time
        self._character_time = profile.character_time
        self._state = State.IDLE
        self._now = 0.0
        self._state_deadline: float | None = None
        self._gap_deadline: float | None = None
        self._queue: deque[tuple[bytes, ...]] = deque()
        """Telegrams of the messages that wait to be sent."""
        self._announced = False
        """A bid is to go out, or has, for a message that is not there yet."""
        self._blocks: list[bytes] = []
        """Those of the oldest message as blocks; empty until the bid for it has gone out."""
        self._sending = Sending()
        self._receiving = Receiving([])
        self._received: Block
        """The block that is being judged."""
        self._unended = False
        """The last message received was taken as ended without its EOT: its last block may be repeated."""
        self._noise = 0
        """Length of the present run of noise."""
        self._out = bytearray()
        self._journal = Journal()
        self._notice = self._journal.notice
        self._actions: dict[Action, Callable[[], State]] = {
            action: getattr(self, f"_{action.value}") for action in Action
        }

    @property
    def state(self) -> State:
        """Where this end stands."""
        return self._state

    @property
    def receiving(self) -> bool:
        """A message of the other side has begun and not ended."""
        return self._state in _RECEIVING

    @property
    def ahead(self) -> bool:
        """A bid for the next message has gone out."""
        return self._state is _BIDDING or self._state is _HOLDING

    @property
    def verbose(self) -> bool:
        """Whether each bid and ACK is told (`ROUTINE`) and not only counted; may be set at any time."""
        return self._journal.verbose

    @verbose.setter
    def verbose(self, verbose: bool) -> None:
        self._journal.verbose = verbose

    @property
    def counters(self) -> Mapping[str, int]:
        """Totals since the start by the text of `Count` and `NoticeKind`; a live read-only view."""
        return self._journal.counters

    def send(self, telegrams: Sequence[bytes]) -> None:
        """Queue one message, a block for each telegram.

        Raises LocalProtocolError when there is no telegram, one is too long or states another length than it
        has, or the queue is full.
        """
        if not telegrams:
            raise LocalProtocolError("a message needs at least one telegram")
        if len(self._queue) >= QUEUE_LIMIT:
            raise LocalProtocolError(f"{QUEUE_LIMIT} messages are waiting already")
        for telegram in telegrams:
            check_telegram(telegram, self._profile.max_telegram)
        self._queue.append(tuple(telegrams))
        self._announced = False

    def announce(self) -> None:
        """Bid for a message that `send` is about to be given: the other side's ACK comes while it is still being made.

        If it takes longer than half the time that the other side waits for a block, the line is given back.
        """
        self._announced = True

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes off the line. Data that came counts even when a deadline has passed unhandled before."""
        self._now = now
        for token in self._scanner.feed(data):
            self._take(token)
        waiting = self._noise or self._scanner.pending or self._state is _DISCARDING
        self._gap_deadline = now + self._gap_time if waiting else None

    def next_event(self) -> LinkEvent | None:
        """The oldest event not yet taken, or None."""
        return self._journal.next_event()

    def data_to_send(self, now: float) -> bytes:
        """Bytes for the line; a waiting message begins its bid here."""
        self._now = now
        if self._state is _IDLE:
            if self._queue or self._announced:
                self._step(_SEND)
        elif self._state is _HOLDING and self._queue:
            self._step(_SEND)
        if not self._out:
            if self._queue and not self._blocks:
                self._encode()  # the bid has gone out, and nobody waits for this yet
            return b""
        data = bytes(self._out)
        self._out.clear()
        return data

    def next_deadline(self) -> float | None:
        """The next time-out, seconds."""
        gap, state = self._gap_deadline, self._state_deadline
        if gap is None or state is None:
            return state if gap is None else gap
        return gap if self._block_is_coming() else min(gap, state)

    def handle_deadline(self, now: float) -> None:
        """Act on the time-outs up to now."""
        self._now = now
        if self._gap_deadline is not None and now >= self._gap_deadline:
            self._gap_deadline = None
            pending = self._scanner.drop()
            self._add_noise(pending)
            if pending or self._state is State.DISCARDING:
                self._step(Stimulus.GAP)
            self._end_noise()
        if self._state_deadline is not None and now >= self._state_deadline and not self._block_is_coming():
            self._state_deadline = None
            self._step(Stimulus.TIME_OUT)

    # --- the machine

    def _take(self, token: Token) -> None:
        match token:
            case Control():
                if self._noise >= GARBAGE_SIZE:
                    self._step(Stimulus.NOISE, 1)
                elif self._is_too_early(token):
                    self._notice(NoticeKind.STRAY_CONTROL, f"{token.name} too early to be about what we said")
                else:
                    self._step(_CONTROL_STIMULI[token], 1)
            case Block():
                self._received = token
                self._step(Stimulus.BLOCK, token.size)
            case Flaw(at=1):
                self._step(Stimulus.NOISE, token.size)
            case Flaw():
                self._notice(NoticeKind.BAD_CHECKSUM if token.whole else NoticeKind.BAD_BLOCK, token.text)
                self._step(Stimulus.BAD_CHECKSUM if token.whole else Stimulus.MUTILATED, token.size)
            case _:
                self._step(Stimulus.NOISE, len(token.data))

    def _step(self, stimulus: Stimulus, size: int = 0) -> None:
        """Look up and act. `size` is the length of what came, for the noise account."""
        whole = stimulus is _BLOCK or stimulus is _BAD_CHECKSUM
        discarding = self._state is _DISCARDING and not whole
        if discarding or stimulus is _NOISE or stimulus is _MUTILATED:
            self._add_noise(size)
        elif self._noise and size:
            self._end_noise()
        transition = TRANSITIONS.get((self._state, stimulus))
        if transition is None:
            self._ignore(stimulus, size)
            return
        self._state = self._actions[transition.action]()
        if self._state is _IDLE:
            self._state_deadline = None

    def _ignore(self, stimulus: Stimulus, size: int) -> None:
        match stimulus:
            case Stimulus.NOISE | Stimulus.MUTILATED | Stimulus.GAP:
                pass  # on the noise account already
            case Stimulus.BAD_CHECKSUM:
                self._add_noise(size)  # if it was cut short, its tail follows
                self._notice(NoticeKind.STRAY_BLOCK, f"{stimulus} while {self._state}")
            case Stimulus.BLOCK:
                self._sending.heard += size
                self._notice(NoticeKind.STRAY_BLOCK, f"{stimulus} while {self._state}")
            case _:
                self._notice(NoticeKind.STRAY_CONTROL, f"{stimulus} while {self._state}")

    def _is_too_early(self, control: Control) -> bool:
        """Whether it came before the other side can have heard us: then it is a byte that the line made of another.

        A second ENQ would get a second ACK, and a second ACK acknowledges a block that nobody has seen.
        """
        if self._state is _AWAITING_ACK:
            return bool(self._out) and control in _ANSWERS
        if control is not _ENQ:
            return False
        if self._state is _AWAITING_BLOCK:
            # Our ACK and a character have to pass. Behind a NAK the rest of its block may come, and no bid (observed).
            short, gap = 2.5 * self._character_time, self._gap_time
            return self._now < self._receiving.asked_at + (gap if self._receiving.naks else short)
        return self._state is _AWAITING_MORE and bool(self._out)

    def _block_is_coming(self) -> bool:
        """The gap time-out stands for the state's own while the block that is waited for comes in."""
        return bool(self._scanner.pending) and (
            self._state is _AWAITING_BLOCK or self._state is _AWAITING_MORE
        )

    def _arm(self, seconds: float, characters: int = 1) -> None:
        """Time out so long after the characters just handed out have left the line."""
        self._state_deadline = self._now + characters * self._character_time + seconds

    def _add_noise(self, size: int) -> None:
        self._noise += size
        self._sending.heard += size
        self._journal.count(Count.NOISE_BYTES, size)

    def _end_noise(self) -> None:
        self._notice(NoticeKind.NOISE, f"{self._noise} bytes without meaning dropped")
        self._noise = 0

    # --- sending

    def _bid(self) -> State:
        self._sending = Sending()
        self._put_bid()
        return _BIDDING

    def _put_bid(self) -> None:
        self._notice(_BID_SENT, "ENQ")
        self._out.append(_ENQ)
        self._arm(self._profile.answer_timeout_s)

    def _bid_again(self) -> State:
        sending = self._sending
        if sending.bids >= self._profile.bid_limit:
            return self._give_up(*unanswered(sending))
        sending.bids += 1
        self._notice(NoticeKind.TIME_OUT, "no answer to ENQ")
        self._notice(NoticeKind.BID_REPEAT, f"ENQ sent {sending.bids} times")
        self._put_bid()
        return _BIDDING

    def _note_bid_refused(self) -> State:
        # Assumed: a NAK to a bid means "not now"; the next bid comes when this one's time is over.
        self._notice(NoticeKind.NAK_RECEIVED, "bid refused")
        self._sending.bid_refused = True
        return _BIDDING

    def _collide(self) -> State:
        self._notice(NoticeKind.COLLISION, f"both sides bid, the {self._profile.collision_winner} goes first")
        if self._profile.collision_winner == self._role:
            return _BIDDING
        return self._accept_bid()

    def _send_first(self) -> State:
        self._notice(_ACK_RECEIVED, "bid acknowledged")
        return self._begin()

    def _send_first_reversed(self) -> State:
        self._note_reversed()
        return self._begin()

    def _begin(self) -> State:
        if self._is_overdue():
            return self._bid_again()  # held up on this side: the other no longer waits for a block
        if self._queue:
            return self._put_block()
        self._announced = False
        self._arm(HOLDING_SHARE * self._profile.answer_timeout_s)
        return _HOLDING

    def _send_held(self) -> State:
        return self._release() if self._is_overdue() else self._put_block()

    def _is_overdue(self) -> bool:
        """The time-out of this state has passed and was not handled: whoever is above took longer than that."""
        return self._state_deadline is not None and self._now > self._state_deadline

    def _release(self) -> State:
        self._notice(NoticeKind.RELEASED, "no message came for the bid in time")
        self._out.append(_EOT)
        return self._leave()

    def _leave(self) -> State:
        """Behind our EOT: idle, unless the other side asked for the line."""
        if not self._sending.reversed:
            return _IDLE
        self._arm(self._profile.answer_timeout_s)
        return State.LISTENING

    def _encode(self) -> None:
        profile = self._profile
        toggle = profile.stx_alternation == "toggle"
        self._blocks = [
            encode_block(telegram, profile.dle_stuffing, _STX_ODD if toggle and number % 2 else _STX)
            for number, telegram in enumerate(self._queue[0])
        ]

    def _put_block(self) -> State:
        self._unended = False  # who takes our block has left its own message
        if not self._blocks:
            self._encode()
        block = self._blocks[self._sending.index]
        self._out += block
        self._arm(self._profile.answer_timeout_s, len(block))
        return _AWAITING_ACK

    def _send_next(self) -> State:
        self._notice(_ACK_RECEIVED, "block acknowledged")
        return self._go_on()

    def _go_on(self) -> State:
        sending = self._sending
        self._journal.count(Count.BLOCKS_SENT)
        sending.index += 1
        sending.repeats = 0
        if sending.index < len(self._blocks):
            return self._put_block()
        self._out.append(_EOT)
        self._drop_oldest()
        self._journal.tell(_MESSAGE_SENT, Count.MESSAGES_SENT)
        return self._leave()

    def _send_next_reversed(self) -> State:
        # One EOT ends all blocks of a message, so "as soon as it can" is after the last block of this one.
        self._note_reversed()
        return self._go_on()

    def _note_reversed(self) -> None:
        self._notice(NoticeKind.RVI, "line asked for")
        self._sending.reversed = True

    def _repeat_refused(self) -> State:
        self._notice(NoticeKind.NAK_RECEIVED, "block refused")
        return self._repeat("refused by NAK")

    def _repeat_unanswered(self) -> State:
        self._notice(NoticeKind.TIME_OUT, "no answer to a block")
        return self._repeat("without an answer")

    def _repeat(self, how: str) -> State:
        sending = self._sending
        if sending.repeats >= self._profile.repeat_limit:
            self._out.append(Control.EOT)
            return self._give_up(
                LinkFailure.REPEATS_EXHAUSTED,
                f"a block was sent {sending.repeats + 1} times and not acknowledged, the last time {how}",
            )
        sending.repeats += 1
        self._notice(NoticeKind.REPEAT, f"repeat {sending.repeats}")
        return self._put_block()

    def _wait_longer(self) -> State:
        sending = self._sending
        sending.wacks += 1
        self._notice(NoticeKind.WACK, f"asked to wait {sending.wacks} times")
        if sending.wacks > self._profile.wack_limit:
            self._out.append(Control.EOT)
            return self._give_up(LinkFailure.WACK_LIMIT, f"asked to wait {sending.wacks} times (WACK)")
        self._arm(self._profile.answer_timeout_s)
        return self._state

    def _abort(self) -> State:
        return self._give_up(LinkFailure.ABORTED, "the receiver answered a block with EOT")

    def _interrupt(self) -> State:
        # Assumed: a receiver that bids has left our message. Most likely it took the block, its ACK was lost
        # and it treated the message as ended; to repeat the message would have an order done twice.
        self._give_up(LinkFailure.INTERRUPTED, "the receiver bid (ENQ) instead of answering a block")
        return self._accept_bid()

    def _drop_oldest(self) -> None:
        if self._queue:
            self._queue.popleft()
        else:  # the bid has failed before its message was there
            self._announced = False
        self._blocks = []

    def _give_up(self, reason: LinkFailure, text: str) -> State:
        self._drop_oldest()
        self._journal.tell(LinkFailed(reason, text), Count.MESSAGES_FAILED)
        return _IDLE

    def _resume(self) -> State:
        return _IDLE

    # --- receiving

    def _accept_bid(self) -> State:
        self._lose_unfinished("began anew")
        self._receiving = Receiving([])
        self._unended = False
        self._notice(_BID_RECEIVED, "ENQ")
        self._put_ack("bid acknowledged")
        self._arm_for_block()
        return _AWAITING_BLOCK

    def _put_ack(self, text: str) -> None:
        self._notice(_ACK_SENT, text)
        self._out.append(_ACK)

    def _arm_for_block(self) -> None:
        # A sender that missed our answer repeats after its own time-out: be there a little longer.
        self._receiving.asked_at = self._now
        self._arm(self._profile.answer_timeout_s + self._gap_time)

    def _accept_block(self) -> State:
        block, receiving = self._received, self._receiving
        if self._repeats_last(block):
            self._notice(NoticeKind.DUPLICATE, "block repeated though it was acknowledged")
        elif len(receiving.telegrams) >= MESSAGE_LIMIT:
            self._out.append(Control.EOT)
            return self._lose(LinkFailure.TOO_LONG, f"a message of more than {MESSAGE_LIMIT} blocks")
        else:
            self._journal.count(Count.BLOCKS_RECEIVED)
            receiving.telegrams.append(block.telegram)
            receiving.last = block
        return self._acknowledge_block()

    def _repeats_last(self, block: Block) -> bool:
        """Its STX says that it is the block that was accepted last."""
        last = self._receiving.last
        return self._profile.stx_alternation == "toggle" and last is not None and last.stx == block.stx

    def _acknowledge_block(self) -> State:
        self._receiving.naks = 0
        self._receiving.block_due = False
        self._put_ack("block acknowledged")
        self._arm(self._gap_time)
        return _AWAITING_MORE

    def _refuse_block(self) -> State:
        receiving = self._receiving
        if receiving.naks >= self._profile.repeat_limit:
            self._notice(NoticeKind.GAVE_UP, f"no valid block after {receiving.naks} NAK")
            self._lose_unfinished("never became valid")
            return _IDLE
        receiving.naks += 1
        receiving.block_due = True
        self._notice(NoticeKind.NAK_SENT, f"{receiving.naks} in a row")
        self._out.append(Control.NAK)
        self._arm_for_block()
        return _AWAITING_BLOCK

    def _discard(self) -> State:
        self._arm(self._profile.answer_timeout_s)
        return State.DISCARDING

    def _swallow(self) -> State:
        return State.DISCARDING

    def _judge_garbage(self) -> State:
        # Assumed: after an acknowledged block, garbage far shorter than any block is a mutilated EOT.
        if not self._receiving.block_due and self._noise < HEADER_SIZE:
            return self._deliver_unended()
        self._notice(NoticeKind.GAP, f"silence after {self._noise} bytes that are no block")
        return self._refuse_block()

    def _deliver(self) -> State:
        telegrams = tuple(self._receiving.telegrams)
        self._receiving.telegrams.clear()
        if telegrams:  # else the repeat of a block that was delivered before
            self._journal.tell(MessageReceived(telegrams), Count.MESSAGES_RECEIVED)
        return _IDLE

    def _deliver_unended(self) -> State:
        self._notice(NoticeKind.MISSING_EOT, "message taken as ended")
        self._unended = True
        return self._deliver()

    def _deliver_accept_bid(self) -> State:
        self._deliver_unended()
        return self._accept_bid()

    def _end_early(self) -> State:
        return self._lose(LinkFailure.EARLY_EOT, "the other side ended its message without a valid block")

    def _abandon(self) -> State:
        self._notice(NoticeKind.TIME_OUT, "no block came")
        self._lose_unfinished("fell silent")
        return _IDLE

    def _lose_unfinished(self, how: str) -> None:
        if self._receiving.telegrams:
            self._lose(LinkFailure.INCOMPLETE, f"a message of the other side {how} in the middle")

    def _lose(self, reason: LinkFailure, text: str) -> State:
        self._receiving.telegrams.clear()
        self._journal.tell(LinkFailed(reason, text), Count.MESSAGES_FAILED)
        return _IDLE

    def _recognise_late(self) -> State:
        # Our ACK was lost or late, and the message taken as ended meanwhile. More blocks of it may follow.
        last, block = self._receiving.last, self._received
        if self._unended and block == last:
            self._notice(NoticeKind.DUPLICATE, "block repeated after its message was taken as ended")
            return self._acknowledge_block()
        if self._unended and not self._repeats_last(block):
            self._notice(NoticeKind.LATE_BLOCK, "block of a message that was taken as ended")
            return self._accept_block()
        self._notice(NoticeKind.STRAY_BLOCK, f"{Stimulus.BLOCK} while {self._state}")
        return self._state
