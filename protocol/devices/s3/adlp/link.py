"""One end of an ADLP-10 link, PC or robot, without I/O: theory of operation, and the state machine.

Roles
    Both ends run this state machine. Either may bid for the idle line, which carries one message at a time.
    `Role` decides two things only: which end goes first when both bid (`collision_winner`), and which lengths of a
    telegram are understood (`accepted_lengths`, for the robot). The end that has won the line is the sender until its
    EOT; the other end is the receiver.

Undisturbed message
    sender      ENQ        block 1        block 2        EOT
    receiver         ACK           ACK            ACK
    ENQ is a bid: "may I send?". Each block is acknowledged before the next one is sent. EOT ends the message and
    releases the line. A message consists of one or more telegrams, one per block. Other answers to a bid or a block:
    NAK, "repeat"; WACK, "wait"; RVI, "yes, and I request the line after your message".

Parts
    `transitions` defines the entire behaviour as a table: `State` × `Stimulus` → `Action` and the possible next states.
    `SendingHalf` and `ReceivingHalf` have a method for each action, listed in `Link._actions`. `Link` derives stimuli
    from bytes (`BlockScanner`) and from time, looks them up (`_step`), and performs the two actions that involve both
    halves. `Shared` holds the state and the clock of the end. `Journal` stores events and totals for the owner. A pair
    that is not in the table changes nothing; it is counted and reported as stray (`_ignore`).

States
    IDLE            no message; a queued message starts its bid from here.
    LISTENING       like IDLE, but the other side requested the line by RVI: we do not bid before the time-out.
    BIDDING         our ENQ has been sent.
    HOLDING         our bid was acknowledged, and its message is not queued yet (see "Bidding ahead").
    AWAITING_ACK    our block has been sent.
    AWAITING_BLOCK  we acknowledged a bid or refused a block: a block must follow.
    AWAITING_MORE   we acknowledged a block: another block or EOT must follow.
    DISCARDING      garbage arrived instead of a block: we wait for silence, then evaluate it.

Time-outs (seconds from the end of transmission of the last characters, `Shared.arm`)
    BIDDING, AWAITING_ACK   `answer_timeout_s`, then the same again: `bid_limit` bids, `repeat_limit` repeats of a
                            block, `wack_limit` WACKs. After the last one the message has failed (`LinkFailed`).
    AWAITING_BLOCK          `answer_timeout_s` and a gap: a sender that missed our answer repeats within that time.
    AWAITING_MORE           one gap. The EOT is a single byte and may be lost: the message is then considered complete,
                            because its blocks were acknowledged. A later block is recognised (`recognise_late`).
    gap                     `gap_time` without a byte, inside a block or after garbage: the block is refused by NAK.
    While a block arrives, the gap time-out replaces the state's own (`_extend_for_block`). Received data takes
    precedence over deadlines that the owner did not handle in time (`receive`). A late owner matters in one case: after
    an old ACK the other side no longer waits, so the bid is sent again (`Shared.is_overdue`).

Contention
    Both bid at once: each receives ENQ while BIDDING (`_collide`). The `collision_winner` keeps waiting for its ACK.
    The other end acknowledges, receives the message, and bids again from IDLE; its own message stays queued.
    ENQ instead of an answer to a block (`_interrupt`): the other side has abandoned our message. It may have accepted
    the block, so the message fails and is never repeated: an order must not be executed twice.

Bidding ahead
    `announce` bids for a message that is still being prepared, while bid and ACK are in transit. The ACK then leads to
    HOLDING ("the line is held"). `send` continues from there. If no message follows within `HOLDING_SHARE` of
    `answer_timeout_s`, EOT releases the line (`SendingHalf.release`).

Noise
    No check character covers the control bytes, so rules guard them. After `GARBAGE_SIZE` meaningless bytes a control
    byte is meaningless too, until silence: it may be data of a mutilated block. In DISCARDING only a complete block
    counts. Two bytes are never genuine (`_is_too_early`): an answer to a block that has not been sent yet, and a bid
    before our last answer can have been received. The line corrupted other bytes into them; a second ACK would
    acknowledge a block that was never received.

The guarantees to the owner are described in the package's docstring. Source: computer-link specification, section 2.
"""

