"""What a gateway client is told and what it tells: its profile, its events, its statistics."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

from protocol.jr3.messages import AXES
from protocol.marks import Mark, check_settings, setting


@dataclass(frozen=True)
class GatewayClientProfile:
    """How a client treats its gateway."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    node: int = setting(1, Mark.OBSERVED, "node number of the gateway", minimum=1, maximum=127)
    mode: Literal["async", "sync"] = setting(
        "async", Mark.CHOSEN, "async: the gateway sends by its own clock; sync: it answers each SYNC"
    )
    cutoff_hz: float = setting(
        10.0,
        Mark.CHOSEN,
        "cut-off of the gateway's first-order filter, 0 = unfiltered",
        unit="Hz",
        minimum=0.0,
        maximum=655.35,
    )
    period_ms: float = setting(
        10.0,
        Mark.CHOSEN,
        "between frames, asynchronous; the counter wraps every 8.4 s and must tell frames apart",
        unit="ms",
        above=0.0,
        maximum=4000.0,
    )
    ack_timeout_s: float = setting(
        0.25, Mark.OBSERVED, "wait for an acknowledge before asking again", unit="s", above=0.0
    )
    retries: int = setting(3, Mark.CHOSEN, "repetitions of a command without acknowledge", minimum=0)
    ready_timeout_s: float = setting(
        10.0, Mark.CHOSEN, "patience with a gateway that is silent or not ready", unit="s", above=0.0
    )
    settle_s: float = setting(
        0.1, Mark.OBSERVED, "between start and first use or zero, for the filter", unit="s", minimum=0.0
    )
    sample_period_us: float = setting(
        128.5, Mark.OBSERVED, "the gateway's sampling, one step of its frame counter", unit="µs", above=0.0
    )
    full_scales: tuple[float, ...] = setting(
        (), Mark.CHOSEN, "fx fy fz mx my mz, empty = ask the gateway", unit="N, N·m", above=0.0
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.mode not in ("async", "sync"):
            raise ValueError(f"mode must be async or sync, got {self.mode}")
        if len(self.full_scales) not in (0, len(AXES)):
            raise ValueError(f"full_scales must be six values or none, got {len(self.full_scales)}")


@dataclass(frozen=True, slots=True)
class GatewayReady:
    """The session is established and the filter has settled; samples follow."""

    full_scales: tuple[float, ...]
    """fx fy fz mx my mz, N and N·m."""


@dataclass(frozen=True, slots=True)
class SensorFrame:
    """One complete sample: its force frame and its moment frame have the same counter."""

    counts: tuple[int, int, int, int, int, int]
    """fx fy fz mx my mz, full scale = 16384."""
    counter: int
    """As sent: sensor samples since the start, modulo 65536."""
    sequence: int
    """The counter, unwrapped: grows by the sensor samples between frames (about 78 at 10 ms), by 1 over a
    reboot, and never falls."""
    at: float
    """When the sample was complete, s on the receiver's clock."""


@dataclass(frozen=True, slots=True)
class Zeroed:
    """The gateway acknowledged a zero: samples count from the wrench of this moment."""


@dataclass(frozen=True, slots=True)
class GatewayRebooted:
    """An established session was lost to a boot-up, offsets included; the client has begun again."""


@dataclass(frozen=True, slots=True)
class GatewayStopped:
    """The gateway acknowledged the stop; nothing more will come."""


@dataclass(frozen=True, slots=True)
class GatewayFailed:
    """The session is over."""

    text: str
    """What is wrong and what to look at, one line."""


GatewayEvent: TypeAlias = (
    GatewayReady | SensorFrame | Zeroed | GatewayRebooted | GatewayStopped | GatewayFailed
)


@dataclass(slots=True)
class GatewayStatistics:
    """What was wrong with the samples that came, or with what came instead, since the client began."""

    lost: int = 0
    """Frames that the counter says are missing; asynchronous mode only, since SYNC has no cadence."""
    repeated: int = 0
    """Samples dropped because their counter was there before: duplicates and stragglers."""
    unpaired: int = 0
    """Force or moment frames without their other half."""
    malformed: int = 0
    """Payloads that are too short."""
