"""The search for a robot's link settings, as a plan without I/O: what to try next, given what was answered.

Only read status is ever sent, which changes nothing in the controller. Each try is one such query. An acknowledged bid
(ENQ) proves rate and parity. An acknowledged block proves how lengths are counted and whether a DLE (10h) inside a
telegram is doubled. A readable answer proves that the controller counts and doubles as we do.

A controller that takes the length of the whole telegram is asked once more with the length of the data alone: of the
one client that is known to have moved a real S3, every move was counted so. Where it answers both, that is what is
found, as the profile `observed-client`, for no probe can try a move.

A plain read status holds no 10h, and its answer only by chance. So doubling is asked for with a function suffix of
10h: Assumed: a controller answers it, or refuses it as a wrong suffix (code 2), and does nothing else.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import TypeAlias

from hil_bridge.transports import LineSettings, Parity
from protocol.devices.s3.adlp import (
    DEFAULT_PROFILE,
    LENGTH_STYLES,
    OBSERVED_CLIENT,
    Control,
    DleStuffing,
    LengthStyle,
    settings_of_profile,
)
from protocol.devices.s3.arap import FunctionCode, Telegram, TelegramType, read_status

BAUDRATES = (9600, 19200, 4800, 2400, 1200, 600, 300)
"""The likeliest first. Source: computer-link specification, section 1; all but 9600 assumed."""
PARITIES = (Parity.EVEN, Parity.NONE)
"""Tried at every rate before odd parity is tried at any."""
LIKELY, LIKELY_BIDS = 2, 3
"""So many lines are bid for so often. Chosen: a controller that bids itself, to say something unasked, does not answer
a bid before it has bid again, after 2 s (computer-link specification, section 2, assumed).
"""


class Query(Enum):
    """Query of a try; the values are telegrams."""

    PLAIN = read_status()
    MARKED = Telegram(FunctionCode.READ_STATUS, TelegramType.ORDER, suffix=int(Control.DLE))
    """Holds a 10h."""


class Reply(StrEnum):
    """Result of a try, for people to read."""

    UNAVAILABLE = "line cannot be set so"
    SILENCE = "silence"
    NOISE = "noise only"
    BID_REFUSED = "bid refused"
    BLOCK_REFUSED = "bid acknowledged, block not"
    UNREADABLE = "block acknowledged, no readable answer"
    REFUSED = "order refused"
    ANSWERED = "answered"


LINE_WRONG = frozenset((Reply.UNAVAILABLE, Reply.SILENCE, Reply.NOISE, Reply.BID_REFUSED))
"""Nothing shows that rate and parity are right."""
BLOCK_TAKEN = frozenset((Reply.UNREADABLE, Reply.REFUSED, Reply.ANSWERED))
"""The controller acknowledged our block."""
READABLE = frozenset((Reply.REFUSED, Reply.ANSWERED))
"""We understood the controller's block."""


@dataclass(frozen=True, slots=True)
class Try:
    """Settings under which something is asked."""

    line: LineSettings | None
    """None for a wire whose line is set elsewhere."""
    length_style: LengthStyle
    dle_stuffing: DleStuffing
    query: Query
    bids: int = 1
    """ENQ sent before the line is given up."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a try."""

    reply: Reply
    text: str = ""
    """Details for people to read."""
    holds_dle: bool = False
    """The answer has a 10h in it: that it could be read tells whether the controller doubles it."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Settings that work."""

    line: LineSettings | None
    answered: tuple[LengthStyle, ...]
    """The ways of counting a length under which read status was answered."""
    dle_stuffing: DleStuffing
    stuffing_evidence: str
    """Evidence for the doubling; empty if there is none."""

    @property
    def profile(self) -> str:
        """The named set of settings that answered."""
        observed = settings_of_profile(OBSERVED_CLIENT)
        fits = observed["length_style"] in self.answered and observed["dle_stuffing"] == self.dle_stuffing
        return OBSERVED_CLIENT if fits else DEFAULT_PROFILE

    @property
    def length_style(self) -> LengthStyle:
        """As the profile says, or what was answered first."""
        style: LengthStyle = settings_of_profile(self.profile).get("length_style", self.answered[0])
        return style


_Steps: TypeAlias = Generator[Try, Outcome, Finding | None]
"""Gives tries, takes their outcomes, returns what works or None."""
_Doubling: TypeAlias = Generator[Try, Outcome, tuple[DleStuffing, str]]
"""As `_Steps`, but that it returns the doubling and how it was told."""


class Search:
    """Tries the lines one after the other until the controller answers on one."""

    def __init__(self, lines: Sequence[LineSettings | None]) -> None:
        self._steps = _on_lines(lines)
        self.attempt: Try | None = next(self._steps)
        """Next try; None when the search has ended."""
        self.finding: Finding | None = None
        """Settings that work, once they are known."""

    def take(self, outcome: Outcome) -> None:
        """Go on to the next try, knowing what came of the present one."""
        try:
            self.attempt = self._steps.send(outcome)
        except StopIteration as end:
            self.attempt, self.finding = None, end.value


def likely_lines(first: LineSettings) -> tuple[LineSettings, ...]:
    """Rates and parities in the order in which they are tried, beginning with what a URL names."""
    usual = (LineSettings(rate, parity) for rate in BAUDRATES for parity in PARITIES)
    odd = (LineSettings(rate, Parity.ODD) for rate in BAUDRATES)
    return tuple(dict.fromkeys((first, *usual, *odd)))


def _on_lines(lines: Sequence[LineSettings | None]) -> _Steps:
    for number, line in enumerate(lines):
        finding = yield from _on_line(line, LIKELY_BIDS if number < LIKELY else 1)
        if finding is not None:
            return finding
    return None


def _on_line(line: LineSettings | None, bids: int) -> _Steps:
    for style in LENGTH_STYLES:
        stuffing: DleStuffing = "off"
        outcome = yield Try(line, style, stuffing, Query.PLAIN, bids)
        if outcome.reply in LINE_WRONG:
            return None
        if outcome.reply is Reply.UNREADABLE:
            stuffing = "double"
            outcome = yield Try(line, style, stuffing, Query.PLAIN, bids)
        if outcome.reply not in READABLE:
            continue
        evidence = "an answer with 10h in it was understood"
        if not outcome.holds_dle:
            stuffing, evidence = yield from _doubling(line, style, bids)
        answered = [style]
        for other in LENGTH_STYLES[LENGTH_STYLES.index(style) + 1 :]:
            outcome = yield Try(line, other, stuffing, Query.PLAIN, bids)
            if outcome.reply in READABLE:
                answered.append(other)
        return Finding(line, tuple(answered), stuffing, evidence)
    return None


def _doubling(line: LineSettings | None, style: LengthStyle, bids: int) -> _Doubling:
    stuffings: tuple[DleStuffing, ...] = ("off", "double")
    for stuffing in stuffings:
        outcome = yield Try(line, style, stuffing, Query.MARKED, bids)
        if outcome.reply in BLOCK_TAKEN:
            how = "once" if stuffing == "off" else "twice"
            return stuffing, f"a query with 10h sent {how} was acknowledged"
    return "off", ""
