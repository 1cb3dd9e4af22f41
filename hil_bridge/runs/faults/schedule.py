"""Schedule of a run's faults, which follows phases and cycles and injects into the emulated cell at the exact times."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

from emulators.cell import Cell
from emulators.faults import FaultNews, Handler, Injection
from hil_bridge.clock import Clock, Timer
from hil_bridge.control.course.intent import CONNECT
from hil_bridge.errors import ConfigError
from hil_bridge.record import CycleRecord, EventKind, EventRecord
from hil_bridge.record.records import FaultNote
from hil_bridge.settings.faults import Condition, FaultConfig
from protocol.faults import FaultStage


class _Planned(NamedTuple):
    """Fault that has not been injected yet."""

    fault: FaultConfig
    condition: Condition | None
    """Condition that triggers the fault at the end of a cycle; None for a fault that only a phase triggers."""


class FaultSchedule:
    """Schedule of the faults in a configuration. A fault that cannot be injected in this cell is rejected at once.

    `tell` is called with the record of each event. `on_pause` suspends the process of the bridge for a number of
    seconds; without it, a fault of the computer is rejected. Raises ConfigError.
    """

    def __init__(
        self,
        faults: Sequence[FaultConfig],
        cell: Cell[Any, Any],
        clock: Clock,
        tell: Callable[[EventRecord], object],
        on_pause: Callable[[float], object] | None = None,
    ) -> None:
        self._cell = cell
        self._clock = clock
        self._put_event = tell
        self._waiting = [_Planned(fault, fault.condition) for fault in faults]
        self._timers: list[Timer] = []
        self._phase = ""
        self._reported = 0
        """Injections whose end has already been reported."""
        cell.ledger.on_fault = self._report
        if on_pause is not None:
            cell.ledger.attach("computer", {"pause": Handler(partial(_pause, on_pause))})
        for number, fault in enumerate(faults):
            if fault.on == "computer" and on_pause is None:
                raise ConfigError(f"faults.{number}: this run cannot pause its own process")
            if fault.on == "bus" and not clock.is_virtual:
                raise ConfigError(
                    f"faults.{number}: in real time the emulated gateway has no CAN bus; use --virtual"
                )

    def event(self, record: EventRecord) -> None:
        """Handle an event of the run, which may be the start of a phase."""
        if record.kind != EventKind.PHASE:
            return
        self._phase = record.text
        self._arm(
            [
                planned
                for planned in self._waiting
                if planned.condition is None and (planned.fault.phase or CONNECT) == record.text
            ]
        )

    def cycle(self, record: CycleRecord) -> None:
        """Handle the end of a cycle."""
        if not self._waiting:
            return
        self._arm(
            [
                planned
                for planned in self._waiting
                if planned.condition is not None
                and planned.fault.phase in ("", record.phase)
                and planned.condition.holds(record)
            ]
        )

    def close(self) -> None:
        """End the injection of faults. Idempotent.

        The end reports how often each fault had an effect, and which faults were never injected.
        """
        for timer in self._timers:
            timer.cancel()
        for fault, _ in self._waiting:
            text = f"{fault.on}: {fault.fault} never occurred: its phase or condition did not"
            self._report(FaultNews(FaultStage.NEVER, fault.on, fault.fault, text))
        self._waiting.clear()
        faults, self._reported = self._cell.faults[self._reported :], len(self._cell.faults)
        for injection in faults:
            lasting = "" if injection.ended_at is not None else " and lasts to the end of the run"
            times = f"{injection.struck} time{'s' * (injection.struck != 1)}"
            text = f"{injection.name} struck {times}{lasting}"
            self._report(
                FaultNews(FaultStage.STRUCK, injection.target, injection.fault, text), injection.struck
            )

    def _arm(self, due: Sequence[_Planned]) -> None:
        for planned in due:
            self._waiting.remove(planned)
            fault = planned.fault
            if fault.after_s:
                at = self._clock.now() + fault.after_s
                self._timers.append(self._clock.call_at(at, partial(self._inject, fault)))
            else:
                self._inject(fault)

    def _inject(self, fault: FaultConfig) -> None:
        try:
            self._cell.inject(fault.on, fault.fault, self._clock.now(), **fault.given)
        except ValueError as error:  # it was possible when the run began
            self._report(FaultNews(FaultStage.REFUSED, fault.on, fault.fault, f"not injected: {error}"))

    def _report(self, news: FaultNews, struck: int | None = None) -> None:
        """Report a change of a fault's state."""
        numbers = {key: float(value) for key, value in news.values.items() if not isinstance(value, str)}
        texts = {key: value for key, value in news.values.items() if isinstance(value, str)}
        note = FaultNote(
            target=news.target, name=news.fault, stage=news.stage, values=numbers, words=texts, struck=struck
        )
        self._put_event(EventRecord(self._clock.now(), EventKind.FAULT, news.text, fault=note))


def _pause(on_pause: Callable[[float], object], injection: Injection) -> None:
    on_pause(injection.number("seconds"))
    injection.struck += 1
    injection.finish(injection.injected_at)
