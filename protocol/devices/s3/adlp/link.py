"""One end of an ADLP-10 link, PC or robot, without I/O: theory of operation, and the machine.

Roles
    Both ends run this machine. Either may bid for the idle line, which carries one message at a time.
    `Role` decides two things only: which end goes first when both bid (`collision_winner`), and which lengths of a
    telegram are understood (`accepted_lengths`, for the robot). The end that has won the line is the sender until its
    EOT, the other one the receiver.

An undisturbed message
    sender      ENQ        block 1        block 2        EOT
    receiver         ACK           ACK            ACK
    ENQ is a bid: "may I send?". Each block is acknowledged before the next one goes out. EOT ends the message and gives
    the line back. A message is one telegram or several, a block each. The other answers to a bid or a block: NAK, "send
    that again"; WACK, "wait"; RVI, "yes, and I want the line behind your message".

Parts
    `transitions` is the whole behaviour as a table: `State` × `Stimulus` → `Action` and the states that may follow.
    `SendingHalf` and `ReceivingHalf` have a method for each action; `Link._actions` lists which. `Link` makes stimuli
    out of bytes (`BlockScanner`) and of time, looks them up (`_step`), and does the two actions in which both halves
    meet. `Shared` has the state and the clock of the end. `Journal` keeps events and totals for the owner. A pair that
    is not in the table changes nothing; it is counted and told as stray (`_ignore`).

States
    IDLE            no message; a queued message bids from here.
    LISTENING       as IDLE, but the other side asked for the line by RVI: we do not bid before the time-out.
    BIDDING         our ENQ is out.
    HOLDING         our bid was acknowledged, and its message is not here yet (see "Bidding ahead").
    AWAITING_ACK    our block is out.
    AWAITING_BLOCK  we acknowledged a bid or refused a block: a block must come.
    AWAITING_MORE   we acknowledged a block: another block or EOT must come.
    DISCARDING      garbage came instead of a block: we wait for silence, then judge it.

Time-outs (seconds from the end of the characters that we handed out last, `Shared.arm`)
    BIDDING, AWAITING_ACK   `answer_timeout_s`, then the same again: `bid_limit` bids, `repeat_limit` repeats of a
                            block, `wack_limit` WACKs. Behind the last one the message has failed (`LinkFailed`).
    AWAITING_BLOCK          `answer_timeout_s` and a gap: a sender that missed our answer repeats within that time.
    AWAITING_MORE           one gap. The EOT is a single byte and may be lost: the message is then taken as ended, for
                            its blocks were acknowledged. A block that comes later is recognised (`recognise_late`).
    gap                     `gap_time` without a byte, inside a block or behind garbage: the block is refused by NAK.
    A block that comes in holds off the state's own time-out; the gap stands for it (`_block_is_coming`). Deadlines that
    the owner did not handle in time do not count against data that came first (`receive`). A late owner is noticed
    where it matters: behind an old ACK the other side no longer waits, and a bid goes out again (`Shared.is_overdue`).

Contention
    Both bid at once: each hears ENQ while BIDDING (`_collide`). The `collision_winner` waits further for its ACK, the
    other end acknowledges, takes the message, and bids again from IDLE; its own message stays queued.
    ENQ instead of an answer to a block (`_interrupt`): the other side has left our message. It may have taken the
    block, so the message fails and is never repeated: an order must not be done twice.

Bidding ahead
    `announce` bids for a message that is still being made: bid and ACK travel meanwhile. The ACK then leads to HOLDING
    ("the line is held"). `send` continues from there. When no message comes within `HOLDING_SHARE` of
    `answer_timeout_s`, EOT gives the line back (`SendingHalf.release`).

Noise
    No check character covers the control bytes, so rules guard them. Behind `GARBAGE_SIZE` meaningless bytes a control
    byte is one more of them, until silence: it may be data of a mutilated block. In DISCARDING only a whole block
    counts. Two bytes are never what they seem (`_is_too_early`). One is an answer to a block that has not left yet, the
    other a bid before our last answer can have been heard. The line made them of others; a second ACK would acknowledge
    a block that was never received.

What all this promises the owner is in the package's docstring. Source: computer-link specification, section 2.
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
"""After so many meaningless bytes in one run a control byte is one more of them, until the line falls silent. Otherwise
the data of a mutilated block would be answered. Mark: chosen (STX, length and addresses of a block).
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

# Asked for with every byte, by names of this module: until Python 3.12 an enum's own name costs five times that.
_IDLE, _BIDDING, _HOLDING, _DISCARDING = State.IDLE, State.BIDDING, State.HOLDING, State.DISCARDING
_AWAITING_ACK, _AWAITING_BLOCK, _AWAITING_MORE = State.AWAITING_ACK, State.AWAITING_BLOCK, State.AWAITING_MORE
_BLOCK, _BAD_CHECKSUM = Stimulus.BLOCK, Stimulus.BAD_CHECKSUM
_NOISE, _MUTILATED, _SEND = Stimulus.NOISE, Stimulus.MUTILATED, Stimulus.SEND
_ENQ = Control.ENQ


