"""The board's memory as a host sees it: stored words and computed words."""

from collections.abc import Sequence
from enum import Enum, auto
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emulators.devices.jr3.board.data_path import Block, Samples
from emulators.devices.jr3.board.traces import pieces
from emulators.devices.jr3.sensor import SENSOR_RATE_HZ
from protocol.devices.jr3.board import (
    CHANNELS,
    CLOCK_HZ,
    MEMORY_WORDS,
    RAM_WORDS,
    REGISTERS,
    WORD_MODULUS,
    from_signed,
    register_at,
)

_ERRORS = REGISTERS["errors"].address
_RATE_COUNT = REGISTERS["rate_count"].address
_COUNT_X = REGISTERS["count_x"].address
_RAW_WORDS = 4
"""Number of words from one raw channel to the next."""


class Use(Enum):
    """How the board treats a word written by the host."""

    IGNORE = auto()
    """The board writes this word itself. Assumed: it overwrites the host's value at once."""
    STORE = auto()
    """The board reads the word when a command requires it, or never."""
    ADOPT = auto()
    """The board reads the word periodically, after a number of samples."""
    COMMAND = auto()
    RATE_COUNT = auto()
    ERRORS = auto()
    THRESHOLD_BITS = auto()


_LIVE = (*(_RAW_WORDS * k for k in range(CHANNELS)), _RATE_COUNT, _COUNT_X)


@lru_cache(maxsize=512)
def _live(address: int, count: int) -> tuple[int, ...]:
    return tuple(at for at in _LIVE if address <= at < address + count)


_USES = {
    "command_word0": Use.COMMAND,
    "rate_count": Use.RATE_COUNT,
    "errors": Use.ERRORS,
    "threshold_bits": Use.THRESHOLD_BITS,
    "command_word1": Use.STORE,
    "command_word2": Use.STORE,
    "full_scale": Use.STORE,
}


def use_of(address: int) -> Use:
    """Return how the board treats a word written to an address by the host."""
    if address >= RAM_WORDS:
        return Use.IGNORE
    found = register_at(address)
    if found is None:
        return Use.STORE
    register, _ = found
    if not register.settable:
        return Use.IGNORE
    if register.name.startswith("transform"):
        return Use.STORE
    return _USES.get(register.name, Use.ADOPT)


class Memory:
    """Memory of 16 k words. `channels` has one bit for each received raw channel."""

    def __init__(self, channels: int, idle_hz: float) -> None:
        self.words = [0] * MEMORY_WORDS
        """Stored words. Only `store` and `put` write them."""
        self.changes = 0
        """Number of writes."""
        self._status = 0
        self._channels = channels
        self._idle_per_sample = idle_hz / SENSOR_RATE_HZ

    def read(self, address: int, count: int, block: Block, sample: int) -> list[int]:
        """Return words after a sample of a block."""
        words = self.words[address : address + count]
        for piece in pieces(address, count):
            values = block.traces[piece.trace].words(sample)
            end = piece.offset + piece.end - piece.begin
            words[piece.offset : end] = values[piece.begin : piece.end]
        for at in _live(address, count):
            words[at - address] = int(self._live_word(at, block, sample))
        if address <= _ERRORS < address + count:
            words[_ERRORS - address] |= self._status
        return words

    def pack(self, address: int, count: int, block: Block, samples: range) -> bytes:
        """Return the result of `read` after each of the given samples, as big-endian bytes."""
        rows = np.empty((len(samples), count), ">u2")
        rows[:] = self.words[address : address + count]
        offset = samples.start - block.start
        part = block.traces.lookup(address, count, offset, len(samples), samples.step)
        values = block.traces.words.view(np.uint16).take(part.indices)
        for begin, end, here, there in part.runs:
            rows[:, begin:end] = values[:, here:there]
        for at in _live(address, count):
            rows[:, at - address] = self._live_word(at, block, np.array(samples))
        if address <= _ERRORS < address + count:
            rows[:, _ERRORS - address] |= self._status
        return rows.tobytes()

    @property
    def status(self) -> int:
        """Bits of `errors`, except the saturation bits."""
        return self._status

    @status.setter
    def status(self, bits: int) -> None:
        self._status = bits
        self.changes += 1

    def _live_word(self, at: int, block: Block, sample: Samples) -> float | NDArray[Any]:
        """Return a word that depends only on the sample number, after each of the given samples."""
        if at == _RATE_COUNT:
            return block.rate_count(sample)
        if at == _COUNT_X:
            return (sample + 1) * self._idle_per_sample // 1 % WORD_MODULUS
        if not self._channels >> at // _RAW_WORDS & 1:
            return 0
        # Assumed: all channels of a sample arrive at the same time.
        return (block.sampled(sample) + 1) * CLOCK_HZ // SENSOR_RATE_HZ % WORD_MODULUS

    def get(self, name: str) -> tuple[int, ...]:
        """Return the stored words of a register, as signed numbers."""
        register = REGISTERS[name]
        return register.values(self.words[register.address : register.address + register.count])

    def value(self, name: str) -> int:
        """Return the value of a one-word register."""
        return self.get(name)[0]

    def put(self, name: str, *values: int) -> None:
        """Write words to a register from its start."""
        address = REGISTERS[name].address
        self.words[address : address + len(values)] = map(from_signed, values)
        self.changes += 1

    def store(self, address: int, word: int) -> None:
        """Store one word."""
        self.words[address] = word
        self.changes += 1

    def slots(self, name: str) -> Sequence[int]:
        """Return all words from the start of a slot to the end of its table. An entry may be longer than its slot."""
        table = REGISTERS[name.rstrip("0123456789") + "15"]
        return self.words[REGISTERS[name].address : table.address + table.count]
