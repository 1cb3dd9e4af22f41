"""Faults by hand, for a program that watches an emulated cell while it runs."""

from collections.abc import Sequence
from typing import Any

from emulators.cell import Cell
from emulators.faults import Injection
from hil_bridge.clock import Clock
from hil_bridge.errors import ConfigError


class FaultPanel:
    """Lets faults happen in an emulated cell, and ends them."""

    def __init__(self, cell: Cell[Any, Any] | None, clock: Clock) -> None:
        """`cell` is None where both devices are real; nothing can be injected then."""
        self._cell = cell
        self._clock = clock

    def inject(self, on: str, fault: str, *, for_s: float | None = None, **parameters: object) -> Injection:
        """Let a fault happen now, or at its next opportunity, with its parameters; `for_s` is its duration, s.

        `hil-bridge list faults` has targets (`on`), faults and parameters. The returned object counts how often it
        struck.
        Raises ConfigError for a fault that this cell cannot have, and for a wrong parameter.
        """
        given = parameters if for_s is None else {**parameters, "for_s": for_s}
        try:
            return self._emulated.inject(on, fault, self._clock.now(), **given)
        except ValueError as error:
            raise ConfigError(str(error)) from error

    def mend(self) -> None:
        """End the faults that last, and forget those that wait for their moment."""
        ledger, now = self._emulated.ledger, self._clock.now()
        ledger.disarm(now)
        ledger.mend(now)

    @property
    def faults(self) -> Sequence[Injection]:
        """All that were injected so far, those of the configuration included."""
        return self._emulated.faults

    @property
    def _emulated(self) -> Cell[Any, Any]:
        if self._cell is None:
            raise ConfigError("faults need an emulated cell, but both devices are real")
        return self._cell
