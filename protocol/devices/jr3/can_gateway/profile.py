"""Settings and assumptions of a client about its CAN gateway."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from protocol.devices.jr3.firmware import MAX_CUTOFF_HZ, check_cutoff, first_order_delay
from protocol.marks import Mark, above, at_least, between, check_settings, setting
from protocol.wrench import AXES


@dataclass(frozen=True)
class GatewayClientProfile:
    """Settings of a client about its gateway."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    node: int = setting(1, Mark.OBSERVED, "node number of the gateway", between(1, 127))
    mode: Literal["async", "sync"] = setting(
        "async", Mark.CHOSEN, "async: the gateway sends by its own clock; sync: it answers each SYNC"
    )
    cutoff_hz: float = setting(
        10.0,
        Mark.CHOSEN,
        "cut-off of the gateway's first-order filter, 0 = unfiltered",
        between(0.0, MAX_CUTOFF_HZ),
        unit="Hz",
    )
    period_ms: float = setting(
        10.0,
        Mark.CHOSEN,
        "between frames, asynchronous; tested by the firmware's authors from 1 on; the counter wraps every 8.4 s",
        above(0.0, 4000.0),
        unit="ms",
    )
    ack_timeout_s: float = setting(
        0.25,
        Mark.OBSERVED,
        "wait for an acknowledge before asking again; for a stop, a period of the stream more",
        above(0.0),
        unit="s",
    )
    retries: int = setting(3, Mark.CHOSEN, "repetitions of a command without acknowledge", at_least(0))
    ready_timeout_s: float = setting(
        10.0, Mark.CHOSEN, "patience with a gateway that is silent or not ready", above(0.0), unit="s"
    )
    still_timeout_s: float = setting(
        1.0,
        Mark.CHOSEN,
        "patience with samples whose counter stands still, beside five periods: a gateway without its sensor",
        above(0.0),
        unit="s",
    )
    settle_s: float = setting(
        0.1, Mark.OBSERVED, "between start and first use or zero, for the filter", at_least(0.0), unit="s"
    )
    sample_period_us: float = setting(
        128.5, Mark.OBSERVED, "the gateway's sampling, one step of its frame counter", above(0.0), unit="µs"
    )
    full_scales: tuple[float, ...] = setting(
        (), Mark.CHOSEN, "fx fy fz mx my mz, empty = ask the gateway", above(0.0), unit="N, N·m"
    )

    def __post_init__(self) -> None:
        check_settings(self)
        check_cutoff(self.cutoff_hz)
        if self.mode not in ("async", "sync"):
            raise ValueError(f"mode must be async or sync, got {self.mode}")
        if len(self.full_scales) not in (0, len(AXES)):
            raise ValueError(f"full_scales must be six values or none, got {len(self.full_scales)}")

    @property
    def delay(self) -> float:
        """Delay of a sample with this cut-off behind the force itself, s."""
        return first_order_delay(self.cutoff_hz)
