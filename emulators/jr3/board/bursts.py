"""Bursts of words for a host that reads the same ones again and again, as a stream does: worked out many at once."""

from emulators.jr3.board.data_path import Block
from emulators.jr3.board.memory import Memory
from emulators.jr3.board.traces import Window

_MOST = 256
"""Bursts worked out at once. Chosen: little is lost when the host stops, or writes."""


class BurstReader:
    """Reads a board's memory as `Memory.read` does, and packs it.

    Words that were asked for twice at the same distance of samples will most likely be asked for so again: then all
    bursts that the block has for this host are worked out, and each costs no more than its bytes.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._window: Window | None = None
        self._block: Block | None = None
        self._changes = -1
        """Of the memory, when the bursts were worked out."""
        self._newest = self._distance = 0
        self._first, self._step = 0, 1
        self._bursts = b""
        """Of the samples `_first`, `_first` + `_step`, …"""

    def read(self, address: int, count: int, block: Block, sample: int) -> bytes:
        """Words after a sample of a block, big-endian; samples of one block do not fall."""
        distance, self._newest = sample - self._newest, sample
        window = self._window
        again = window is not None and window.address == address and window.count == count
        regular = again and distance == self._distance
        self._distance = distance
        if window is None or not again or block is not self._block:
            window = self._window = Window(block.traces, address, count)
            self._block = block
        elif self._memory.changes == self._changes:
            behind, rest = divmod(sample - self._first, self._step)
            if not rest and (burst := self._bursts[2 * count * behind : 2 * count * (behind + 1)]):
                return burst
        step = distance if regular and distance > 0 else block.end - sample
        end = min(block.end, sample + _MOST * step)
        self._first, self._step, self._changes = sample, step, self._memory.changes
        self._bursts = self._memory.pack(window, block, range(sample, end, step))
        return self._bursts[: 2 * count]
