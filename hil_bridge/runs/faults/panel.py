"""Manual faults for a program that observes an emulated cell during a run."""

from collections.abc import Sequence
from typing import Any

from emulators.cell import Cell
from emulators.faults import Injection
from hil_bridge.clock import Clock
from hil_bridge.errors import ConfigError


class FaultPanel:
    """Panel that injects and ends faults in an emulated cell."""

    def __init__(self, cell: Cell[Any, Any] | None, clock: Clock) -> None:
        """Create the panel. If both devices are real, `cell` is None and no fault can be injected."""
        self._cell = cell
        self._clock = clock

    def inject(self, on: str, fault: str, *, for_s: float | None = None, **parameters: object) -> Injection:
        """Inject a fault now, or at its next opportunity, with its parameters. `for_s` is its duration, s.

        `hil-bridge list faults` shows targets (`on`), faults and parameters. The returned object counts how often
        the fault had an effect. Raises ConfigError for a fault that this cell does not support, or for an invalid
        parameter.
        """
        values = parameters if for_s is None else {**parameters, "for_s": for_s}
        try:
            return self._emulated.inject(on, fault, self._clock.now(), **values)
        except ValueError as error:
            raise ConfigError(str(error)) from error

    def mend(self) -> None:
        """End all active faults, and cancel all pending faults."""
        ledger, now = self._emulated.ledger, self._clock.now()
        ledger.disarm(now)
        ledger.mend(now)

    @property
    def faults(self) -> Sequence[Injection]:
        """All faults injected so far, including those of the configuration."""
        return self._emulated.faults

    @property
    def _emulated(self) -> Cell[Any, Any]:
        if self._cell is None:
            raise ConfigError("faults need an emulated cell, but both devices are real")
        return self._cell
