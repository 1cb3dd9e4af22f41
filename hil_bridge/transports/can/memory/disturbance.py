"""Disturbances of frames on an emulated CAN bus."""

import math
import random
from collections.abc import Callable
from typing import TypeAlias

from protocol.can.frame import CanFrame

Disturbance: TypeAlias = Callable[[CanFrame, int], int | None]
"""Called with every frame that begins and its bits up to the end of the end of frame. It is called once more if another
node joins the arbitration at the same instant. Returns the bit that all nodes read wrong, from 1, or None if the frame
is undisturbed.
"""


class BitErrors:
    """Random bit errors, all with the same probability; they repeat with the seed."""

    __slots__ = ("_draw", "_rate")

    def __init__(self, rate: float, seed: int = 0) -> None:
        if not 0.0 < rate < 1.0:
            raise ValueError(f"a bit error rate must be between 0 and 1, got {rate:g}")
        self._rate = rate
        self._draw = random.Random(seed)

    def __call__(self, frame: CanFrame, bits: int) -> int | None:
        """Return the first bit error, if it is in the frame."""
        # one draw a frame: the number of good bits before the first bad one is geometrically distributed
        first = 1 + int(math.log(1.0 - self._draw.random()) / math.log1p(-self._rate))
        return first if first <= bits else None
