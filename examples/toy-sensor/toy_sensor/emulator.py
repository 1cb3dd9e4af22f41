"""Emulated load cell: it samples while a client requests it."""

from collections.abc import Sequence
from dataclasses import dataclass

from emulators.seams import Handlers, WrenchSource
from emulators.sensing import NoisyWrench
from protocol.geometry import Wrench
from protocol.marks import Mark, at_least, check_settings, setting
from toy_sensor.wire import BYE, HELLO, PERIOD_S, RANGE_COUNTS, SAMPLE, SCALES


@dataclass(frozen=True, slots=True)
class LoadProfile:
    """Properties that differ between load cells of this kind."""

    noise_n: float = setting(
        0.02, Mark.CHOSEN, "noise of the forces, root mean square", at_least(0.0), unit="N"
    )

    def __post_init__(self) -> None:
        check_settings(self)


class LoadCell:
    """Load cell that samples while a client requests it: an `EmulatedSensor`."""

    def __init__(self, profile: LoadProfile, source: WrenchSource, seed: int) -> None:
        noise: Wrench = (*(profile.noise_n,) * 3, *(profile.noise_n / 10.0,) * 3)
        self._wrench = NoisyWrench(source, 1.0 / PERIOD_S, noise, seed)
        self._first: int | None = None
        """Number of the sample with the counter 0."""
        self._next = 0
        self._out: list[bytes] = []
        self.endpoint = self
        self.handlers: Handlers = {}

    def sampled_at(self, counter: int) -> float | None:
        return None if self._first is None else (self._first + counter) * PERIOD_S

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            if datagram == HELLO and self._first is None:
                self._first = self._next = self._wrench.number_at(now)
            elif datagram == BYE:
                self._first = None

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return None if self._first is None else self._next * PERIOD_S

    def handle_deadline(self, now: float) -> None:
        while self._first is not None and self._next * PERIOD_S <= now:
            sample = zip(self._wrench.sample(self._next), SCALES, strict=True)
            counts = [round(value / scale) for value, scale in sample]
            ends = sum(1 << axis for axis, count in enumerate(counts) if abs(count) >= RANGE_COUNTS)
            kept = [max(-RANGE_COUNTS, min(RANGE_COUNTS, count)) for count in counts]
            self._out.append(SAMPLE.pack(b"LS", self._next - self._first, *kept, ends))
            self._next += 1
