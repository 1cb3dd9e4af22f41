"""Passive monitor of a computer link. It receives pieces of both directions, and returns one line for each block
and each problem.

Pure; it is given the time. ENQ, ACK and EOT in their regular order do not have lines of their own. The line of a
block includes the times of its bid and of its acknowledgement. It is output when the answer to the block is known.

Source: computer-link specification, section 2.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from hil_bridge.device_commands.s3.capture import Piece, Sender
from hil_bridge.device_commands.s3.telegram_text import telegram_text
from protocol.devices.s3.adlp import (
    BLOCK_OVERHEAD,
    CHUNK,
    LENGTH_STYLES,
    Block,
    BlockFormat,
    BlockScanner,
    Control,
    Flaw,
    LinkProfile,
    Token,
)
from protocol.devices.s3.arap import KNOWN, OrderBook

GARBAGE_SIZE = 5
"""Number of consecutive meaningless bytes after which a control byte counts as meaningless, too. Chosen: as in the
link.
"""


@dataclass(frozen=True, slots=True)
class Line:
    """Line of the monitor's output."""

    at: float
    """Time of the last byte, s."""
    sender: Sender
    text: str
    line_time: float | None = None
    """Duration of a block's characters on the line, s."""
    data: bytes = b""
    """Bytes of the line. For a block, its telegram without the frame."""
    trouble: bool = False
    """Whether the line reports a problem."""


@dataclass(slots=True)
class Counts:
    """Totals of a monitored link."""

    blocks: int = 0
    repeats: int = 0
    refusals: int = 0
    """Number of NAK bytes."""
    unanswered: int = 0
    """Number of blocks and bids without an answer."""
    collisions: int = 0
    garbage: int = 0
    """Number of meaningless bytes."""
    busy: float = 0.0
    """Total duration of all characters on the line, s."""


@dataclass(slots=True)
class _Bid:
    sender: Sender
    at: float
    answered: float | None = None


@dataclass(slots=True)
class _Pending:
    """Block that has not been answered yet."""

    sender: Sender
    at: float
    block: Block
    marks: list[str]
    """Descriptions of the anomalies and waiting times of the block."""
    trouble: bool
    """Whether one of `marks` is a problem."""


@dataclass(slots=True)
class _Direction:
    """State of one direction of the link."""

    scanner: BlockScanner
    newest: float = 0.0
    garbage: bytearray = field(default_factory=bytearray)
    garbage_text: str = ""
    recent: bytes = b""
    """Newest bytes, up to the length of the longest block."""
    last: bytes = b""
    """Newest telegram."""
    acknowledged: bool = True
    """Whether the block was acknowledged."""
    repeats: int = 0
    open: bool = False
    """Whether a message has begun but its EOT has not arrived."""
    further: int | None = None
    """Function of a telegram that continues in another block, or None."""


