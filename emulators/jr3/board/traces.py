"""Computed words over a block of samples, and where in the memory they stand."""

from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise

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
        values: Words = self.values[word, np.maximum((samples - self.first) // self.step + 1, 0)]
        return values


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


class Window:
    """The computed words among `count` from an address over one block, all found by one look-up: for a host that
    reads the same words again and again.
    """

    def __init__(self, traces: Traces, address: int, count: int) -> None:
        chosen = pieces(address, count)
        used = {piece.trace: traces[piece.trace] for piece in chosen}
        sizes = [trace.values.size for trace in used.values()]
        begins = dict(zip(used, np.cumsum([0, *sizes]).tolist(), strict=False))
        self._flat = np.concatenate([trace.values.ravel() for trace in used.values()]).view(np.uint16)
        rows = [(used[p.trace], begins[p.trace], word) for p in chosen for word in range(p.begin, p.end)]
        self._first = np.array([trace.first for trace, _, _ in rows])
        self._step = np.array([trace.step for trace, _, _ in rows])
        # Column 1 of each word: what stands there after the first calculation.
        self._base = np.array([begin + word * trace.values.shape[1] + 1 for trace, begin, word in rows])
        places = [p.offset + k for p in chosen for k in range(p.end - p.begin)]
        cuts = [k for k, (a, b) in enumerate(pairwise(places), 1) if b != a + 1]
        self._runs = [
            (places[begin], places[end - 1] + 1, begin, end)
            for begin, end in pairwise([0, *cuts, len(places)])
        ]

    def fill(self, words: list[int], sample: int) -> None:
        """Put what stands there after a sample into the words from the address on."""
        steps = (sample - self._first) // self._step
        found = self._flat[np.maximum(steps, -1) + self._base].tolist()
        for begin, end, here, there in self._runs:
            words[begin:end] = found[here:there]
