"""Seeds of the episodes of an environment, in the order in which they begin."""

import numpy as np

_SEEDS = 2**31


class Beginnings:
    """Limited number of seeds, used again in random order."""

    def __init__(self, count: int) -> None:
        """Create the sequence. `count` is the number of different seeds; 0 if each episode has a new one."""
        self._count = count
        self.clear()

    def clear(self) -> None:
        """Draw new seeds from now on."""
        self._seeds: list[int] = []
        self._order: list[int] = []

    def draw(self, random: np.random.Generator) -> int:
        """Return the seed of the next episode: a new one until there are enough, then each of them once per pass."""
        if self._count == 0 or len(self._seeds) < self._count:
            return int(random.integers(_SEEDS))
        if not self._order:
            self._order = random.permutation(self._seeds).tolist()
        return self._order.pop()

    def keep(self, seed: int) -> None:
        """Use a seed again, because its episode has reached a contact."""
        if len(self._seeds) < self._count and seed not in self._seeds:
            self._seeds.append(seed)
