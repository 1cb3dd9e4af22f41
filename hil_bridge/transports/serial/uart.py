"""UART receiver: converts the levels of its line to characters, parity and framing errors, and breaks.

Pure; it is given the time. Reference: National Semiconductor PC16550D, Universal Asynchronous Receiver/Transmitter
with FIFOs, line status register; termios(3) for the characters that a Linux port delivers for a damaged one.
"""

import heapq
from dataclasses import dataclass
from enum import StrEnum

DATA_BITS = 8

SAMPLE_AT = 0.5 + 1 / 32
"""Sampling point of a receiver within a bit, in bit times. Standard: a clock of 16 times the baud rate detects the
edge of a start bit up to 1/16 of a bit late. The value here assumes half of that delay.
"""


class Parity(StrEnum):
    """Parity of a character, transmitted as the bit after the data bits."""

    NONE = "N"
    EVEN = "E"
    ODD = "O"


@dataclass(frozen=True, slots=True)
class LineSettings:
    """Format of characters on a serial line, with one start bit and 8 data bits."""

    baudrate: int = 9600
    parity: Parity = Parity.NONE
    stopbits: int = 1

    @property
    def bits(self) -> int:
        """Length of one character, bit times."""
        return 1 + DATA_BITS + (self.parity is not Parity.NONE) + self.stopbits

    def understands(self, sender: "LineSettings") -> bool:
        """Return whether a receiver with these settings reads every character of a sender correctly. A receiver
        checks the first stop bit only, so the number of stop bits does not matter.
        """
        return self.baudrate == sender.baudrate and self.parity is sender.parity

    def __str__(self) -> str:
        return f"{self.baudrate} {DATA_BITS}{self.parity.value}{self.stopbits}"


class Damaged(StrEnum):
    """Treatment of a character with a parity or framing error by the owner of a UART."""

    KEEP = "keep"
    """Read the character with the bits as received, and a break as 00h. This is the behaviour of a Linux port with
    INPCK, IGNPAR and PARMRK off, which is how pyserial configures it.
    """
    ZERO = "zero"
    """Read 00h instead. This is the behaviour of a Linux port with INPCK on."""
    DROP = "drop"
    """Read nothing. This is the behaviour of a Linux port with INPCK and IGNPAR on, and of firmware that checks the
    line status.
    """


class Flaw(StrEnum):
    """Flaws of a character."""

    PARITY = "parity"
    FRAMING = "framing"
    """The stop bit was low."""
    BREAK = "break"
    """All bits were low, including the stop bit."""


@dataclass(frozen=True, slots=True)
class LineErrors:
    """Counts of damaged characters that a receiver has detected since it was opened."""

    parity: int = 0
    framing: int = 0
    breaks: int = 0

    def __add__(self, other: "LineErrors") -> "LineErrors":
        return LineErrors(
            self.parity + other.parity, self.framing + other.framing, self.breaks + other.breaks
        )

    def __str__(self) -> str:
        counts = {"parity errors": self.parity, "framing errors": self.framing, "breaks": self.breaks}
        return ", ".join(f"{count} {what}" for what, count in counts.items() if count) or "no line errors"


COUNTED_AS = {
    Flaw.PARITY: LineErrors(parity=1),
    Flaw.FRAMING: LineErrors(framing=1),
    Flaw.BREAK: LineErrors(breaks=1),
}


@dataclass(frozen=True, slots=True)
class Character:
    """Received character."""

    byte: int
    flaw: Flaw | None = None


def taken(characters: list[Character], damaged: Damaged) -> bytes:
    """Return the bytes that the owner of a UART reads for these characters."""
    match damaged:
        case Damaged.KEEP:
            return bytes(character.byte for character in characters)
        case Damaged.ZERO:
            return bytes(0 if character.flaw else character.byte for character in characters)
        case Damaged.DROP:
            return bytes(character.byte for character in characters if not character.flaw)


def levels(byte: int, settings: LineSettings) -> tuple[int, ...]:
    """Return the level of each bit of a character in transmission order; 1 is the level of an idle line."""
    data = tuple(byte >> k & 1 for k in range(DATA_BITS))
    match settings.parity:
        case Parity.NONE:
            parity: tuple[int, ...] = ()
        case Parity.EVEN:
            parity = (sum(data) & 1,)
        case Parity.ODD:
            parity = (~sum(data) & 1,)
    return (0, *data, *parity, *(1,) * settings.stopbits)