from collections.abc import Callable, Mapping, Sequence

from protocol.devices.s3.adlp.block import (
    LENGTH_STYLES,
    Block,
    BlockFormat,
    BlockScanner,
    Control,
    Flaw,
    Token,
)
from protocol.devices.s3.adlp.events import LinkEvent, NoticeKind, Role
from protocol.devices.s3.adlp.profile import LengthStyle, LinkProfile
from protocol.devices.s3.adlp.receiving import ReceivingHalf
from protocol.devices.s3.adlp.sending import SendingHalf
from protocol.devices.s3.adlp.shared import Shared
from protocol.devices.s3.adlp.transitions import TRANSITIONS, Action, State, Stimulus

GARBAGE_SIZE = 5
"""Number of consecutive meaningless bytes after which a control byte is meaningless too, until the line is silent.
Otherwise, the data of a mutilated block would be answered. Mark: chosen (STX, length and addresses of a block).
"""

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

# Used with every byte, so bound to module names: before Python 3.12 an enum member lookup is five times slower.
_IDLE, _BIDDING, _HOLDING, _DISCARDING = State.IDLE, State.BIDDING, State.HOLDING, State.DISCARDING
_AWAITING_ACK, _AWAITING_BLOCK, _AWAITING_MORE = State.AWAITING_ACK, State.AWAITING_BLOCK, State.AWAITING_MORE
_BLOCK, _BAD_CHECKSUM = Stimulus.BLOCK, Stimulus.BAD_CHECKSUM
_NOISE, _MUTILATED, _SEND = Stimulus.NOISE, Stimulus.MUTILATED, Stimulus.SEND
_ENQ = Control.ENQ


