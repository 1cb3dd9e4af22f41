"""A force/torque sensor as the bridge sees it: the seam that the client of every make keeps.

A client is an `Endpoint`: it takes what came over the wire and gives what is to be sent, and is told the time. It opens
no port, reads no clock and waits for nothing. `hil_bridge.devices.sensors.stream.ForceSensor` drives it. What it tells:

| event | when |
| --- | --- |
| `SensorReady` | once the device streams, before the first frame; again when its facts have changed |
| `WrenchFrame` | for every complete sample, oldest first |
| `Zeroed` | the zero that `zero` asked for holds: frames told later count from it |
| `SensorRestarted` | the device has begun again and has forgotten its zero; the client begins again too |
| `SensorNotice` | something worth a line in the record |
| `SensorStopped` | the device knows that it is not needed any more, or there is no way to tell it |
| `SensorFailed` | the session is over; the last event |

Six values are always fx fy fz mx my mz. They are force and moment of all that hangs below the sensor, and of all that
touches it, on the sensor's tool side. They are about the sensor's origin, in its own right-handed frame. How that frame
sits in the tool's, and a mirrored one, are settings of the bridge. A client tells the values as the device counts them.
They mean N and N·m times `SensorFacts.scales`, which are 1.0 for a device that tells SI units.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, TypeAlias, TypeVar

from protocol.endpoint import Endpoint
from protocol.geometry import Wrench

Data = TypeVar("Data")

AXES = ("fx", "fy", "fz", "mx", "my", "mz")
"""Names of six values in their order; bit k of `WrenchFrame.saturated` stands for the k-th of them."""


PERIOD_MAX_S = 10.0
"""Longest time between two frames that is believed. Chosen: many times that of the slowest stream known."""
DELAY_MAX_S = 20.0
"""Longest delay of a filter that is believed. Chosen: above that of the smallest cut-off that a JR3 gateway takes."""


@dataclass(frozen=True, slots=True)
class SensorFacts:
    """Facts of a sensor once it streams. Raises ValueError for impossible values."""

    model: str
    """Model and serial number from the device; empty where it tells none."""
    scales: Wrench
    """N or N·m for one of `WrenchFrame.values`, axis by axis; 1.0 where the values are SI units."""
    full_scales: Wrench | None
    """Calibrated range of each axis, N and N·m; None where the device does not tell it."""
    range: Wrench | None
    """The largest wrench that the device can tell, from the zero of its electronics, N and N·m; None if not known."""
    period: float | None
    """Between two frames by the device's clock, s; None where each has to be asked for."""
    delay: float
    """Delay of the device's filter behind the force itself, s, at low frequencies."""
    tares: Literal["device", "host"]
    """Side that takes off the zero: the device, or the client with `HostTare`."""

    def __post_init__(self) -> None:
        for name in ("scales", "full_scales", "range"):
            six = getattr(self, name)
            if six is None and name != "scales":
                continue
            if len(six) != len(AXES) or not all(math.isfinite(one) and one > 0.0 for one in six):
                raise ValueError(f"{name} of a sensor must be six numbers above 0, got {six}")
        if self.period is not None and not 0.0 < self.period <= PERIOD_MAX_S:
            raise ValueError(
                f"period of a sensor must be above 0 s and at most {PERIOD_MAX_S:g} s, got {self.period:g}"
            )
        if not 0.0 <= self.delay <= DELAY_MAX_S:
            raise ValueError(f"delay of a sensor must be 0 … {DELAY_MAX_S:g} s, got {self.delay:g}")
        if self.tares not in ("device", "host"):
            raise ValueError(f"tares of a sensor must be device or host, got {self.tares!r}")


@dataclass(frozen=True, slots=True)
class SensorReady:
    """The session is established and the filter has settled; samples follow."""

    facts: SensorFacts


class WrenchFrame(NamedTuple):
    """One complete six-axis sample."""

    values: tuple[float, float, float, float, float, float]
    """fx fy fz mx my mz from the zero, as the device counts; times `SensorFacts.scales` they are N and N·m."""
    counter: int
    """As sent: what the device numbers its samples with; a client counts where the device does not."""
    sequence: int
    """The counter, unwrapped: grows by the device's samples between frames, by 1 over a restart, and never falls."""
    at: float
    """When the sample was complete, s on the receiver's clock."""
    saturated: int = 0
    """Bit k: axis k is at the end of its range, so that its value may be anything above. A run trusts these bits alone
    and retracts on any. So a client of a device that tells none compares the raw values with the end of their range.
    """


