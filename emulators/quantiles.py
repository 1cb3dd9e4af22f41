"""A measured distribution as evenly spaced quantiles, and numbers drawn from it."""

import random
from collections.abc import Sequence
from typing import Any

from protocol.marks import SettingError


def draw(quantiles: Sequence[float], source: random.Random) -> float:
    """Draw from the distribution with these quantiles, interpolated linearly; uses one random number."""
    place = source.random() * (len(quantiles) - 1)
    k = min(int(place), len(quantiles) - 2)
    return quantiles[k] + (quantiles[k + 1] - quantiles[k]) * (place - k)


def check_quantiles(profile: Any, *names: str) -> None:
    """Raise ValueError naming the first of these settings that holds no distribution; for `__post_init__`."""
    for name in names:
        values = getattr(profile, name)
        if len(values) == 1:
            raise SettingError(name, "must be two values or more, or none, got 1")
        if list(values) != sorted(values):
            raise SettingError(name, f"must not fall, got {list(values)}")
