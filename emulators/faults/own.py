"""Faults that a device carries out itself: each either strikes at once, or holds for some time and is asked for."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial

from emulators.faults.ledger import Handler, Injection


class OwnFaults:
    """The newest injection of each of a device's own faults, by name."""

    def __init__(self) -> None:
        self._newest: dict[str, Injection] = {}

    def held(self, names: Iterable[str]) -> Mapping[str, Handler]:
        """Handlers of faults that hold for some time; `under_way` asks for them."""
        return {name: Handler(partial(self._begin, name)) for name in names}

    def ended_by(self, name: str, end: Callable[[float], object]) -> Mapping[str, Handler]:
        """Return the same for one whose end the device is told, with the time in s."""
        return {name: Handler(partial(self._begin, name), lambda injection, now: end(now))}

    def striking(self, acts: Mapping[str, Callable[[float], object]]) -> Mapping[str, Handler]:
        """Handlers of faults that happen at once; each act is told the time, s."""
        return {name: Handler(partial(_strike, act)) for name, act in acts.items()}

    @property
    def any(self) -> bool:
        """Whether some fault has begun so far."""
        return bool(self._newest)

    def under_way(self, name: str, now: float) -> Injection | None:
        """Return the injection of a fault that holds now: it has an effect each time that it is asked for."""
        injection = self._newest.get(name)
        if injection is None or not injection.holds(now):
            return None
        injection.strike(now)
        return injection

    def holds(self, name: str, now: float) -> bool:
        """Whether a fault holds now, without an effect of it."""
        injection = self._newest.get(name)
        return injection is not None and injection.holds(now)

    def _begin(self, name: str, injection: Injection) -> None:
        self._newest[name] = injection


def _strike(act: Callable[[float], object], injection: Injection) -> None:
    act(injection.injected_at)
    injection.struck += 1
    injection.finish(injection.injected_at)
