"""What the bridge sees of a force/torque sensor, whatever stands between: one seam for every client of one."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias, TypeVar

from protocol.endpoint import Endpoint

Data = TypeVar("Data")


@dataclass(frozen=True, slots=True)
class SensorReady:
    """The session is established and the filter has settled; samples follow."""

    full_scales: tuple[float, ...]
    """fx fy fz mx my mz, N and N·m."""
    model: str = ""
    """What the device says of the sensor: model and serial number; empty where it says nothing."""


class SensorFrame(NamedTuple):
    """One complete six-axis sample."""

    counts: tuple[int, int, int, int, int, int]
    """fx fy fz mx my mz, full scale = 16384."""
    counter: int
    """As sent: the device's samples since its start, modulo 65536."""
    sequence: int
    """The counter, unwrapped: grows by the device's samples between frames (a CAN gateway: about 78 at 10 ms), by 1
    over a restart, and never falls."""
    at: float
    """When the sample was complete, s on the receiver's clock."""


@dataclass(frozen=True, slots=True)
class Zeroed:
    """The device acknowledged a zero: samples count from the wrench of this moment."""


@dataclass(frozen=True, slots=True)
class SensorRestarted:
    """The device began anew and has forgotten its offsets; the client has begun again."""


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
    """What is wrong and what to look at, one line."""


SensorEvent: TypeAlias = (
    SensorReady | SensorFrame | Zeroed | SensorRestarted | SensorStopped | SensorNotice | SensorFailed
)


@dataclass(slots=True)
class SensorStatistics:
    """What was wrong with the samples that came, or with what came instead, since the client began."""

    lost: int = 0
    """Samples that the counter says are missing, where the device has a cadence of its own."""
    repeated: int = 0
    """Samples dropped because their counter was there before: duplicates and stragglers."""
    unpaired: int = 0
    """Force or moment frames without their other half."""
    malformed: int = 0
    """Payloads that make no sense."""


class SensorClient(Endpoint[Data, Data, SensorEvent], Protocol[Data]):
    """The client's side of a session with a sensor. It begins by itself; `zero` may be asked for at any time."""

    statistics: SensorStatistics

    @property
    def delay(self) -> float:
        """How much later than the force itself the device's filter tells of it, s, at low frequencies."""

    @property
    def period(self) -> float | None:
        """Between two samples by the device's cadence, s; None where each has to be asked for."""

    @property
    def stop_patience(self) -> float:
        """How long SensorStopped may take when the first stop was lost and its repetition is heard, s."""

    def zero(self) -> None:
        """Make the present wrench the origin, once settled. Raises LocalProtocolError after the end."""

    def stop(self) -> None:
        """End the session; SensorStopped tells that the device knows. Harmless when called again."""
