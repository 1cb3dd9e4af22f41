"""Timing of the firmware in both gateways of a JR3 sensor, known or assumed."""

from dataclasses import dataclass
from typing import Any, ClassVar

from emulators.quantiles import check_quantiles
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


@dataclass(frozen=True)
class FirmwareProfile:
    """Settings common to both gateways. With `joins` and `blocks` false and no overhead, a gateway is more
    forgiving.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    calibration_s: float = setting(
        0.033,
        Mark.DERIVED,
        "time to read the calibration: 256 bytes, one per sample",
        at_least(0.0),
        unit="s",
    )
    sample_period_us: float = setting(
        128.5, Mark.OBSERVED, "time between samples read from the sensor", above(0.0), unit="µs"
    )
    shortest_period_us: float = setting(
        0.0, Mark.DERIVED, "shortest period of the stream that the link allows", at_least(0.0), unit="µs"
    )
    period_overhead_us: tuple[float, float] = setting(
        (30.0, 60.0),
        Mark.OBSERVED,
        "smallest and largest excess of each period of the stream over the requested one, for "
        "sending and wake-up",
        between(0.0, 1000.0),
        unit="µs",
    )
    joins: bool = setting(
        True,
        Mark.OBSERVED,
        "whether stop, synchronous start and reset wait for the rest of the stream's period",
    )
    blocks: bool = setting(
        True,
        Mark.OBSERVED,
        "without a sensor, a reset waits for one without responding, and so does a stop of a "
        "started stream; false: both end at once",
    )
    delay_ms: tuple[float, ...] = setting(
        (),
        Mark.CHOSEN,
        "measured delay of the stream's frames above the minimum, as evenly spaced quantiles, in "
        "ascending order; empty: no delay",
        at_least(0.0),
        unit="ms",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        check_quantiles(self, "delay_ms")
        least, largest = self.period_overhead_us
        if least > largest:
            raise SettingError(
                "period_overhead_us", f"must be least and largest, got {least:g} and {largest:g}"
            )
