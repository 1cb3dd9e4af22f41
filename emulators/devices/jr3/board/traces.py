"""Words computed for a block of samples, and their addresses in the memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from protocol.devices.jr3 import AXES
from protocol.devices.jr3.board import FILTERS, REGISTERS, VECTORS

Words = NDArray[np.int16]
NEVER = 1 << 62
"""Sample number that no sample reaches."""


@dataclass(frozen=True, slots=True)
class Trace:
    """Words that are calculated every `step` samples from sample `first` on."""

    first: int
    step: int
    values: Words
    """Values, one row per word and one column per calculation. Column 0 holds the values before the first
    calculation.
    """

    def index(self, sample: int) -> int:
        """Return the index of the column that is in the memory after a sample."""
        return 0 if sample < self.first else (sample - self.first) // self.step + 1

    def words(self, sample: int) -> list[int]:
        """Return the words that are in the memory after a sample, as unsigned numbers."""
        words: list[int] = self.values[:, self.index(sample)].view(np.uint16).tolist()
        return words

    def at(self, word: int, samples: NDArray[np.int64]) -> Words:
        """Return one word after each of the given samples."""
        values: Words = self.values[word, self.columns(samples)]
        return values

    def columns(self, samples: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return `index` for each of the given samples."""
        return np.maximum((samples - self.first) // self.step + 1, 0)


@dataclass(frozen=True, slots=True)
class Place:
    """Location of a trace in the array of its block. Samples are counted from the first one of the block."""

    first: int
    step: int
    begin: int
    """Index of the first word's value before the block. The values of the calculations follow."""
    pitch: int
    """Distance from one word to the next."""
    columns: int
    """Number of calculations + 1."""

    def moved(self, by: int, pitch: int) -> "Place":
        """Return a copy of this location, shifted."""
        return Place(self.first, self.step, by + self.begin, pitch, self.columns)


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Locations of all traces in the array of a block. Similar blocks share one object."""

    at: Mapping[str, Place]
    before: NDArray[np.int64]
    """Index of the value before the block, for each word."""
    first: NDArray[np.int64]
    """Sample of the first calculation, for each word."""
    step: NDArray[np.int64]
    """Samples between two calculations, for each word."""

    @classmethod
    def of(cls, at: Mapping[str, Place]) -> "Places":
        """Return the locations of the traces, with the facts derived from them."""
        words = [(at[name], word) for name, words in TRACE_WORDS.items() for word in range(words)]
        return cls(
            at,
            np.array([place.begin + word * place.pitch for place, word in words]),
            np.array([place.first for place, _ in words]),
            np.array([place.step for place, _ in words]),
        )

    def newest(self, offset: int) -> NDArray[np.int64]:
        """Return the index of the newest value of each word. `offset` is the distance of the sample from the
        block's first one.
        """
        calculations: NDArray[np.int64] = np.maximum((offset - self.first) // self.step + 1, 0)
        return self.before + calculations


class Traces:
    """Words of a block from sample `start` on, by name. The words named in `missing` are not computed yet."""

    __slots__ = ("_missing", "_places", "_start", "words")

    def __init__(self, words: Words, start: int, places: Places, missing: tuple[str, ...] = ()) -> None:
        self.words = words
        self._start = start
        self._places = places
        self._missing = missing

    def __contains__(self, name: str) -> bool:
        return name in self._places.at and name not in self._missing

    def __getitem__(self, name: str) -> Trace:
        place = self._places.at[name]
        shape, strides = (TRACE_WORDS[name], place.columns), (2 * place.pitch, 2)
        values: Words = np.ndarray(shape, np.int16, self.words, 2 * place.begin, strides)
        return Trace(self._start + place.first, place.step, values)

    def newest(self, sample: int) -> Words:
        """Return all words after a sample, laid out by `NEWEST`."""
        newest: Words = self.words[self._places.newest(sample - self._start)]
        return newest

    def lookup(self, address: int, count: int, offset: int, samples: int, step: int) -> "Lookup":
        """Return the indices in `words` of `count` words from an address on, after each of several samples.

        `offset` is the distance of the first sample from the block's first one; `step` is the distance between
        samples.
        """
        return _lookup(self._places, address, count, (offset, samples, step))

    def without(self, *names: str) -> "Traces":
        """Return these words before the named traces were computed."""
        return Traces(self.words, self._start, self._places, names)


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
"""Trace and word index, by address."""
_END = max(COLUMNS) + 1
TRACE_WORDS = {name: 1 + max(i for n, i in COLUMNS.values() if n == name) for name, _ in COLUMNS.values()}
"""Number of words of each trace."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Consecutive addresses that hold consecutive words of one trace."""

    trace: str
    begin: int
    end: int
    offset: int
    """Offset of the piece from the first requested address."""


@lru_cache(maxsize=512)
def pieces(address: int, count: int) -> tuple[Piece, ...]:
    """Return the pieces with computed words among `count` words from an address."""
    result: list[Piece] = []
    for offset in range(min(count, _END - address)):
        name, word = COLUMNS.get(address + offset, ("", 0))
        last = result[-1] if result else None
        if last and last.trace == name and last.end == word and last.offset + word - last.begin == offset:
            result[-1] = Piece(name, last.begin, word + 1, last.offset)
        elif name:
            result.append(Piece(name, word, word + 1, offset))
    return tuple(result)


NEWEST = {
    name: slice(end - TRACE_WORDS[name], end)
    for name, end in zip(TRACE_WORDS, accumulate(TRACE_WORDS.values()), strict=True)
}
"""Position of each trace in the array of the newest words of all traces."""


@dataclass(frozen=True, slots=True)
class Lookup:
    """Locations of the computed words among consecutive addresses after given samples."""

    indices: NDArray[np.int64]
    """Indices of the computed words (samples, computed words)."""
    runs: tuple[tuple[int, int, int, int], ...]
    """Runs of consecutive words: start and end among the addresses, start and end among the computed words."""


@lru_cache(maxsize=64)
def _lookup(places: Places, address: int, count: int, grid: tuple[int, int, int]) -> Lookup:
    """Return the locations of the computed words.

    `grid` is the offset of the first sample, the number of samples, and the step between samples.
    """
    offset, samples, step = grid
    after = offset + step * np.arange(samples)
    columns: list[NDArray[np.int64]] = []
    runs: list[tuple[int, int, int, int]] = []
    for piece in pieces(address, count):
        place = places.at[piece.trace]
        calculations = np.maximum((after - place.first) // place.step + 1, 0) + place.begin
        begin, here = piece.offset, len(columns)
        columns += [calculations + word * place.pitch for word in range(piece.begin, piece.end)]
        if runs and runs[-1][1] == begin:
            begin, _, here, _ = runs.pop()
        runs.append((begin, piece.offset + piece.end - piece.begin, here, len(columns)))
    return Lookup(np.array(columns, np.int64).reshape(-1, samples).T.copy(), tuple(runs))