class Link:
    """An endpoint for bytes. Messages go out in the order in which they were queued, one at a time."""

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
        """Return the method of each action; it returns the next state."""
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

    # --- questions of the owner

    @property
    def state(self) -> State:
        """State of this end."""
        return self._shared.state

    @property
    def receiving(self) -> bool:
        """A message of the other side has begun and not ended."""
        return self._shared.state in _RECEIVING

    @property
    def ahead(self) -> bool:
        """A bid for the next message has gone out."""
        state = self._shared.state
        return state is _BIDDING or state is _HOLDING

    @property
    def verbose(self) -> bool:
        """Whether each bid and ACK is told (`ROUTINE`) and not only counted; may be set at any time."""
        return self._shared.journal.verbose

    @verbose.setter
    def verbose(self, verbose: bool) -> None:
        self._shared.journal.verbose = verbose

    @property
    def counters(self) -> Mapping[str, int]:
        """Totals since the start by the text of `Count` and `NoticeKind`; a live read-only view."""
        return self._shared.journal.counters

    # --- actions of the owner

    def send(self, telegrams: Sequence[bytes]) -> None:
        """Queue one message, a block for each telegram.

        Raises LocalProtocolError when there is no telegram, one is too long or states another length than it
        has, or the queue is full.
        """
        self._sender.put(telegrams)

    def announce(self) -> None:
        """Bid for a message that `send` is about to be given: the other side's ACK comes while it is still being made.

        If it takes longer than half the time that the other side waits for a block, the line is given back.
        """
        self._sender.announced = True

    def note(self, kind: NoticeKind, text: str) -> None:
        """Count, and tell as a notice, what the owner knows of the telegrams that it sends."""
        self._notice(kind, text)

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes off the line. Data that came counts even when a deadline has passed unhandled before."""
        shared = self._shared
        shared.now = now
        for token in self._scanner.feed(data):
            self._take(token)
        waiting = shared.noise or self._scanner.pending or shared.state is _DISCARDING
        self._gap_deadline = now + shared.gap_time if waiting else None

    def next_event(self) -> LinkEvent | None:
        """Return the oldest event not yet taken, or None."""
        return self._shared.journal.next_event()

    def data_to_send(self, now: float) -> bytes:
        """Bytes for the line; a waiting message begins its bid here."""
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
        """Return the next time-out, seconds."""
        gap, state = self._gap_deadline, self._shared.deadline
        if gap is None or state is None:
            return state if gap is None else gap
        return gap if self._block_is_coming() else min(gap, state)

    def handle_deadline(self, now: float) -> None:
        """Act on the time-outs up to now."""
        shared = self._shared
        shared.now = now
        if self._gap_deadline is not None and now >= self._gap_deadline:
            self._gap_deadline = None
            pending = self._scanner.drop()
            self._add_noise(pending)
            if pending or shared.state is _DISCARDING:
                self._step(Stimulus.GAP)
            shared.end_noise()
        if shared.deadline is not None and now >= shared.deadline and not self._block_is_coming():
            shared.deadline = None
            self._step(Stimulus.TIME_OUT)

    # --- from bytes to stimuli

    def _take(self, token: Token) -> None:
        match token:
            case Control():
                if self._shared.noise >= GARBAGE_SIZE:
                    self._step(_NOISE, 1)
                elif self._is_too_early(token):
                    self._notice(NoticeKind.STRAY_CONTROL, f"{token.name} too early to be about what we said")
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
        """Whether it came before the other side can have heard us: then it is a byte that the line made of another.

        A second ENQ would get a second ACK, and a second ACK acknowledges a block that was never received.
        """
        shared = self._shared
        if shared.state is _AWAITING_ACK:
            return bool(shared.out) and control in _ANSWERS
        if control is not _ENQ:
            return False
        if shared.state is _AWAITING_BLOCK:
            return self._receiver.hears_bid_too_early()
        return shared.state is _AWAITING_MORE and bool(shared.out)

    def _block_is_coming(self) -> bool:
        """Replace the state's own time-out by that of the gap while the expected block arrives."""
        state = self._shared.state
        return bool(self._scanner.pending) and (state is _AWAITING_BLOCK or state is _AWAITING_MORE)

    def _add_noise(self, size: int) -> None:
        self._shared.add_noise(size)
        self._sender.hear(size)

    # --- the machine

    def _step(self, stimulus: Stimulus, size: int = 0) -> None:
        """Look up and act. `size` is the length of what came, for the noise account."""
        shared = self._shared
        whole = stimulus is _BLOCK or stimulus is _BAD_CHECKSUM
        discarding = shared.state is _DISCARDING and not whole
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
                pass  # on the noise account already
            case Stimulus.BAD_CHECKSUM:
                self._add_noise(size)  # if it was cut short, its tail follows
                self._notice(NoticeKind.STRAY_BLOCK, stray)
            case Stimulus.BLOCK:
                self._sender.hear(size)
                self._notice(NoticeKind.STRAY_BLOCK, stray)
            case _:
                self._notice(NoticeKind.STRAY_CONTROL, stray)

    def _collide(self) -> State:
        """Both sides have bid."""
        winner = self._profile.collision_winner
        self._notice(NoticeKind.COLLISION, f"both sides bid, the {winner} goes first")
        return _BIDDING if winner == self._role else self._receiver.accept_bid()

    def _interrupt(self) -> State:
        """Handle a bid of the other side in place of the acknowledge of a block."""
        self._sender.leave_to_other_side()
        return self._receiver.accept_bid()
