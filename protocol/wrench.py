"""Interface between the bridge and a force/torque sensor, which every sensor client implements.

A client is an `Endpoint`: it receives data from the wire, returns data to send, and is passed the time. It opens no
port, reads no clock and never blocks. `hil_bridge.devices.sensors.stream.ForceSensor` drives it. Its events:

| event | when |
| --- | --- |
| `SensorReady` | once the device streams, before the first frame; again after a change of its properties |
| `WrenchFrame` | for every complete sample, oldest first |
| `Zeroed` | the zero requested with `zero` is in effect: later frames are relative to it |
| `SensorRestarted` | the device has restarted and lost its zero; the client restarts too |
| `SensorNotice` | something that should appear in the recording |
| `SensorStopped` | the device has been stopped, or no stop command can reach it |
| `SensorFailed` | the session has failed; the last event |

Six values are always fx fy fz mx my mz. They are the force and moment of everything attached to the tool side of the
sensor, and of everything in contact with it. They refer to the sensor's origin, in its own right-handed frame. The
orientation of that frame in the tool frame, and mirroring, are settings of the bridge. A client reports the values in
device counts. Multiplied by `SensorFacts.scales`, they are in N and N·m. The scales are 1.0 for a device that reports
SI units.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, TypeAlias, TypeVar

from protocol.endpoint import Endpoint
from protocol.geometry import Wrench

Data = TypeVar("Data")

AXES = ("fx", "fy", "fz", "mx", "my", "mz")
"""Names of the six values in order. Bit k of `WrenchFrame.saturated` refers to axis k."""


PERIOD_MAX_S = 10.0
"""Longest plausible time between two frames, s. Chosen: many times the period of the slowest known stream."""
DELAY_MAX_S = 20.0
"""Longest plausible filter delay, s. Chosen: longer than the delay for the smallest cut-off that a JR3 gateway
accepts.
"""


@dataclass(frozen=True, slots=True)
class SensorFacts:
    """Properties of a sensor that is streaming. Raises ValueError for impossible values."""

    model: str
    """Model and serial number as reported by the device; empty if it reports none."""
    scales: Wrench
    """Scale of each axis, N or N·m per unit of `WrenchFrame.values`; 1.0 if the values are in SI units."""
    full_scales: Wrench | None
    """Calibrated range of each axis, N and N·m; None if the device does not report it."""
    range: Wrench | None
    """Largest wrench that the device can report, relative to the zero of its electronics, N and N·m; None if
    unknown.
    """
    period: float | None
    """Time between two frames on the device's clock, s; None if each frame must be requested."""
    delay: float
    """Delay of the device's filter output relative to the force at low frequencies, s."""
    tares: Literal["device", "host"]
    """Side that subtracts the zero: the device, or the host, where the client uses `HostTare`."""

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
    """The session is established and the filter has settled. Samples follow."""

    facts: SensorFacts


class WrenchFrame(NamedTuple):
    """One complete six-axis sample."""

    values: tuple[float, float, float, float, float, float]
    """Values fx fy fz mx my mz relative to the zero, in device counts. Multiplied by `SensorFacts.scales`, they are
    in N and N·m.
    """
    counter: int
    """Sample number as sent by the device. If the device sends none, the client counts the samples."""
    sequence: int
    """Unwrapped counter, which never decreases. From frame to frame, it increases by the number of device samples;
    over a restart, it increases by 1.
    """
    at: float
    """Time at which the sample was complete, s on the receiver's clock."""
    saturated: int = 0
    """Saturation bits. If bit k is set, axis k is at the end of its range, so its true value may be larger. A run
    relies on these bits alone and retracts if any is set. If the device does not report saturation, its client must
    therefore compare the raw values with the end of their range.
    """


@dataclass(frozen=True, slots=True)
class Zeroed:
    """The zero has been taken: the following samples are relative to the wrench at that time."""

    crossing: WrenchFrame | None = None
    """Sample that may precede or follow the zero. It is only for the recording, not for decisions."""