class LinkMonitor:
    """Monitor that decodes pieces in order of time. `next_line` returns the resulting lines."""

    def __init__(self, profile: LinkProfile, orders: OrderBook = KNOWN) -> None:
        self._profile = profile
        self._orders = orders
        self._gap = profile.gap_time + CHUNK * profile.character_time
        self._directions: dict[Sender, _Direction] = {}
        for sender in Sender:
            styles = LENGTH_STYLES[:1] if sender is Sender.ROBOT else LENGTH_STYLES
            scanner = BlockScanner(BlockFormat(profile.dle_stuffing, styles, profile.max_telegram))
            self._directions[sender] = _Direction(scanner)
        self._bid: _Bid | None = None
        self._pending: _Pending | None = None
        self._lines: deque[Line] = deque()
        self.counts = Counts()
        self._controls: dict[Control, Callable[[Sender, float], None]] = {
            Control.ENQ: self._enq,
            Control.ACK: self._ack,
            Control.NAK: self._nak,
            Control.WACK: self._wack,
            Control.RVI: self._rvi,
            Control.EOT: self._eot,
        }

    def next_line(self) -> Line | None:
        """Return the oldest pending line, or None."""
        return self._lines.popleft() if self._lines else None

    def take(self, piece: Piece) -> None:
        """Process a piece of traffic."""
        self.idle(piece.at)
        for sender in Sender:
            if sender is not piece.sender:
                self._end_garbage(sender)
        direction = self._directions[piece.sender]
        direction.newest = piece.at
        self.counts.busy += len(piece.data) * self._profile.character_time
        direction.recent = (direction.recent + piece.data)[-2 * self._profile.max_telegram - BLOCK_OVERHEAD :]
        for token in direction.scanner.feed(piece.data):
            self._token(piece.sender, token, piece.at)

    def idle(self, now: float) -> None:
        """Advance to `now` without new bytes, and end everything that has waited too long."""
        for sender, direction in self._directions.items():
            if now - direction.newest > self._gap:
                self._break_off(sender)
                self._end_garbage(sender)
        limit = self._profile.answer_timeout_s
        if self._pending is not None and now - self._pending.at > limit:
            self.counts.unanswered += 1
            self._close("no answer", trouble=True)
        bid = self._bid
        if bid is not None and bid.answered is None and now - bid.at > limit:
            self._unanswered_bid(bid)

    def finish(self) -> None:
        """End the capture and output everything that is still incomplete."""
        for sender in Sender:
            self._break_off(sender)
            self._end_garbage(sender)
        if self._pending is not None:
            self._close("the capture ends here")

    # --- tokens

    def _token(self, sender: Sender, token: Token, at: float) -> None:
        direction = self._directions[sender]
        match token:
            case Block():
                self._end_garbage(sender)
                self._block(sender, token, at)
            case Flaw(whole=True):
                self._end_garbage(sender)
                self._trouble(at, sender, f"damaged block of {token.size} bytes: {token.text}")
                self._damaged(direction)
            case Flaw():
                if token.at > 1 and not direction.garbage:
                    direction.garbage_text = f"damaged block: {token.text}"
                    self._damaged(direction)
                direction.garbage += bytes((Control.DLE,))
            case Control() if direction.garbage_text or len(direction.garbage) >= GARBAGE_SIZE:
                direction.garbage.append(token)
            case Control():
                self._end_garbage(sender)
                self._controls[token](sender, at)
            case noise:
                direction.garbage += noise.data

    def _break_off(self, sender: Sender) -> None:
        """End an incomplete block. It may be complete except for its check character: as long as a longer
        length is possible, the scanner waits for more bytes.
        """
        direction = self._directions[sender]
        if not (dropped := direction.scanner.drop()):
            return
        raw = direction.recent[-dropped:]
        text = f"a block broke off after {dropped} bytes"
        for style in LENGTH_STYLES:
            block = BlockFormat(self._profile.dle_stuffing, (style,), self._profile.max_telegram).decode(raw)
            if isinstance(block, Flaw) and block.whole:
                text = f"damaged block of {block.size} bytes: {block.text}"
        self.counts.garbage += dropped
        self._trouble(direction.newest, sender, text, raw)
        self._damaged(direction)

    def _damaged(self, direction: _Direction) -> None:
        direction.open, direction.acknowledged = True, False

    def _end_garbage(self, sender: Sender) -> None:
        direction = self._directions[sender]
        if not direction.garbage:
            return
        size = len(direction.garbage)
        self.counts.garbage += size
        text = direction.garbage_text or "no meaning"
        unit = "byte" if size == 1 else "bytes"
        self._trouble(direction.newest, sender, f"{size} {unit}: {text}", bytes(direction.garbage))
        direction.garbage.clear()
        direction.garbage_text = ""

    def _block(self, sender: Sender, block: Block, at: float) -> None:
        self._close_unanswered()
        direction = self._directions[sender]
        marks: list[str] = []
        trouble = False
        if direction.open and block.telegram == direction.last:
            direction.repeats += 1
            self.counts.repeats += 1
            why = ", though acknowledged" if direction.acknowledged else ""
            marks.append(f"repeat {direction.repeats}{why}")
            trouble = True
        else:
            direction.repeats = 0
        bid, self._bid = self._bid, None
        if bid is not None and bid.answered is not None:
            marks.append(f"bid {_ms(bid.answered - bid.at)}")
        elif sender is not Sender.UNKNOWN and (bid is not None or not direction.open):
            marks.append("without an acknowledged bid")
            trouble = True
        direction.open, direction.last, direction.acknowledged = True, block.telegram, False
        self.counts.blocks += 1
        self._pending = _Pending(sender, at, block, marks, trouble)

    def _close(self, how: str, trouble: bool = False, acknowledged: bool = False) -> None:
        """Output the line of the pending block because its answer is known."""
        pending, self._pending = self._pending, None
        assert pending is not None
        direction = self._directions[pending.sender]
        direction.acknowledged = acknowledged
        telegram = pending.block.telegram
        sender = pending.sender
        if sender is Sender.UNKNOWN:
            sender = Sender.PC if telegram[2] == 1 else Sender.ROBOT
        meaning, further = telegram_text(telegram, sender is Sender.ROBOT, direction.further, self._orders)
        if acknowledged:
            direction.further = further
        text = f"{meaning} [{', '.join((*pending.marks, how))}]"
        line_time = pending.block.size * self._profile.character_time
        self._lines.append(Line(pending.at, sender, text, line_time, telegram, trouble or pending.trouble))

    def _close_unanswered(self) -> None:
        """Close the pending block without an answer, because the new bytes are not an answer. If directions are
        unknown, the monitor may not receive the answer.
        """
        if self._pending is not None:
            self.counts.unanswered += 1
            self._close("no answer", trouble=self._pending.sender is not Sender.UNKNOWN)

    def _stray(self, at: float, sender: Sender, text: str) -> None:
        """Report an unexpected control byte, unless directions are unknown."""
        if sender is not Sender.UNKNOWN:
            self._trouble(at, sender, text)

    def _trouble(self, at: float, sender: Sender, text: str, data: bytes = b"") -> None:
        self._lines.append(Line(at, sender, text, None, data, True))

    # --- control bytes

    def _answers(self, sender: Sender) -> _Pending | None:
        """Return the block that a control byte of this sender may answer, or None."""
        pending = self._pending
        return pending if pending is not None and _faces(sender, pending.sender) else None

    def _enq(self, sender: Sender, at: float) -> None:
        if sender is not Sender.UNKNOWN and self._answers(sender) is not None:
            self._close("answered by a bid", trouble=True)
        self._close_unanswered()
        for other, direction in self._directions.items():
            if direction.open and direction.acknowledged:
                self._trouble(at, other, "EOT: missing before the next bid")
            direction.open = False
        bid = self._bid
        if bid is not None and bid.answered is None:
            if bid.sender is sender:
                self._unanswered_bid(bid)
            else:
                self.counts.collisions += 1
                self._trouble(at, sender, "both bid at once")
        self._bid = _Bid(sender, at)

    def _unanswered_bid(self, bid: _Bid) -> None:
        self.counts.unanswered += 1
        self._trouble(bid.at, bid.sender, "ENQ: no answer")
        self._bid = None

    def _ack(self, sender: Sender, at: float) -> None:
        if (pending := self._answers(sender)) is not None:
            self._close(f"ACK {_ms(at - pending.at)}", acknowledged=True)
        elif self._bid is not None and self._bid.answered is None and _faces(sender, self._bid.sender):
            self._bid.answered = at
        else:
            self._stray(at, sender, "ACK: there is nothing to acknowledge")

    def _nak(self, sender: Sender, at: float) -> None:
        self.counts.refusals += 1
        for other in Sender:
            if sender is not other:
                self._break_off(other)
        if (pending := self._answers(sender)) is not None:
            self._close(f"NAK {_ms(at - pending.at)}", trouble=True)
        elif self._bid is not None and self._bid.answered is None:
            self._trouble(at, sender, "NAK: the bid is refused")
        else:
            self._trouble(at, sender, "NAK")

    def _wack(self, sender: Sender, at: float) -> None:
        if (pending := self._answers(sender)) is not None:
            pending.marks.append(f"WACK {_ms(at - pending.at)}")
            pending.trouble = True
            pending.at = at
        else:
            self._trouble(at, sender, "WACK: wait")

    def _rvi(self, sender: Sender, at: float) -> None:
        if (pending := self._answers(sender)) is not None:
            self._close(f"RVI {_ms(at - pending.at)}: acknowledged, and asks for the line", True, True)
        else:
            self._trouble(at, sender, "RVI: asks for the line")

    def _eot(self, sender: Sender, at: float) -> None:
        if sender is not Sender.UNKNOWN and self._answers(sender) is not None:
            self._close("aborted by EOT", trouble=True)
            return
        self._close_unanswered()
        direction = self._directions[sender]
        if direction.open:
            if not direction.acknowledged:
                self._stray(at, sender, "EOT: the message is given up")
            direction.open = False
        elif self._bid is not None and self._bid.sender is sender:
            self._bid = None
            self._stray(at, sender, "EOT: the bid is given up")
        else:
            self._stray(at, sender, "EOT: nothing had begun")


def _faces(sender: Sender, other: Sender) -> bool:
    """Return whether one of two senders can answer the other."""
    return sender is not other or sender is Sender.UNKNOWN


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.1f} ms"
