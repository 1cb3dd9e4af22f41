"""Settings of the client of a NETCANOEM board."""

from dataclasses import dataclass

from protocol.devices.ati_can.messages import BASE, SLOTS
from protocol.marks import Mark, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class AtiCanClientProfile:
    """Settings in `[sensor.ati_can]`."""

    base: int = setting(BASE, Mark.OBSERVED, "base identifier of the board", between(0, 0x7F))
    slot: int = setting(0, Mark.CHOSEN, "slot of the calibration", between(0, SLOTS - 1))
    period_ms: float = setting(
        4.0, Mark.CHOSEN, "time between two requests for a sample", between(0.2, 1000.0), unit="ms"
    )
    answer_timeout_s: float = setting(0.1, Mark.ASSUMED, "timeout of a response", above(0.0), unit="s")
    tries: int = setting(3, Mark.ASSUMED, "attempts per request", at_least(1))
    ready_timeout_s: float = setting(
        5.0, Mark.CHOSEN, "timeout of the first response of a silent board", above(0.0), unit="s"
    )
    zero_s: float = setting(0.1, Mark.CHOSEN, "averaging time for a zero", between(0.0, 10.0), unit="s")

    def __post_init__(self) -> None:
        check_settings(self)
