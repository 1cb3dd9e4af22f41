"""Computed words over a block of samples, and where in the memory they stand."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from protocol.jr3 import AXES
from protocol.jr3.board import FILTERS, REGISTERS, VECTORS
from protocol.values import dataclass

Words = NDArray[np.int16]
NEVER = 1 << 62
"""Sample number that is never reached."""


@dataclass(frozen=True, slots=True)
class Trace:
    """Words that are calculated every `step` samples from sample `first` on."""

    first: int
    step: int
    values: Words
    """(words, calculations + 1); column 0 is what stood there before the first calculation."""

    def index(self, sample: int) -> int:
        """Column that stands in the memory after a sample."""
        return 0 if sample < self.first else (sample - self.first) // self.step + 1

    def words(self, sample: int) -> list[int]:
        """What stands in the memory after a sample, unsigned."""
        words: list[int] = self.values[:, self.index(sample)].view(np.uint16).tolist()
        return words

    def at(self, word: int, samples: NDArray[np.int64]) -> Words:
        """One word after each of these samples."""
        values: Words = self.values[word, self.columns(samples)]
        return values

    def columns(self, samples: NDArray[np.int64]) -> NDArray[np.int64]:
        """What `index` says of each of these samples."""
        return np.maximum((samples - self.first) // self.step + 1, 0)


Traces = Mapping[str, Trace]


def held_trace(words: Words) -> Trace:
    """Words that keep what they are."""
    return Trace(NEVER, 1, words[:, np.newaxis])


def first_tick(start: int, step: int) -> int:
    """The first sample not before `start` whose number is a multiple of `step`."""
    return -(-start // step) * step


def _columns() -> dict[int, tuple[str, int]]:
    at: dict[int, tuple[str, int]] = {}
    for n in range(FILTERS):
        base = REGISTERS[f"filter{n}"].address
        at |= {base + i: (f"axes{n}", i) for i in range(len(AXES))}
        at |= {base + len(AXES) + i: (f"vectors{n}", i) for i in range(len(VECTORS))}
    at |= {REGISTERS[f"raw{1 + i}_data"].address: ("raw", i) for i in range(len(AXES))}
    rate = REGISTERS["rate"]
    at |= {rate.address + i: ("rate", i) for i in range(rate.count)}
    names = ("warnings", "errors", "threshold_bits", *(f"count{n}" for n in range(1, FILTERS)))
    return at | {REGISTERS[name].address: (name, 0) for name in names}


COLUMNS = _columns()
"""Trace and word of it by address."""
_END = max(COLUMNS) + 1
TRACE_WORDS = {name: 1 + max(i for n, i in COLUMNS.values() if n == name) for name, _ in COLUMNS.values()}
"""Words of each trace."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Neighbouring addresses that are neighbouring words of one trace."""

    trace: str
    begin: int
    end: int
    offset: int
    """Where the piece starts within the addresses asked for."""


@lru_cache(maxsize=512)
def pieces(address: int, count: int) -> tuple[Piece, ...]:
    """What of `count` words from an address is computed."""
    found: list[Piece] = []
    for offset in range(min(count, _END - address)):
        name, word = COLUMNS.get(address + offset, ("", 0))
        last = found[-1] if found else None
        if last and last.trace == name and last.end == word and last.offset + word - last.begin == offset:
            found[-1] = Piece(name, last.begin, word + 1, last.offset)
        elif name:
            found.append(Piece(name, word, word + 1, offset))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Layout:
    """The computed words among some neighbouring addresses."""

    names: tuple[str, ...]
    """Their traces."""
    trace: NDArray[np.int64]
    """Of each word, where its trace stands in `names`."""
    word: NDArray[np.int64]
    """Of each word, which of its trace's."""
    places: NDArray[np.int64]
    """Of each word, how far behind the first address it stands."""


@lru_cache(maxsize=64)
def _layout(address: int, count: int) -> _Layout:
    chosen = pieces(address, count)
    names = tuple(dict.fromkeys(piece.trace for piece in chosen))
    rows = [
        (names.index(piece.trace), word, piece.offset + word - piece.begin)
        for piece in chosen
        for word in range(piece.begin, piece.end)
    ]
    trace, word, places = np.array(rows, np.int64).reshape(-1, 3).T.copy()
    return _Layout(names, trace, word, places)


class Window:
    """The computed words among `count` from an address over one block, found by one look-up for many samples."""

    def __init__(self, traces: Traces, address: int, count: int) -> None:
        self.address, self.count = address, count
        layout = self._layout = _layout(address, count)
        self.places = layout.places
        """Which of the `count` words are computed."""
        used = [traces[name] for name in layout.names]
        if not used:
            return
        self._flat = np.concatenate([trace.values.ravel() for trace in used]).view(np.uint16)
        self._first = np.array([trace.first for trace in used])
        self._step = np.array([trace.step for trace in used])
        heights, widths = np.array([trace.values.shape for trace in used]).T
        begins = np.cumsum(heights * widths) - heights * widths
        # Column 1 of each word: what stands there after the first calculation.
        self._base = (begins + 1)[layout.trace] + layout.word * widths[layout.trace]

    def words(self, samples: NDArray[np.int64]) -> NDArray[np.uint16]:
        """What stands at `places` after each of these samples (samples, words)."""
        if not len(self.places):
            return np.empty((len(samples), 0), np.uint16)
        calculations = np.maximum((samples[:, np.newaxis] - self._first) // self._step, -1)
        found: NDArray[np.uint16] = self._flat.take(
            calculations.take(self._layout.trace, axis=1) + self._base
        )
        return found
