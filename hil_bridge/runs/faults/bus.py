"""Faults of an emulated in-memory CAN bus, as handlers for `emulators.faults.bus`."""

from collections.abc import Callable, Mapping

from emulators.faults import Handler, Injection
from hil_bridge.clock import Clock, Timer
from hil_bridge.transports.can.memory import BitErrors, Disturbance, MemoryCanBus
from protocol.can.frame import CanFilter, CanFrame

_HIT_BIT = 20
"""Index of the corrupted bit. Chosen: every frame has this bit, after its arbitration."""
_HIGHEST = 0
"""Identifier with the highest priority, which wins every arbitration."""
_AT_ONCE = 8
"""Number of frames that a babbling node keeps ready. Chosen: the bus never becomes free for other nodes."""


class BusFaults:
    """Handlers that start and end the faults of one bus."""

    def __init__(self, bus: MemoryCanBus, clock: Clock, seed: int) -> None:
        self._bus = bus
        self._clock = clock
        self._seed = seed
        self._ends: dict[Injection, Callable[[], None]] = {}
        begins = {"off": self._destroy, "errors": self._spoil, "babble": self._babble}
        self.handlers: Mapping[str, Handler] = {
            name: Handler(begin, self._end) for name, begin in begins.items()
        }
        """Handlers for a ledger of faults."""

    def close(self) -> None:
        """End all faults."""
        while self._ends:
            self._ends.popitem()[1]()

    def _end(self, injection: Injection, now: float) -> None:
        self._ends.pop(injection)()

    def _destroy(self, injection: Injection) -> None:
        self._disturb(injection, lambda frame, bits: min(_HIT_BIT, bits))

    def _spoil(self, injection: Injection) -> None:
        self._disturb(injection, BitErrors(injection.number("rate"), self._seed))

    def _disturb(self, injection: Injection, disturbance: Disturbance) -> None:
        def disturb(frame: CanFrame, bits: int) -> int | None:
            hit = disturbance(frame, bits)
            injection.struck += hit is not None
            return hit

        def end() -> None:
            if self._bus.disturb is disturb:
                self._bus.disturb = None

        self._bus.disturb = disturb
        self._ends[injection] = end

    def _babble(self, injection: Injection) -> None:
        bus, clock, period = self._bus, self._clock, injection.number("period_ms") * 1e-3
        node = bus.connect((CanFilter(_HIGHEST),))
        node.start(lambda frames: None, lambda error: None)
        frame = CanFrame(_HIGHEST, bytes(8))

        def send() -> None:
            if len(node.queue) < _AT_ONCE:
                node.send((frame,))
                injection.struck += 1
            turns[0] += 1
            timers[0] = clock.call_at(injection.injected_at + turns[0] * period, send)

        def end() -> None:
            timers[0].cancel()
            node.queue.clear()
            bus.disconnect(node)

        turns = [0]
        timers: list[Timer] = [clock.call_soon(send)]
        self._ends[injection] = end
