"""The ledger of a cell's faults: each injection, since when, until when, and how often it had an effect.

A device that can go wrong gives a table of handlers, name by name. It is handed the injection itself, looks at its
times where they matter, and counts on it.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from emulators.faults.kinds import Fault, FaultNews, FaultValue
from protocol.faults import FaultStage

INJECTION_LIMIT = 1000
"""Faults that one cell takes, so that no panel can fill its memory. Mark: chosen."""


def _unheard(news: FaultNews) -> None:
    """Nothing listens."""


def _not_noted(injection: "Injection") -> None:
    """Nothing keeps it."""


@dataclass(slots=True, eq=False)
class Injection:
    """One fault that was injected. Times are those of the cell, s."""

    target: str
    fault: str
    values: Mapping[str, FaultValue]
    """Every parameter, defaults included."""
    injected_at: float
    ends_at: float | None
    """When it will be over, infinity for the end of the run; None for one that strikes a number of times."""
    struck: int = 0
    """Number of its effects: bytes or frames lost, samples altered, orders refused, states changed."""
    ended_at: float | None = None
    """When it was over; None before that."""
    on_end: Callable[["Injection"], object] = field(default=_not_noted, repr=False)

    @property
    def name(self) -> str:
        """Target and fault, as people read it."""
        return f"{self.target}: {self.fault}"

    def holds(self, now: float) -> bool:
        """Whether it is under way at this time, its end excluded."""
        end = self.ended_at if self.ended_at is not None else self.ends_at
        return self.injected_at <= now and (end is None or now < end)

    @property
    def waits(self) -> bool:
        """Whether it waits for so many of its moments, and not for a time alone."""
        return self.ends_at is None or self._count > 0

    @property
    def _count(self) -> float:
        """Number of effects after which it is over; 0 for any number."""
        return float(self.values.get("count", 0))

    def number(self, key: str) -> float:
        """Return a parameter that is a number."""
        return float(self.values[key])

    def strike(self, now: float) -> None:
        """Note an effect at a time, s; the last of its `count` ends the fault."""
        self.struck += 1
        if 0 < self._count <= self.struck:
            self.finish(now)

    def finish(self, now: float) -> None:
        """End the fault. Idempotent."""
        if self.ended_at is None:
            self.ended_at = now
            self.on_end(self)


@dataclass(frozen=True, slots=True)
class Handler:
    """The acts of a device at the begin and at the end of a fault. `begin` raises ValueError for one that cannot be."""

    begin: Callable[[Injection], object]
    end: Callable[[Injection, float], object] | None = None
    """Called with the time; None where the device goes by the times of the injection."""


class Ledger:
    """Injects the faults of a table into the devices that are attached."""

    def __init__(self, table: Mapping[str, Mapping[str, Fault]]) -> None:
        self.table = table
        self._handlers: dict[str, dict[str, Handler]] = {}
        self.injections: list[Injection] = []
        """All of them, in order."""
        self.on_fault: Callable[[FaultNews], object] = _unheard
        """Called at every begin and every end of a fault."""
        self.on_change: list[Callable[[], object]] = []
        """Called after a fault has begun or ended: a device may have something to say."""

    def attach(self, target: str, handlers: Mapping[str, Handler]) -> None:
        """Let a device go wrong in these ways."""
        self._handlers.setdefault(target, {}).update(handlers)

    def check(
        self, target: str, fault: str, given: Mapping[str, object]
    ) -> tuple[dict[str, FaultValue], float | None]:
        """Parameters and duration of a fault. Raises ValueError, in one line, for one that this cell cannot have."""
        found = find(self.table, target, fault).values(fault, given)
        if fault not in self._handlers.get(target, {}):
            raise ValueError(f"this cell cannot have {target}: {fault}; it has nothing that could")
        return found

    def inject(self, target: str, fault: str, now: float, given: Mapping[str, object]) -> Injection:
        """Let a fault happen from now on, or at its next opportunity. Raises ValueError as `check` does."""
        values, duration = self.check(target, fault, given)
        if len(self.injections) >= INJECTION_LIMIT:
            raise ValueError(f"this cell has had {INJECTION_LIMIT} faults; start it again")
        ends_at = None if duration is None else now + duration
        injection = Injection(target, fault, values, now, ends_at)
        self._handlers[target][fault].begin(injection)
        self.injections.append(injection)
        words = ", ".join(f"{key} {_text(value)}" for key, value in values.items())
        stage = FaultStage.HAPPENS if injection.ended_at is not None else FaultStage.BEGINS
        lasting = "" if duration in (None, math.inf) else f" for {duration:g} s"
        text = f"{injection.name}{f' ({words})' if words else ''} {stage}{lasting}"
        self.on_fault(FaultNews(stage, target, fault, text, values))
        injection.on_end = self._ended
        self._changed()
        return injection

    def disarm(self, now: float) -> None:
        """End the faults that wait for their moment; the devices have forgotten them."""
        for injection in self.injections:
            if injection.waits:
                injection.finish(now)

    def waiting(self, now: float) -> dict[str, int]:
        """Names of those that wait for their moment, and how often each will strike; 0 for any number."""
        return {
            injection.name: max(0, int(injection.values.get("count", 0)) - injection.struck)
            for injection in self.injections
            if injection.waits and injection.holds(now)
        }

    def mend(self, now: float) -> None:
        """End the faults that last."""
        self._end([injection for injection in self.injections if not injection.waits], now)

    def active(self, now: float) -> tuple[str, ...]:
        """Names of those under way at a time, in the order in which they began."""
        return tuple(injection.name for injection in self.injections if injection.holds(now))

    def lasting(self, now: float) -> tuple[str, ...]:
        """Names of those under way at a time that last, and do not only wait for their moment."""
        return tuple(
            injection.name for injection in self.injections if not injection.waits and injection.holds(now)
        )

    def next_deadline(self) -> float | None:
        """When the next one ends, s."""
        ends = [
            injection.ends_at
            for injection in self.injections
            if injection.ended_at is None and injection.ends_at is not None and injection.ends_at < math.inf
        ]
        return min(ends, default=None)

    def handle_deadline(self, now: float) -> None:
        """End those whose time has come."""
        due = [
            injection
            for injection in self.injections
            if injection.ended_at is None and injection.ends_at is not None and injection.ends_at <= now
        ]
        self._end(due, now)

    def _end(self, injections: list[Injection], now: float) -> None:
        due = [injection for injection in injections if injection.ended_at is None]
        for injection in due:
            assert injection.ends_at is not None
            injection.finish(min(now, injection.ends_at))
            handler = self._handlers[injection.target][injection.fault]
            if handler.end is not None:
                handler.end(injection, now)
        if due:
            self._changed()

    def _ended(self, injection: Injection) -> None:
        text = f"{injection.name} {FaultStage.ENDS}"
        self.on_fault(FaultNews(FaultStage.ENDS, injection.target, injection.fault, text))

    def _changed(self) -> None:
        for tell in self.on_change:
            tell()


def find(table: Mapping[str, Mapping[str, Fault]], target: str, fault: str) -> Fault:
    """Return the fault of a table. Raises ValueError with the known names."""
    there = table.get(target, {})
    if target not in table:
        raise ValueError(f"no target is called {target!r}; known: {', '.join(table)}")
    if fault not in there:
        raise ValueError(f"this {target} cannot have {fault!r}; it can have {', '.join(there)}")
    return there[fault]


def target_of(fault: str, table: Mapping[str, Mapping[str, Fault]]) -> str:
    """Return the target of a fault that is named alone. Raises ValueError for none, and for one of several targets."""
    targets = [target for target, faults in table.items() if fault in faults]
    if len(targets) == 1:
        return targets[0]
    if targets:
        raise ValueError(f"{fault} is a fault of {' and of '.join(targets)}; name its target")
    known = ", ".join(dict.fromkeys(name for faults in table.values() for name in faults))
    raise ValueError(f"no fault is called {fault!r}; known: {known}")


def _text(value: FaultValue) -> str:
    return value if isinstance(value, str) else f"{value:g}"
