"""Measured distributions as evenly spaced quantiles, and random numbers drawn from them."""

import random
from collections.abc import Sequence
from typing import Any

from protocol.marks import SettingError


def draw(quantiles: Sequence[float], source: random.Random) -> float:
    """Draw a value from the distribution with these quantiles, interpolated linearly. Uses one random number."""
    index = source.random() * (len(quantiles) - 1)
    k = min(int(index), len(quantiles) - 2)
    return quantiles[k] + (quantiles[k + 1] - quantiles[k]) * (index - k)


def check_quantiles(profile: Any, *names: str) -> None:
    """Raise ValueError that names the first of these settings that is not a valid distribution.

    Call it from `__post_init__`.
    """
    for name in names:
        values = getattr(profile, name)
        if len(values) == 1:
            raise SettingError(name, "must be two values or more, or none, got 1")
        if list(values) != sorted(values):
            raise SettingError(name, f"must be in ascending order, got {list(values)}")
