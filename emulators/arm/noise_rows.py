"""White noise for devices that act cycle by cycle: a row of numbers for each, drawn in blocks by the seed."""

import random

import numpy as np

from emulators.sensing.samples import NumberedNoise
from protocol.geometry import Wrench

_ROWS = 1024
"""Chosen: rows that are made at a time."""


class NoiseRows:
    """Six normal numbers for each cycle, of standard deviation 1. A row belongs to its number."""

    def __init__(self, seed: int, name: str) -> None:
        """`name` keeps the noise of one thing apart from another's."""
        self._noise = NumberedNoise(1.0, random.Random(f"{seed} {name}").getrandbits(63))
        self._block = -1
        self._rows: list[Wrench] = []

    def row(self, number: int) -> Wrench:
        """Return the row of a number, 0 or more."""
        block, place = divmod(number, _ROWS)
        if block != self._block:
            samples = np.zeros((6, _ROWS))
            self._noise.add(samples, block * _ROWS)
            self._block, self._rows = block, [(a, b, c, d, e, f) for a, b, c, d, e, f in samples.T.tolist()]
        return self._rows[place]
