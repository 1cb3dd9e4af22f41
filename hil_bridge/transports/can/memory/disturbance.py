"""Disturbances of frames on an emulated CAN bus."""

import math
import random
from collections.abc import Callable
from typing import TypeAlias

from protocol.can.frame import CanFrame

Disturbance: TypeAlias = Callable[[CanFrame, int], int | None]
"""Function that disturbs frames. It is called at the start of every frame with the frame and the number of its bits
up to the end of the end of frame. It is called once more if another node joins the arbitration at the same time. It
returns the number of the bit that all nodes read wrong, counted from 1, or None if the frame is undisturbed.
"""


class BitErrors:
    """Random bit errors with the same probability for each bit. They are reproducible with the seed."""

    __slots__ = ("_draw", "_rate")

    def __init__(self, rate: float, seed: int = 0) -> None:
        if not 0.0 < rate < 1.0:
            raise ValueError(f"a bit error rate must be between 0 and 1, got {rate:g}")
        self._rate = rate
        self._draw = random.Random(seed)

    def __call__(self, frame: CanFrame, bits: int) -> int | None:
        """Return the number of the first bit error, or None if it is not in the frame."""
        # one random number per frame: the number of good bits before the first error is geometrically distributed
        first = 1 + int(math.log(1.0 - self._draw.random()) / math.log1p(-self._rate))
        return first if first <= bits else None
