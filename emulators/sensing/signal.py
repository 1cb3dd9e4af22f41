"""Sensor signal with faults, which change the wrench before the converter or the output of the converter.

A fault applies to the samples whose time lies within the fault, including its start and excluding its end, whenever
the samples are computed.
"""

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from emulators.faults.ledger import Handler, Injection
from emulators.sensing.faults import ALL, SIGNAL_FAULTS
from protocol.wrench import AXES

Floats = NDArray[np.float64]

_EPSILON = 1e-6
"""Share of a sample period by which a time may be too early due to rounding."""
_ROUNDING_S = 1e-9
"""Largest amount by which the time since the start may fall short of a full period due to rounding, s."""
_STUCK, _REPLAYED, _NOISE = "stuck", "replayed", "noise"


class Signal:
    """Signal of a sensor with faults: wrenches (6, n) of samples by number, at `rate` samples per second.

    `on_change` is called with the number of the first sample that a fault changes.
    """

    def __init__(self, rate: float, noise_setting: str, on_change: Callable[[int], object]) -> None:
        """`noise_setting` is the name of the setting that adds noise to a noiseless sensor.

        It is empty if the sensor has noise.
        """
        self._rate = rate
        self._noise_setting = noise_setting
        self._on_change = on_change
        self._faults: list[Injection] = []
        self._repeated: dict[Injection, Floats] = {}
        """Counts (6,) at which a signal is stuck, or counts (6, n) that are replayed, by fault."""
        self.handlers: Mapping[str, Handler] = {
            name: Handler(self._begin, self._end) for name in SIGNAL_FAULTS
        }
        """Fault handlers for a ledger, by fault name."""

    @property
    def faulty(self) -> bool:
        """Whether faults may have changed any sample."""
        return bool(self._faults)

    def wrench(self, wrench: Floats, first: int) -> Floats:
        """Return the falsified wrench for the true wrench (6, n) of the samples from number `first` on."""
        wrench = wrench.copy()
        for injection, part in self._parts(first, wrench.shape[1]):
            if injection.fault in _CHANGES:
                before = wrench[:, part].copy()
                # Times are relative to the start of the fault.
                since = (
                    np.arange(part.start, part.stop) + first - self._number(injection.injected_at)
                ) / self._rate
                _CHANGES[injection.fault](injection, wrench[:, part], since)
                injection.struck += int(np.any(wrench[:, part] != before, axis=0).sum())
        return wrench

    def noise(self, noise: Floats, first: int) -> Floats:
        """Return the noise (6, n) of the samples from number `first` on."""
        noise = noise.copy()
        for injection, part in self._parts(first, noise.shape[1]):
            if injection.fault == _NOISE:
                noise[:, part] *= injection.number("factor")
                injection.struck += part.stop - part.start
        return noise

    def output(self, counts: Floats, first: int) -> None:
        """Falsify the counts (6, n) of the samples from number `first` on, in place."""
        for injection, part in self._parts(first, counts.shape[1]):
            if injection.fault == _STUCK:
                stuck = self._repeated.setdefault(injection, counts[:, part.start].copy())[:, None]
                injection.struck += int(np.any(counts[:, part] != stuck, axis=0).sum())
                counts[:, part] = stuck
            if injection.fault == _REPLAYED:
                self._replay(injection, counts[:, part], first + part.start)

    def _replay(self, injection: Injection, counts: Floats, first: int) -> None:
        """Replace samples in place by the first samples of the fault, which repeat periodically."""
        length = max(round(injection.number("length_s") * self._rate), 1)
        recorded = self._repeated.setdefault(injection, np.zeros((len(AXES), length)))
        numbers = np.arange(first, first + counts.shape[1]) - self._number(injection.injected_at)
        new = numbers < length
        recorded[:, numbers[new]] = counts[:, new]
        again = recorded[:, numbers[~new] % length]
        injection.struck += int(np.any(counts[:, ~new] != again, axis=0).sum())
        counts[:, ~new] = again

    def _parts(self, first: int, count: int) -> Iterator[tuple[Injection, slice]]:
        """Yield each fault that applies to any of the samples, with the slice of the samples to which it applies."""
        for injection in self._faults:
            end = injection.ends_at if injection.ended_at is None else injection.ended_at
            stop = first + count if end is None or end == math.inf else self._number(end)
            begin = max(self._number(injection.injected_at), first)
            if begin < min(stop, first + count):
                yield injection, slice(begin - first, min(stop, first + count) - first)

    def _number(self, time: float) -> int:
        """Return the number of the first sample at or after a time, s."""
        return math.ceil(time * self._rate - _EPSILON)

    def _begin(self, injection: Injection) -> None:
        if injection.fault == _NOISE and self._noise_setting:
            raise ValueError(f"signal: noise: this sensor has no noise; set {self._noise_setting}")
        self._faults.append(injection)
        self._on_change(self._number(injection.injected_at))

    def _end(self, injection: Injection, now: float) -> None:
        assert injection.ended_at is not None
        if injection.ends_at != injection.ended_at:  # earlier than predicted
            self._on_change(self._number(injection.ended_at))


def _rows(injection: Injection) -> slice:
    """Return the rows of the axes that a fault affects."""
    axis = str(injection.values["axis"])
    return slice(0, len(AXES)) if axis == ALL else slice(AXES.index(axis), AXES.index(axis) + 1)


def _zero(injection: Injection, wrench: Floats, since: Floats) -> None:
    wrench[_rows(injection)] = 0.0


def _scale(injection: Injection, wrench: Floats, since: Floats) -> None:
    wrench[_rows(injection)] *= injection.number("factor")


def _offset(injection: Injection, wrench: Floats, since: Floats) -> None:
    wrench[_rows(injection)] += injection.number("amount")


def _drift(injection: Injection, wrench: Floats, since: Floats) -> None:
    wrench[_rows(injection)] += injection.number("per_s") * since


def _sign(injection: Injection, wrench: Floats, since: Floats) -> None:
    wrench[_rows(injection)] *= -1.0


def _swap(injection: Injection, wrench: Floats, since: Floats) -> None:
    rows = [AXES.index(str(injection.values[key])) for key in ("axis", "other")]
    wrench[rows] = wrench[rows[::-1]]


def _turn(injection: Injection, wrench: Floats, since: Floats) -> None:
    angle = math.radians(injection.number("degrees"))
    c, s = math.cos(angle), math.sin(angle)
    for x in (0, 3):
        wrench[x : x + 2] = np.array([[c, -s], [s, c]]) @ wrench[x : x + 2]


def _intermittent(injection: Injection, wrench: Floats, since: Floats) -> None:
    period = injection.number("period_s")
    lost = (since + _ROUNDING_S) % period < (1.0 - injection.number("duty")) * period
    wrench[_rows(injection), lost] = 0.0


_CHANGES: Mapping[str, Callable[[Injection, Floats, Floats], None]] = {
    "dead": _zero,
    "scale": _scale,
    "offset": _offset,
    "drift": _drift,
    "sign": _sign,
    "swapped": _swap,
    "turned": _turn,
    "spike": _offset,
    "intermittent": _intermittent,
}
"""Functions, by fault, that change a wrench (6, n) in place, given the times (n,) since the start of the fault, s."""
