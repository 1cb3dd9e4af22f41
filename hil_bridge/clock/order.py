"""Order of callbacks that are due together in virtual time: first in, first out, or drawn from a seed.

Two sockets that are readable in one iteration of a real loop come in any order, and a real timer is late. A run whose
decisions depend on that differs from day to day.
"""

import asyncio
import random
from collections.abc import Callable, Container
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

from protocol.marks import Mark, at_least, between, check_settings, setting

MAXIMUM_LATENESS_US = 1000.0
"""Largest lateness of an iteration, µs. Chosen: below the shortest period of a robot, 2 ms."""


@dataclass(frozen=True)
class VirtualOrder:
    """Order of callbacks in virtual time, from the first control cycle of a run on. It has no effect in real time."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    shuffled: Literal["none", "timers", "all"] = setting(
        "none",
        Mark.CHOSEN,
        "callbacks in an order drawn by the seed: none; timers that are due together; or all that are ready",
    )
    seed: int = setting(1, Mark.CHOSEN, "seed of the order, and of the lateness", at_least(0))
    late_us: float = setting(
        0.0,
        Mark.CHOSEN,
        "largest time by which an iteration of the loop is late, drawn by the seed, µs",
        between(0.0, MAXIMUM_LATENESS_US),
    )

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def is_usual(self) -> bool:
        """Whether callbacks run at their times, first in, first out."""
        return self.shuffled == "none" and not self.late_us

    def draws(self) -> "OrderDraws | None":
        """Return the draws of a new loop; None for the usual order."""
        return None if self.is_usual else OrderDraws(self)


class Deviation(NamedTuple):
    """Callbacks that are due together and run in another order than first in, first out."""

    number: int
    """Number of the iteration among all in which several callbacks were due together, from 0."""
    at: float
    """Time on the clock, s."""
    usual: tuple[str, ...]
    """Callbacks in the usual order."""
    drawn: tuple[str, ...]
    """Callbacks in the order in which they ran."""

    def __str__(self) -> str:
        return f"{' before '.join(self.drawn)} at {self.at:.6f} s"


class OrderDraws:
    """Draws of one loop from the seed of a `VirtualOrder`.

    Each iteration is drawn by itself, so that an order stays the same if another iteration keeps the usual order.
    """

    def __init__(
        self,
        order: VirtualOrder,
        only: Container[int] | None = None,
        observe: Callable[[Deviation], object] | None = None,
        active: bool = True,
    ) -> None:
        """Draw orders for the iterations whose numbers are in `only`; None stands for all. `observe` receives each
        order that was drawn.
        """
        self.active = active
        """Whether the usual order ends: from the beginning of the loop, or from the first control cycle on."""
        self.shuffles_all = order.shuffled == "all"
        self._order, self._only, self._observe = order, only, observe
        self._count = 0
        self._lateness = random.Random(order.seed) if order.late_us else None

    def late(self, when: float) -> float:
        """Return the time at which the loop wakes for a timer at `when`, s."""
        if self._lateness is None or not self.active:
            return when
        return when + self._lateness.random() * self._order.late_us * 1e-6

    def arranged(self, callbacks: list[Any], now: float, name: Callable[[Any], str]) -> list[Any]:
        """Return callbacks that are due together in the order in which they run. `name` describes a callback."""
        if len(callbacks) < 2 or self._order.shuffled == "none" or not self.active:
            return callbacks
        number = self._count
        self._count += 1
        if self._only is not None and number not in self._only:
            return callbacks
        drawn = callbacks[:]
        random.Random(f"{self._order.seed}:{number}").shuffle(drawn)
        if self._observe is not None and drawn != callbacks:
            usual, changed = tuple(map(name, callbacks)), tuple(map(name, drawn))
            self._observe(Deviation(number, now, usual, changed))
        return drawn


def callback_name(handle: Any) -> str:
    """Return the name of a callback of a loop: of its task, or of its function."""
    callback = handle._callback
    owner = getattr(callback, "__self__", None)
    if isinstance(owner, asyncio.Task):
        return f"task {owner.get_name()}"
    while hasattr(callback, "func"):  # functools.partial
        callback = callback.func
    return str(getattr(callback, "__qualname__", callback))
