"""Bursts of words for a host that reads the same words repeatedly, as a stream does. Many bursts are computed at
once.
"""

from emulators.devices.jr3.board.data_path import Block
from emulators.devices.jr3.board.memory import Memory
from protocol.devices.jr3.board import pack_words

_LEAST = 2
"""Minimum number of further bursts for a joint computation. Chosen: it costs as much as one or two single bursts."""
_MOST = 256
"""Maximum number of bursts computed at once. Chosen: little is lost when the host stops or writes."""


class BurstReader:
    """Reads a board's memory as `Memory.read` does, and packs the words.

    Words that were requested twice with the same number of samples in between will most likely be requested at that
    interval again. Then all bursts of the block for this host are computed together, and each costs no more than
    its bytes.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._last_request = (0, 0)
        """Address and number of the words requested last."""
        self._block: Block | None = None
        self._changes = -1
        """Change count of the memory at the time when the bursts were computed."""
        self._newest = self._distance = 0
        self._first, self._step = 0, 1
        self._bursts = b""
        """Bytes of the bursts for the samples `_first`, `_first` + `_step`, …"""

    def read(self, address: int, count: int, block: Block, sample: int) -> bytes:
        """Return the words after a sample of a block, as big-endian bytes. Sample numbers within a block do not
        decrease.
        """
        distance, self._newest = sample - self._newest, sample
        regular, self._distance = distance == self._distance, distance
        if self._last_request != (address, count):
            self._last_request, self._block, regular = (address, count), None, False
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
