"""Bursts of words for a host that reads the same ones again and again, as a stream does: worked out many at once."""

from emulators.devices.jr3.board.data_path import Block
from emulators.devices.jr3.board.memory import Memory
from protocol.devices.jr3.board import pack_words

_LEAST = 2
"""Bursts to follow that are worth to be worked out together. Chosen: at the price of one or two alone."""
_MOST = 256
"""Bursts worked out at once. Chosen: little is lost when the host stops, or writes."""


class BurstReader:
    """Reads a board's memory as `Memory.read` does, and packs it.

    Words that were asked for twice at the same distance of samples will most likely be asked for so again. Then all
    bursts that the block has for this host are worked out, and each costs no more than its bytes.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._asked = (0, 0)
        """Address and count."""
        self._block: Block | None = None
        self._changes = -1
        """Count of the memory's changes when the bursts were worked out."""
        self._newest = self._distance = 0
        self._first, self._step = 0, 1
        self._bursts = b""
        """Bytes of the samples `_first`, `_first` + `_step`, …"""

    def read(self, address: int, count: int, block: Block, sample: int) -> bytes:
        """Words after a sample of a block, big-endian; samples of one block do not fall."""
        distance, self._newest = sample - self._newest, sample
        regular, self._distance = distance == self._distance, distance
        if self._asked != (address, count):
            self._asked, self._block, regular = (address, count), None, False
        if block is self._block and self._memory.changes == self._changes:
            behind, rest = divmod(sample - self._first, self._step)
            if not rest and (burst := self._bursts[2 * count * behind : 2 * count * (behind + 1)]):
                return burst
        following = (block.end - 1 - sample) // distance if regular and distance > 0 else 0
        if following < _LEAST:
            self._block = None
            return pack_words(self._memory.read(address, count, block, sample))
        samples = range(sample, block.end, distance)[:_MOST]
        self._block, self._changes = block, self._memory.changes
        self._first, self._step = sample, distance
        self._bursts = self._memory.pack(address, count, block, samples)
        return self._bursts[: 2 * count]