@dataclass(frozen=True, slots=True)
class SensorRestarted:
    """The device has restarted and lost its offsets. The client has restarted too."""


@dataclass(frozen=True, slots=True)
class SensorStopped:
    """The device has been stopped. No more data follows."""


@dataclass(frozen=True, slots=True)
class SensorNotice:
    """Event that should appear in the recording and does not end the session."""

    text: str


@dataclass(frozen=True, slots=True)
class SensorFailed:
    """The session has failed."""

    text: str
    """Description of the fault, in one line."""
    remedy: str = ""
    """Advice for an operator, in one line; empty if none is known."""


SensorEvent: TypeAlias = (
    SensorReady | WrenchFrame | Zeroed | SensorRestarted | SensorStopped | SensorNotice | SensorFailed
)


_STUCK_AFTER = 3
"""Number of consecutive samples with an unchanged counter from which the counter is considered stuck. Chosen: so
many cannot be a coincidence.
"""


@dataclass(slots=True)
class SensorStatistics:
    """Numbers of faulty samples and of other invalid data since the client started."""

    lost: int = 0
    """Number of samples that are missing. If the device samples at its own rate, it is computed from the counter.
    Without a counter, it is the number of samples replaced by bytes that form no sample. The age of a force is
    computed from this number and the number of received samples.
    """
    repeated: int = 0
    """Number of samples that were dropped because their counter or contents show that they were received before:
    duplicates and stragglers.
    """
    standing: int = 0
    """Number of consecutive samples with an unchanged counter, which is therefore stuck; 0 while the counter
    advances.
    """
    unpaired: int = 0
    """Number of force or moment frames without their counterpart."""
    malformed: int = 0
    """Number of payloads that could not be decoded."""

    @property
    def stands(self) -> bool:
        """Whether samples continue with an unchanged counter for too long to be a coincidence."""
        return self.standing >= _STUCK_AFTER


class SensorClient(Endpoint[Data, Data, SensorEvent], Protocol[Data]):
    """Client side of a session with a sensor. The session starts without a call; `zero` may be called at any time."""

    statistics: SensorStatistics

    @property
    def stop_patience(self) -> float:
        """Longest time until SensorStopped, s, if the first stop is lost and its repetition is received."""

    def zero(self) -> None:
        """Use the present wrench as zero once the session is ready. Raises LocalProtocolError after the end of the
        session.
        """

    def stop(self) -> None:
        """End the session. SensorStopped confirms that the device has been stopped. Idempotent."""


class HostTare:
    """Zero of a sensor that has no zero of its own: the mean of some raw samples, which is subtracted from the
    later samples.

    The client requests a zero with `zero`, passes every raw sample to `values`, and reports `Zeroed` after the
    frame of a sample for which `took` is set. Saturation must be determined from the raw samples, because a zero
    does not shift the ends of the range.
    """

    __slots__ = ("_missing", "_offset", "_samples", "_sums", "took")

    def __init__(self, samples: int = 1) -> None:
        """Create a zero that averages `samples` samples; 1 uses only the next sample. Raises ValueError for fewer
        than 1.
        """
        if samples < 1:
            raise ValueError(f"a zero needs at least 1 sample, got {samples}")
        self._samples = samples
        self._missing = 0
        self._sums = self._offset = (0.0,) * len(AXES)
        self.took = False
        """Whether the newest sample has completed a zero. The next sample is relative to the new zero."""

    def zero(self) -> None:
        """Start to average the next samples for a zero. If averaging is already in progress, it starts again."""
        self._missing, self._sums = self._samples, (0.0,) * len(AXES)

    def values(self, raw: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        """Convert six raw values, as reported by the device, to values relative to the latest zero."""
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
    """Convert the six values of a frame to N and N·m with the scales from the sensor's `SensorFacts`."""
    (fx, fy, fz, mx, my, mz), (a, b, c, d, e, f) = values, scales
    return fx * a, fy * b, fz * c, mx * d, my * e, mz * f
