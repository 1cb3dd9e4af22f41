"""Computed words over a block of samples, and where in the memory they stand."""

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
        """Words in the memory after a sample, unsigned."""
        words: list[int] = self.values[:, self.index(sample)].view(np.uint16).tolist()
        return words

    def at(self, word: int, samples: NDArray[np.int64]) -> Words:
        """One word after each of these samples."""
        values: Words = self.values[word, self.columns(samples)]
        return values

    def columns(self, samples: NDArray[np.int64]) -> NDArray[np.int64]:
        """`index` for each of these samples."""
        return np.maximum((samples - self.first) // self.step + 1, 0)


@dataclass(frozen=True, slots=True)
class Place:
    """Place of a trace in the array of its block. Samples count from the block's first one."""

    first: int
    step: int
    begin: int
    """Place of the first word's value before the block; the calculations follow."""
    pitch: int
    """Distance from one word to the next."""
    columns: int
    """Calculations + 1."""

    def moved(self, by: int, pitch: int) -> "Place":
        """Return the same, moved elsewhere."""
        return Place(self.first, self.step, by + self.begin, pitch, self.columns)


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where all traces lie in the array of a block. Blocks that are alike share one."""

    at: Mapping[str, Place]
    before: NDArray[np.int64]
    """Place of each of the newest words before the block."""
    first: NDArray[np.int64]
    """The sample of its first calculation."""
    step: NDArray[np.int64]
    """Samples from calculation to calculation."""

    @classmethod
    def of(cls, at: Mapping[str, Place]) -> "Places":
        """Return the places of the traces, with the facts that follow from them."""
        words = [(at[name], word) for name, words in TRACE_WORDS.items() for word in range(words)]
        return cls(
            at,
            np.array([place.begin + word * place.pitch for place, word in words]),
            np.array([place.first for place, _ in words]),
            np.array([place.step for place, _ in words]),
        )

    def newest(self, offset: int) -> NDArray[np.int64]:
        """Place of each of the newest words after the sample so many behind the block's first one."""
        calculations: NDArray[np.int64] = np.maximum((offset - self.first) // self.step + 1, 0)
        return self.before + calculations


class Traces:
    """The words of a block from sample `start` on, by name; `missing` are not computed yet."""

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
        """All words after a sample, where `NEWEST` says."""
        newest: Words = self.words[self._places.newest(sample - self._start)]
        return newest

    def lookup(self, address: int, count: int, offset: int, samples: int, step: int) -> "Lookup":
        """Where in `words` those from an address on lie after every so many samples, the first `offset` behind the
        block's first one.
        """
        return _lookup(self._places, address, count, (offset, samples, step))

    def without(self, *names: str) -> "Traces":
        """Return the same as before these were computed."""
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
    """Begin of the piece within the addresses asked for."""


@lru_cache(maxsize=512)
def pieces(address: int, count: int) -> tuple[Piece, ...]:
    """Return the computed pieces among `count` words from an address."""
    found: list[Piece] = []
    for offset in range(min(count, _END - address)):
        name, word = COLUMNS.get(address + offset, ("", 0))
        last = found[-1] if found else None
        if last and last.trace == name and last.end == word and last.offset + word - last.begin == offset:
            found[-1] = Piece(name, last.begin, word + 1, last.offset)
        elif name:
            found.append(Piece(name, word, word + 1, offset))
    return tuple(found)


NEWEST = {
    name: slice(end - TRACE_WORDS[name], end)
    for name, end in zip(TRACE_WORDS, accumulate(TRACE_WORDS.values()), strict=True)
}
"""Place of each trace among the newest words of all."""


@dataclass(frozen=True, slots=True)
class Lookup:
    """Places of the computed words among some neighbouring addresses after some samples."""

    indices: NDArray[np.int64]
    """(samples, computed words)"""
    runs: tuple[tuple[int, int, int, int], ...]
    """Neighbouring words: begin and end among the addresses, begin and end among the computed ones."""


@lru_cache(maxsize=64)
def _lookup(places: Places, address: int, count: int, grid: tuple[int, int, int]) -> Lookup:
    """`grid` is the offset of the first sample, how many there are, and the step between them."""
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
