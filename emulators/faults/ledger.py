"""Ledger of a cell's faults: each injection with its start, its end, and the number of its effects.

A device with faults provides a table of handlers by fault name. A handler receives the injection, reads its times
if they matter, and counts the effects in the injection.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from emulators.faults.kinds import Fault, FaultNews, FaultValue
from protocol.faults import FaultStage

INJECTION_LIMIT = 1000
"""Maximum number of faults injected in one cell. Chosen: no panel can exhaust the memory of the cell."""


def _ignore_news(news: FaultNews) -> None:
    """Do nothing, because there is no listener."""


def _ignore_end(injection: "Injection") -> None:
    """Do nothing, because there is no listener."""


@dataclass(slots=True, eq=False)
class Injection:
    """Injected fault, with times on the clock of the cell, s."""

    target: str
    fault: str
    values: Mapping[str, FaultValue]
    """All parameters, including parameters with default values."""
    injected_at: float
    ends_at: float | None
    """Time at which the fault ends, s; infinity for the end of the run; None for a fault that ends after a number
    of effects.
    """
    struck: int = 0
    """Number of effects so far: bytes or frames lost, samples altered, orders refused, states changed."""
    ended_at: float | None = None
    """Time at which the fault has ended, s; None before that."""
    on_end: Callable[["Injection"], object] = field(default=_ignore_end, repr=False)

    @property
    def name(self) -> str:
        """Target and fault as text."""
        return f"{self.target}: {self.fault}"

    def holds(self, now: float) -> bool:
        """Return whether the fault is active at this time, s. It is no longer active at its end."""
        end = self.ended_at if self.ended_at is not None else self.ends_at
        return self.injected_at <= now and (end is None or now < end)

    @property
    def waits(self) -> bool:
        """Whether the fault ends after a number of effects, not only after a time."""
        return self.ends_at is None or self._count > 0

    @property
    def _count(self) -> float:
        """Number of effects after which the fault ends; 0 for no limit."""
        return float(self.values.get("count", 0))

    def number(self, key: str) -> float:
        """Return the value of a numeric parameter."""
        return float(self.values[key])

    def strike(self, now: float) -> None:
        """Record an effect at a time, s. The last effect of `count` ends the fault."""
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
    """Callbacks of a device for the start and the end of a fault. `begin` raises ValueError for an impossible fault."""

    begin: Callable[[Injection], object]
    end: Callable[[Injection, float], object] | None = None
    """Callback for the end, which receives the time; None if the device reads the times of the injection."""


class Ledger:
    """Ledger that injects the faults of a table into the attached devices."""

    def __init__(self, table: Mapping[str, Mapping[str, Fault]]) -> None:
        self.table = table
        self._handlers: dict[str, dict[str, Handler]] = {}
        self.injections: list[Injection] = []
        """All injections, in order."""
        self.on_fault: Callable[[FaultNews], object] = _ignore_news
        """Callback for the start and the end of every fault."""
        self.on_change: list[Callable[[], object]] = []
        """Callback that is called after a fault has begun or ended, because a device may then have data to send."""

    def attach(self, target: str, handlers: Mapping[str, Handler]) -> None:
        """Register the fault handlers of a device under a target."""
        self._handlers.setdefault(target, {}).update(handlers)

    def check(
        self, target: str, fault: str, given: Mapping[str, object]
    ) -> tuple[dict[str, FaultValue], float | None]:
        """Return parameters and duration of a fault.

        Raises ValueError, in one line, if this cell does not support the fault.
        """
        parameters = find(self.table, target, fault).values(fault, given)
        if fault not in self._handlers.get(target, {}):
            raise ValueError(f"this cell cannot have {target}: {fault}; none of its devices supports it")
        return parameters

    def inject(self, target: str, fault: str, now: float, given: Mapping[str, object]) -> Injection:
        """Inject a fault from now on, or at its next opportunity. Raises the same ValueError as `check`."""
        values, duration = self.check(target, fault, given)
        if len(self.injections) >= INJECTION_LIMIT:
            raise ValueError(f"this cell has had {INJECTION_LIMIT} faults; start it again")
        ends_at = None if duration is None else now + duration
        injection = Injection(target, fault, values, now, ends_at)
        self._handlers[target][fault].begin(injection)
        self.injections.append(injection)
        parameters = ", ".join(f"{key} {_text(value)}" for key, value in values.items())
        stage = FaultStage.HAPPENS if injection.ended_at is not None else FaultStage.BEGINS
        lasting = "" if duration in (None, math.inf) else f" for {duration:g} s"
        text = f"{injection.name}{f' ({parameters})' if parameters else ''} {stage}{lasting}"
        self.on_fault(FaultNews(stage, target, fault, text, values))
        injection.on_end = self._report_end
        self._report_change()
        return injection

    def disarm(self, now: float) -> None:
        """End the faults that wait for an opportunity. The devices have already cancelled them."""
        for injection in self.injections:
            if injection.waits:
                injection.finish(now)

    def waiting(self, now: float) -> dict[str, int]:
        """Return the names of the waiting faults and the number of effects that each still has; 0 for no limit."""
        return {
            injection.name: max(0, int(injection.values.get("count", 0)) - injection.struck)
            for injection in self.injections
            if injection.waits and injection.holds(now)
        }

    def mend(self, now: float) -> None:
        """End the active faults that do not wait for a number of effects."""
        self._end([injection for injection in self.injections if not injection.waits], now)

    def active(self, now: float) -> tuple[str, ...]:
        """Return the names of the faults that are active at a time, s, in the order in which they began."""
        return tuple(injection.name for injection in self.injections if injection.holds(now))

    def lasting(self, now: float) -> tuple[str, ...]:
        """Return the names of the faults that are active at a time, s.

        This excludes faults that wait for a number of effects.
        """
        return tuple(
            injection.name for injection in self.injections if not injection.waits and injection.holds(now)
        )

    def next_deadline(self) -> float | None:
        """Return the time at which the next fault ends, s."""
        ends = [
            injection.ends_at
            for injection in self.injections
            if injection.ended_at is None and injection.ends_at is not None and injection.ends_at < math.inf
        ]
        return min(ends, default=None)

    def handle_deadline(self, now: float) -> None:
        """End the faults whose end is due."""
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
            self._report_change()

    def _report_end(self, injection: Injection) -> None:
        text = f"{injection.name} {FaultStage.ENDS}"
        self.on_fault(FaultNews(FaultStage.ENDS, injection.target, injection.fault, text))

    def _report_change(self) -> None:
        for listener in self.on_change:
            listener()


def find(table: Mapping[str, Mapping[str, Fault]], target: str, fault: str) -> Fault:
    """Return a fault of a table. Raises ValueError, which lists the known names, for an unknown target or fault."""
    faults = table.get(target, {})
    if target not in table:
        raise ValueError(f"unknown target {target!r}; known: {', '.join(table)}")
    if fault not in faults:
        raise ValueError(f"unknown fault {fault!r} for target {target!r}; known: {', '.join(faults)}")
    return faults[fault]


def target_of(fault: str, table: Mapping[str, Mapping[str, Fault]]) -> str:
    """Return the only target that has a fault with this name.

    Raises ValueError if there is no such target, or more than one.
    """
    targets = [target for target, faults in table.items() if fault in faults]
    if len(targets) == 1:
        return targets[0]
    if targets:
        raise ValueError(f"{fault} is a fault of {' and of '.join(targets)}; name its target")
    known = ", ".join(dict.fromkeys(name for faults in table.values() for name in faults))
    raise ValueError(f"unknown fault {fault!r}; known: {known}")


def _text(value: FaultValue) -> str:
    return value if isinstance(value, str) else f"{value:g}"