class Link:
    """Byte endpoint of the link. Messages are sent one at a time, in the order in which they were queued."""

    def __init__(self, role: Role, profile: LinkProfile) -> None:
        self._role = role
        self._profile = profile
        styles = _ACCEPTED_STYLES[profile.accepted_lengths] if role is Role.ROBOT else LENGTH_STYLES[:1]
        end = profile.block_end if role is Role.ROBOT else "length"
        self._scanner = BlockScanner(BlockFormat(profile.dle_stuffing, styles, profile.max_telegram, end))
        self._gap_deadline: float | None = None
        self._shared = Shared(profile)
        self._notice = self._shared.notice
        self._sender = SendingHalf(self._shared)
        self._receiver = ReceivingHalf(self._shared)
        actions = self._actions()
        self._table: dict[State, dict[Stimulus, Callable[[], State]]] = {state: {} for state in State}
        for (state, stimulus), transition in TRANSITIONS.items():
            self._table[state][stimulus] = actions[transition.action]

    def _actions(self) -> dict[Action, Callable[[], State]]:
        """Return the method that performs each action and returns the next state."""
        sender, receiver = self._sender, self._receiver
        return {
            Action.BID: sender.bid,
            Action.BID_AGAIN: sender.bid_again,
            Action.NOTE_BID_REFUSED: sender.note_bid_refused,
            Action.COLLIDE: self._collide,
            Action.SEND_FIRST: sender.send_first,
            Action.SEND_FIRST_REVERSED: sender.send_first_reversed,
            Action.SEND_HELD: sender.send_held,
            Action.RELEASE: sender.release,
            Action.SEND_NEXT: sender.send_next,
            Action.SEND_NEXT_REVERSED: sender.send_next_reversed,
            Action.REPEAT_REFUSED: sender.repeat_refused,
            Action.REPEAT_UNANSWERED: sender.repeat_unanswered,
            Action.WAIT_LONGER: sender.wait_longer,
            Action.ABORT: sender.abort,
            Action.INTERRUPT: self._interrupt,
            Action.RESUME: sender.resume,
            Action.ACCEPT_BID: receiver.accept_bid,
            Action.ACCEPT_BLOCK: receiver.accept_block,
            Action.REFUSE_BLOCK: receiver.refuse_block,
            Action.DISCARD: receiver.discard,
            Action.SWALLOW: receiver.swallow,
            Action.JUDGE_GARBAGE: receiver.judge_garbage,
            Action.DELIVER: receiver.deliver,
            Action.DELIVER_UNENDED: receiver.deliver_unended,
            Action.DELIVER_ACCEPT_BID: receiver.deliver_accept_bid,
            Action.END_EARLY: receiver.end_early,
            Action.ABANDON: receiver.abandon,
            Action.RECOGNISE_LATE: receiver.recognise_late,
        }

    # --- owner's queries

    @property
    def state(self) -> State:
        """State of this end."""
        return self._shared.state

    @property
    def receiving(self) -> bool:
        """Whether an incoming message has started and has not ended."""
        return self._shared.state in _RECEIVING

    @property
    def ahead(self) -> bool:
        """Whether a bid for the next message has been sent."""
        state = self._shared.state
        return state is _BIDDING or state is _HOLDING

    @property
    def verbose(self) -> bool:
        """Whether each bid and ACK (`ROUTINE`) is reported in addition to being counted. May be set at any time."""
        return self._shared.journal.verbose

    @verbose.setter
    def verbose(self, verbose: bool) -> None:
        self._shared.journal.verbose = verbose

    @property
    def counters(self) -> Mapping[str, int]:
        """Live, read-only totals since the start, by the values of `Count` and `NoticeKind`."""
        return self._shared.journal.counters

    # --- owner's actions

    def send(self, telegrams: Sequence[bytes]) -> None:
        """Queue one message, with one block per telegram.

        Raises LocalProtocolError if there is no telegram, a telegram is too long or has a wrong length field, or
        the queue is full.
        """
        self._sender.put(telegrams)

    def announce(self) -> None:
        """Bid for a message that will be passed to `send` shortly, so that the other side's ACK arrives while the
        message is being prepared.

        The line is released if the preparation takes longer than half the time that the other side waits for a
        block.
        """
        self._sender.announced = True

    def note(self, kind: NoticeKind, text: str) -> None:
        """Report and count, as a notice, an observation of the owner about the telegrams that it sends."""
        self._notice(kind, text)

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes. They take precedence over any deadline that has passed and was not handled."""
        shared = self._shared
        shared.now = now
        for token in self._scanner.feed(data):
            self._process_token(token)
        waiting = shared.noise or self._scanner.pending or shared.state is _DISCARDING
        self._gap_deadline = now + shared.gap_time if waiting else None

    def next_event(self) -> LinkEvent | None:
        """Return the oldest event not yet taken, or None."""
        return self._shared.journal.next_event()

    def data_to_send(self, now: float) -> bytes:
        """Return the bytes to send. If a message is waiting, its bid starts here."""
        shared, sender = self._shared, self._sender
        shared.now = now
        if shared.state is _IDLE:
            if sender.queue or sender.announced:
                self._step(_SEND)
        elif shared.state is _HOLDING and sender.queue:
            self._step(_SEND)
        if not shared.out:
            sender.encode_early()
            return b""
        data = bytes(shared.out)
        shared.out.clear()
        return data

    def next_deadline(self) -> float | None:
        """Return the time of the next time-out, s."""
        gap, state = self._gap_deadline, self._shared.deadline
        if gap is None or state is None:
            return state if gap is None else gap
        return gap if self._extend_for_block() else min(gap, state)

    def handle_deadline(self, now: float) -> None:
        """Handle all time-outs up to `now`."""
        shared = self._shared
        shared.now = now
        if self._gap_deadline is not None and now >= self._gap_deadline:
            self._gap_deadline = None
            pending = self._scanner.drop()
            self._add_noise(pending)
            if pending or shared.state is _DISCARDING:
                self._step(Stimulus.GAP)
            shared.end_noise()
        if shared.deadline is not None and now >= shared.deadline and not self._extend_for_block():
            shared.deadline = None
            self._step(Stimulus.TIME_OUT)

    # --- from bytes to stimuli

    def _process_token(self, token: Token) -> None:
        match token:
            case Control():
                if self._shared.noise >= GARBAGE_SIZE:
                    self._step(_NOISE, 1)
                elif self._is_too_early(token):
                    self._notice(
                        NoticeKind.STRAY_CONTROL, f"{token.name} too early to answer our transmission"
                    )
                else:
                    self._step(_CONTROL_STIMULI[token], 1)
            case Block():
                self._receiver.block = token
                self._step(_BLOCK, token.size)
            case Flaw(at=1):
                self._step(_NOISE, token.size)
            case Flaw():
                self._notice(NoticeKind.BAD_CHECKSUM if token.whole else NoticeKind.BAD_BLOCK, token.text)
                self._step(_BAD_CHECKSUM if token.whole else _MUTILATED, token.size)
            case _:
                self._step(_NOISE, len(token.data))

    def _is_too_early(self, control: Control) -> bool:
        """Return whether a byte arrived so early that the other side cannot have received our bytes yet. The line
        has then corrupted another byte into it.

        A second ENQ would get a second ACK, and a second ACK would acknowledge a block that was never received.
        """
        shared = self._shared
        if shared.state is _AWAITING_ACK:
            return bool(shared.out) and control in _ANSWERS
        if control is not _ENQ:
            return False
        if shared.state is _AWAITING_BLOCK:
            return self._receiver.is_bid_too_early()
        return shared.state is _AWAITING_MORE and bool(shared.out)

    def _extend_for_block(self) -> bool:
        """Return whether the gap time-out replaces the state's time-out, because the expected block is arriving."""
        state = self._shared.state
        return bool(self._scanner.pending) and (state is _AWAITING_BLOCK or state is _AWAITING_MORE)

    def _add_noise(self, size: int) -> None:
        self._shared.add_noise(size)
        self._sender.hear(size)

    # --- the state machine

    def _step(self, stimulus: Stimulus, size: int = 0) -> None:
        """Look up the transition for a stimulus and execute it. `size` is the length of the received item, for the
        noise counter.
        """
        shared = self._shared
        is_complete = stimulus is _BLOCK or stimulus is _BAD_CHECKSUM
        discarding = shared.state is _DISCARDING and not is_complete
        if discarding or stimulus is _NOISE or stimulus is _MUTILATED:
            self._add_noise(size)
        elif shared.noise and size:
            shared.end_noise()
        act = self._table[shared.state].get(stimulus)
        if act is None:
            self._ignore(stimulus, size)
            return
        state = shared.state = act()
        if state is _IDLE:
            shared.deadline = None

    def _ignore(self, stimulus: Stimulus, size: int) -> None:
        stray = f"{stimulus} while {self._shared.state}"
        match stimulus:
            case Stimulus.NOISE | Stimulus.MUTILATED | Stimulus.GAP:
                pass  # already counted as noise
            case Stimulus.BAD_CHECKSUM:
                self._add_noise(size)  # if it was truncated, its tail follows
                self._notice(NoticeKind.STRAY_BLOCK, stray)
            case Stimulus.BLOCK:
                self._sender.hear(size)
                self._notice(NoticeKind.STRAY_BLOCK, stray)
            case _:
                self._notice(NoticeKind.STRAY_CONTROL, stray)

    def _collide(self) -> State:
        """Handle a collision: both sides have bid for the line."""
        winner = self._profile.collision_winner
        self._notice(NoticeKind.COLLISION, f"both sides bid; the {winner} goes first")
        return _BIDDING if winner == self._role else self._receiver.accept_bid()

    def _interrupt(self) -> State:
        """Handle a bid that the other side sent instead of acknowledging a block."""
        self._sender.leave_to_other_side()
        return self._receiver.accept_bid()
