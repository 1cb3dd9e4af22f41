"""Settings and assumptions of a gateway's client, independent of the wire."""

from dataclasses import dataclass
from typing import Any, ClassVar

from protocol.devices.jr3.firmware import MAX_CUTOFF_HZ, first_order_delay
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting
from protocol.wrench import AXES


@dataclass(frozen=True)
class AnyGatewayClientProfile:
    """Settings common to the clients of both gateways."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    cutoff_hz: float = setting(
        10.0,
        Mark.CHOSEN,
        "cut-off frequency of the gateway's first-order filter; 0: unfiltered",
        between(0.0, MAX_CUTOFF_HZ),
        unit="Hz",
    )
    retries: int = setting(3, Mark.CHOSEN, "repetitions of a command without an acknowledge", at_least(0))
    still_timeout_s: float = setting(
        1.0,
        Mark.CHOSEN,
        "timeout of samples whose counter does not change, in addition to five periods: a "
        "gateway without its sensor",
        above(0.0),
        unit="s",
    )
    sample_period_us: float = setting(
        128.5,
        Mark.OBSERVED,
        "sampling period of the gateway, one step of its frame counter",
        above(0.0),
        unit="µs",
    )
    full_scales: tuple[float, ...] = setting(
        (),
        Mark.CHOSEN,
        "full scales of fx fy fz mx my mz; empty: read from the gateway",
        above(0.0),
        unit="N, N·m",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if len(self.full_scales) not in (0, len(AXES)):
            raise SettingError("full_scales", f"must be six values or empty, got {len(self.full_scales)}")

    @property
    def delay(self) -> float:
        """Delay of a sample relative to the force at this cut-off, s."""
        return first_order_delay(self.cutoff_hz)
