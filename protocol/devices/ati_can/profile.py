"""Settings of a client about its NETCANOEM board."""

from dataclasses import dataclass

from protocol.devices.ati_can.messages import BASE, SLOTS
from protocol.marks import Mark, check_settings, setting


@dataclass(frozen=True, slots=True)
class AtiCanClientProfile:
    """Settings in `[sensor.ati_can]`."""

    base: int = setting(BASE, Mark.OBSERVED, "base identifier of the board", minimum=0, maximum=0x7F)
    slot: int = setting(0, Mark.CHOSEN, "slot of the calibration", minimum=0, maximum=SLOTS - 1)
    period_ms: float = setting(
        4.0, Mark.CHOSEN, "between two questions for a sample", unit="ms", minimum=0.2, maximum=1000.0
    )
    answer_timeout_s: float = setting(0.1, Mark.ASSUMED, "wait for an answer", unit="s", above=0.0)
    tries: int = setting(3, Mark.ASSUMED, "times that a question is asked", minimum=1)
    ready_timeout_s: float = setting(
        5.0, Mark.CHOSEN, "patience with a board that says nothing at first", unit="s", above=0.0
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "time of which the mean makes a zero", unit="s", minimum=0.0, maximum=10.0
    )

    def __post_init__(self) -> None:
        check_settings(self)