@dataclass(frozen=True, slots=True)
class Zeroed:
    """The zero has been taken: samples count from the wrench of that moment."""

    crossing: WrenchFrame | None = None
    """A sample that may be from before the zero or from after it: for a record, and for no decision."""


@dataclass(frozen=True, slots=True)
class SensorRestarted:
    """The device began again and has forgotten its offsets; the client has begun again."""


@dataclass(frozen=True, slots=True)
class SensorStopped:
    """The device knows that it is not needed any more; nothing more will come."""


@dataclass(frozen=True, slots=True)
class SensorNotice:
    """Something worth a line in the record that ends nothing."""

    text: str


@dataclass(frozen=True, slots=True)
class SensorFailed:
    """The session is over."""

    text: str
    """The fault, one line."""
    remedy: str = ""
    """Advice for an operator, one line; empty where none is known."""


SensorEvent: TypeAlias = (
    SensorReady | WrenchFrame | Zeroed | SensorRestarted | SensorStopped | SensorNotice | SensorFailed
)


_STANDS_AFTER = 3
"""Chosen: so many samples in a row with the same counter are no accident."""


@dataclass(slots=True)
class SensorStatistics:
    """Faults of the samples that came, or of other bytes, since the client began."""

    lost: int = 0
    """Samples that the counter says are missing, where the device has a cadence of its own. Without a counter: those
    that stood where bytes came that make no sample. The age of a force is counted by these and by those that came.
    """
    repeated: int = 0
    """Samples dropped because they were there before, by their counter or their contents: duplicates, stragglers."""
    standing: int = 0
    """Samples in a row that came with the counter of the newest one, so that it stands still; 0 while it moves."""
    unpaired: int = 0
    """Force or moment frames without their other half."""
    malformed: int = 0
    """Payloads that make no sense."""

    @property
    def stands(self) -> bool:
        """Whether samples continue while their counter stands still, too long for an accident."""
        return self.standing >= _STANDS_AFTER


class SensorClient(Endpoint[Data, Data, SensorEvent], Protocol[Data]):
    """The client's side of a session with a sensor. It begins by itself; `zero` may be asked for at any time."""

    statistics: SensorStatistics

    @property
    def stop_patience(self) -> float:
        """How long SensorStopped may take when the first stop was lost and its repetition is heard, s."""

    def zero(self) -> None:
        """Make the present wrench the origin, once settled. Raises LocalProtocolError after the end."""

    def stop(self) -> None:
        """End the session; SensorStopped tells that the device knows. Harmless when called again."""


class HostTare:
    """The zero of a sensor that has none of its own: the mean of some raw samples, taken off from then on.

    The client asks with `zero`, gives every raw sample to `values`, and tells `Zeroed` behind the frame of a sample
    after which `took` says so. Saturation is judged by the raw samples, for a zero moves no end of a range.
    """

    __slots__ = ("_missing", "_offset", "_samples", "_sums", "took")

    def __init__(self, samples: int = 1) -> None:
        """Average `samples` for a zero; 1 uses only the next one. Raises ValueError for fewer than 1."""
        if samples < 1:
            raise ValueError(f"a zero needs at least 1 sample, got {samples}")
        self._samples = samples
        self._missing = 0
        self._sums = self._offset = (0.0,) * len(AXES)
        self.took = False
        """The newest sample has completed a zero; the next one counts from it."""

    def zero(self) -> None:
        """Take a zero from the samples that come next. A zero under way begins again."""
        self._missing, self._sums = self._samples, (0.0,) * len(AXES)

    def values(self, raw: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        """Six raw values, as the device tells them, from the zero taken last."""
        before = self._offset
        self.took = False
        if self._missing:
            self._sums = tuple([a + b for a, b in zip(self._sums, raw, strict=True)])
            self._missing -= 1
            if not self._missing:
                self._offset = tuple([total / self._samples for total in self._sums])
                self.took = True
        (a, b, c, d, e, f), (o, p, q, r, s, t) = raw, before
        return a - o, b - p, c - q, d - r, e - s, f - t


def wrench_of(values: Sequence[float], scales: Sequence[float]) -> Wrench:
    """Six values of a frame in N and N·m; the scales are those of the sensor's facts."""
    (fx, fy, fz, mx, my, mz), (a, b, c, d, e, f) = values, scales
    return fx * a, fy * b, fz * c, mx * d, my * e, mz * f
