"""Injected faults of a controller, and what those of its telegrams and of their answers do to them."""

from collections.abc import Iterable

from emulators.faults import Handler, Injection

_POSITION = b'<RIst X="'


class Injected:
    """The newest injection of each fault."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, str], Injection] = {}

    def handler(self, target: str, fault: str) -> Handler:
        """A handler for a fault that the device looks for with `strikes`."""

        def keep(injection: Injection) -> None:
            self._kept[target, fault] = injection

        return Handler(keep)

    def holds(self, target: str, fault: str, now: float) -> bool:
        """Whether it is under way; not counted."""
        injection = self._kept.get((target, fault))
        return injection is not None and injection.holds(now)

    def strikes(self, target: str, fault: str, now: float) -> Injection | None:
        """The injection if it is under way, counted as an effect. One of a number of effects ends with the last."""
        injection = self._kept.get((target, fault))
        if injection is None or not injection.holds(now):
            return None
        injection.struck += 1
        if injection.ends_at is None and injection.struck >= int(injection.values.get("count", 1)):
            injection.finish(now)
        return injection


class Line:
    """Telegrams on their way out: each with the time at which it leaves, s."""

    def __init__(self, injected: Injected, names: Iterable[str]) -> None:
        """`names` are the faults of the target `packets` that strike telegrams."""
        self._injected = injected
        self._queue: list[tuple[float, bytes]] = []
        self._kept_back: bytes | None = None
        self.handlers = {name: injected.handler("packets", name) for name in names}

    def put(self, telegram: bytes, now: float) -> None:
        """Let a telegram leave, or what the faults make of it."""
        if self._strikes("mute", now) or self._strikes("lost", now):
            return
        if self._strikes("not-a-number", now):
            head, found, tail = telegram.partition(_POSITION)
            telegram = head + found + b"NaN" + tail[tail.find(b'"') :] if found else telegram
        if self._strikes("malformed", now):
            telegram = telegram[: len(telegram) // 2]
        telegrams = [telegram]
        if self._kept_back is not None:
            telegrams, self._kept_back = [telegram, self._kept_back], None
        elif self._strikes("reordered", now):
            self._kept_back = telegram
            return
        if self._strikes("duplicated", now):
            telegrams = [each for each in telegrams for _ in range(2)]
        late = self._strikes("late", now)
        at = now if late is None else now + late.number("ms") / 1e3
        self._queue.extend((at, each) for each in telegrams)

    def take(self, now: float) -> list[bytes]:
        """Those that leave now."""
        if not self._queue:
            return []
        out = [telegram for at, telegram in self._queue if at <= now]
        self._queue = [entry for entry in self._queue if entry[0] > now]
        return out

    def next_at(self) -> float | None:
        """When the next one leaves, s."""
        return min([at for at, _ in self._queue]) if self._queue else None

    def _strikes(self, fault: str, now: float) -> Injection | None:
        return self._injected.strikes("packets", fault, now)
