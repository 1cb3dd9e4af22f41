"""Search for the settings of a robot's link as a plan without I/O: it returns the next try, given the answers so
far.

Only "read status" is ever sent, which changes nothing in the controller. Each try is one such query. An
acknowledged bid (ENQ) proves rate and parity. An acknowledged block proves how lengths are counted and whether a
DLE (10h) inside a telegram is doubled. A readable answer proves that the controller counts and doubles
as the bridge does.

A controller that accepts the length of the complete telegram is queried once more with the length of the data
alone, because the only client that is known to have moved a real S3 counted the length of every move that way. If
the controller answers both, the result is the length of the data alone, as the profile `observed-client`, because a
probe cannot test a move.

A plain "read status" contains no 10h, and its answer contains one only by chance. Doubling is therefore tested with
a function suffix of 10h. Assumed: a controller answers this query, or refuses it as a wrong suffix (code 2), and
does nothing else.
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
"""Baud rates to try, the most likely first. Source: computer-link specification, section 1; all but 9600 assumed."""
PARITIES = (Parity.EVEN, Parity.NONE)
"""Parities that are tried at every baud rate before odd parity is tried at any baud rate."""
LIKELY, LIKELY_BIDS = 2, 3
"""Number of line settings that are tried with several bids, and number of these bids. Chosen: a controller that
bids itself, for an unsolicited message, does not answer a bid before it has bid again, after 2 s (computer-link
specification, section 2, assumed).
"""


class Query(Enum):
    """Query of a try. The values are telegrams."""

    PLAIN = read_status()
    MARKED = Telegram(FunctionCode.READ_STATUS, TelegramType.ORDER, suffix=int(Control.DLE))
    """Query that contains a 10h."""


class Reply(StrEnum):
    """Result of a try, for display."""

    UNAVAILABLE = "line settings not supported"
    SILENCE = "silence"
    NOISE = "noise only"
    BID_REFUSED = "bid refused"
    BLOCK_REFUSED = "bid acknowledged, block not"
    UNREADABLE = "block acknowledged, no readable answer"
    REFUSED = "order refused"
    ANSWERED = "answered"


LINE_WRONG = frozenset((Reply.UNAVAILABLE, Reply.SILENCE, Reply.NOISE, Reply.BID_REFUSED))
"""Replies that do not prove rate and parity."""
BLOCK_ACCEPTED = frozenset((Reply.UNREADABLE, Reply.REFUSED, Reply.ANSWERED))
"""Replies that prove that the controller acknowledged the block of the query."""
READABLE = frozenset((Reply.REFUSED, Reply.ANSWERED))
"""Replies that contain a readable block of the controller."""


@dataclass(frozen=True, slots=True)
class Try:
    """Settings of one query."""

    line: LineSettings | None
    """Line settings; None for a wire whose line is configured elsewhere."""
    length_style: LengthStyle
    dle_stuffing: DleStuffing
    query: Query
    bids: int = 1
    """Number of ENQ that are sent before the line settings are abandoned."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a try."""

    reply: Reply
    text: str = ""
    """Details of the result, for display."""
    holds_dle: bool = False
    """Whether the answer contains a 10h. If so, a readable answer proves whether the controller doubles it."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Link settings with which the controller answers."""

    line: LineSettings | None
    answered: tuple[LengthStyle, ...]
    """Length styles with which the controller answered "read status"."""
    dle_stuffing: DleStuffing
    stuffing_evidence: str
    """Evidence for the doubling of DLE; empty if there is none."""

    @property
    def profile(self) -> str:
        """Name of the profile that matches the answered settings, or otherwise of the default profile."""
        observed = settings_of_profile(OBSERVED_CLIENT)
        fits = observed["length_style"] in self.answered and observed["dle_stuffing"] == self.dle_stuffing
        return OBSERVED_CLIENT if fits else DEFAULT_PROFILE

    @property
    def length_style(self) -> LengthStyle:
        """Length style of the profile, or otherwise the first one that was answered."""
        style: LengthStyle = settings_of_profile(self.profile).get("length_style", self.answered[0])
        return style


_Steps: TypeAlias = Generator[Try, Outcome, Finding | None]
"""Generator that yields tries, receives their outcomes, and returns the settings that work, or None."""
_Doubling: TypeAlias = Generator[Try, Outcome, tuple[DleStuffing, str]]
"""Generator that yields tries, receives their outcomes, and returns the doubling of DLE and the evidence for it."""


class Search:
    """Search that tries the line settings one after another until the controller answers."""

    def __init__(self, lines: Sequence[LineSettings | None]) -> None:
        self._steps = _on_lines(lines)
        self.attempt: Try | None = next(self._steps)
        """Next try; None if the search has ended."""
        self.finding: Finding | None = None
        """Settings that work; None until they are known."""

    def take(self, outcome: Outcome) -> None:
        """Continue with the next try, given the outcome of the present one."""
        try:
            self.attempt = self._steps.send(outcome)
        except StopIteration as end:
            self.attempt, self.finding = None, end.value


def likely_lines(first: LineSettings) -> tuple[LineSettings, ...]:
    """Return the line settings in the order in which they are tried, beginning with the line settings of a URL."""
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
        if outcome.reply in BLOCK_ACCEPTED:
            how = "once" if stuffing == "off" else "twice"
            return stuffing, f"a query with 10h sent {how} was acknowledged"
    return "off", ""
