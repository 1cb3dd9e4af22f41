"""White noise for devices that act cycle by cycle: one row of numbers for each cycle, drawn in blocks from the seed."""

import random

import numpy as np

from emulators.sensing.samples import NumberedNoise
from protocol.geometry import Wrench

_ROWS = 1024
"""Number of rows that are drawn at a time. Chosen."""


class NoiseRows:
    """Six standard normal numbers for each cycle. A cycle number always gives the same row."""

    def __init__(self, seed: int, name: str) -> None:
        """`name` separates this noise from other noise with the same seed."""
        self._noise = NumberedNoise(1.0, random.Random(f"{seed} {name}").getrandbits(63))
        self._block = -1
        self._rows: list[Wrench] = []

    def row(self, number: int) -> Wrench:
        """Return the row with this number, which must be at least 0."""
        block, index = divmod(number, _ROWS)
        if block != self._block:
            samples = np.zeros((6, _ROWS))
            self._noise.add(samples, block * _ROWS)
            self._block, self._rows = block, [(a, b, c, d, e, f) for a, b, c, d, e, f in samples.T.tolist()]
        return self._rows[index]
