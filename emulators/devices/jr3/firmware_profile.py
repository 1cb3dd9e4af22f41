"""Times of the program in both gateways of a JR3 sensor, as known or assumed."""

from dataclasses import dataclass
from typing import Any, ClassVar

from emulators.quantiles import check_quantiles
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


@dataclass(frozen=True)
class FirmwareProfile:
    """The settings that both gateways have. With `joins` and `blocks` false and no overhead, a gateway is kinder."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    calibration_s: float = setting(
        0.033, Mark.DERIVED, "reading the calibration: 256 bytes, one per sample", at_least(0.0), unit="s"
    )
    sample_period_us: float = setting(
        128.5, Mark.OBSERVED, "between samples taken from the sensor", above(0.0), unit="µs"
    )
    shortest_period_us: float = setting(
        0.0, Mark.DERIVED, "shortest period of the stream that the wire allows", at_least(0.0), unit="µs"
    )
    period_overhead_us: tuple[float, float] = setting(
        (30.0, 60.0),
        Mark.OBSERVED,
        "by so much each period of the stream is longer than asked for, least and largest: sending and waking up",
        between(0.0, 1000.0),
        unit="µs",
    )
    joins: bool = setting(
        True, Mark.OBSERVED, "stop, synchronous start and reset wait for the rest of the stream's period"
    )
    blocks: bool = setting(
        True,
        Mark.OBSERVED,
        "without a sensor a reset waits for one, deaf, and so does a stop of what was started; false: they end at once",
    )
    delay_ms: tuple[float, ...] = setting(
        (),
        Mark.CHOSEN,
        "measured delay of the stream's frames above the least, as evenly spaced quantiles, least first and largest "
        "last; empty: none",
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