class Receiver:
    """UART receiver that reads the levels of a line with its own settings.

    A falling edge begins a character; each bit is sampled once, near its middle. A start bit that is high when
    sampled is ignored. After a framing error, the low stop bit counts as the next start bit. After a break, the
    receiver waits for the line to go high (PC16550D, line status register bits 3 and 4).
    """

    __slots__ = ("_awaiting_mark", "_begun", "_bit", "_edges", "_held", "_sampled", "_sent", "settings")

    def __init__(self, settings: LineSettings) -> None:
        self.settings = settings
        self._edges: list[tuple[float, bool, int]] = []
        """Heap of future edges: time, whether the edge begins or ends a break, new level."""
        self._sent, self._held = 1, 1
        """Levels of the sender and of the break. The line is high if both levels are high."""
        self._begun: float | None = None
        """Start time of the present character."""
        self._bit = 0
        self._sampled: list[int] = []
        self._awaiting_mark = False

    @property
    def quiet(self) -> bool:
        """Whether the line is idle as far as is known and no character is being read."""
        return self._begun is None and not self._edges and (self._sent & self._held) == 1

    @property
    def deadline(self) -> float | None:
        """Time at which the present character completes, unless a new start bit comes first."""
        return None if self._begun is None else self._sample_time(self._bits - 1)

    @property
    def _line(self) -> int:
        return self._sent & self._held

    @property
    def _bits(self) -> int:
        """Number of sampled bits of a character, up to and including its first stop bit."""
        return self.settings.bits - self.settings.stopbits + 1

    def character(self, byte: int, begun: float, sender: LineSettings) -> None:
        """Add a character to the line. `begun` is the time of its start bit, s."""
        before = 1
        for k, level in enumerate(levels(byte, sender)):
            if level != before:
                heapq.heappush(self._edges, (begun + k / sender.baudrate, False, level))
                before = level

    def hold(self, low: bool, at: float) -> None:
        """Begin or end a break at this time, s. During a break the line is low, regardless of the sender."""
        heapq.heappush(self._edges, (at, True, not low))

    def retune(self, settings: LineSettings) -> None:
        """Read with these settings from now on. If they differ from the present settings, the present character is
        discarded.
        """
        if settings != self.settings:
            self._begun = None
        self.settings = settings

    def listen(self, until: float) -> list[Character]:
        """Return the characters that are complete by `until`, s. All edges up to that time must have been added."""
        read: list[Character] = []
        while True:
            if self._begun is None:
                if not self._find_start(until):
                    return read
                continue
            at = self._sample_time(self._bit)
            if at > until:
                return read
            while self._edges and self._edges[0][0] <= at:
                self._pass_edge()
            self._sample(self._line, read)

    def _sample_time(self, bit: int) -> float:
        assert self._begun is not None
        return self._begun + (bit + SAMPLE_AT) / self.settings.baudrate

    def _pass_edge(self) -> float:
        at, of_break, level = heapq.heappop(self._edges)
        if of_break:
            self._held = level
        else:
            self._sent = level
        return at

    def _find_start(self, until: float) -> bool:
        """Advance to the next falling edge. Return False if there is none by then."""
        while self._edges and self._edges[0][0] <= until:
            before = self._line
            at = self._pass_edge()
            if self._line:
                self._awaiting_mark = False
            elif before and not self._awaiting_mark:
                self._begun, self._bit = at, 0
                self._sampled.clear()
                return True
        return False

    def _sample(self, level: int, read: list[Character]) -> None:
        if self._bit == 0 and level:
            self._begun = None  # too short for a start bit
            return
        self._sampled.append(level)
        self._bit += 1
        if self._bit < self._bits:
            return
        _, *data, stop = self._sampled
        checked = data[DATA_BITS:]
        byte = sum(bit << k for k, bit in enumerate(data[:DATA_BITS]))
        if not any(self._sampled):
            read.append(Character(0, Flaw.BREAK))
            self._begun, self._awaiting_mark = None, True
        elif not stop:
            read.append(Character(byte, Flaw.FRAMING))
            assert self._begun is not None
            self._begun += (self._bits - 1) / self.settings.baudrate
            self._sampled, self._bit = [0], 1
        else:
            wrong = checked and (sum(data) & 1) != (self.settings.parity is Parity.ODD)
            read.append(Character(byte, Flaw.PARITY if wrong else None))
            self._begun = None
