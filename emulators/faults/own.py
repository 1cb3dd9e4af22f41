"""Faults that a device carries out itself. Each either happens at once, or is active for a time and is polled."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial

from emulators.faults.ledger import Handler, Injection


class OwnFaults:
    """Newest injection of each fault that a device carries out itself, by fault name."""

    def __init__(self) -> None:
        self._newest: dict[str, Injection] = {}

    def held(self, names: Iterable[str]) -> Mapping[str, Handler]:
        """Return handlers of faults that are active for a time. Poll the faults with `under_way`."""
        return {name: Handler(partial(self._begin, name)) for name in names}

    def ended_by(self, name: str, end: Callable[[float], object]) -> Mapping[str, Handler]:
        """Return the handler of a fault that is active for a time.

        At the end of the fault, `end` is called with the time, s.
        """
        return {name: Handler(partial(self._begin, name), lambda injection, now: end(now))}

    def striking(self, acts: Mapping[str, Callable[[float], object]]) -> Mapping[str, Handler]:
        """Return handlers of faults that happen at once. Each function in `acts` is called with the time, s."""
        return {name: Handler(partial(_strike, act)) for name, act in acts.items()}

    @property
    def any(self) -> bool:
        """Whether any fault has begun so far."""
        return bool(self._newest)

    def under_way(self, name: str, now: float) -> Injection | None:
        """Return the injection of a fault and count an effect of it; None if the fault is not active now."""
        injection = self._newest.get(name)
        if injection is None or not injection.holds(now):
            return None
        injection.strike(now)
        return injection

    def holds(self, name: str, now: float) -> bool:
        """Return whether a fault is active now, without counting an effect."""
        injection = self._newest.get(name)
        return injection is not None and injection.holds(now)

    def _begin(self, name: str, injection: Injection) -> None:
        self._newest[name] = injection


def _strike(act: Callable[[float], object], injection: Injection) -> None:
    act(injection.injected_at)
    injection.struck += 1
    injection.finish(injection.injected_at)
