"""Settings of the client of an OnRobot HEX."""

from dataclasses import dataclass

from hil_onrobot.messages import COUNTS_PER_N, COUNTS_PER_NM, FILTERS_HZ, RATE_HZ
from protocol.devices.netft.page import filter_weight
from protocol.geometry import Wrench
from protocol.marks import Mark, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class HexClientSettings:
    """Settings in `[sensor.onrobot_hex]`."""

    every: int = setting(
        2,
        Mark.CHOSEN,
        "number of samples from record to record, which the client sets: 1000 samples a second, so 2 gives 500 Hz",
        between(1, 0xFFFF),
    )
    filter: int = setting(
        2,
        Mark.CHOSEN,
        "number of the low-pass filter, which the client sets: 0 none, 1 to 6: 500, 150, 50, 15, 5, 1.5 Hz",
        between(0, len(FILTERS_HZ) - 1),
    )
    clear_bias: bool = setting(
        True, Mark.OBSERVED, "the bias of the sensor is switched off at the start, as the public driver does"
    )
    read_scales: bool = setting(
        True,
        Mark.CHOSEN,
        "the scales are read from the sensor over TCP; if it does not answer, those below hold",
    )
    counts_per_n: int = setting(COUNTS_PER_N, Mark.OBSERVED, "counts per N", at_least(1))
    counts_per_nm: int = setting(COUNTS_PER_NM, Mark.OBSERVED, "counts per N·m", at_least(1))
    silence_s: float = setting(
        0.1,
        Mark.OBSERVED,
        "time without a record after which the stream is requested again",
        above(0.0),
        unit="s",
    )
    starts: int = setting(10, Mark.OBSERVED, "requests for a stream before the session fails", at_least(1))
    ready_s: float = setting(
        2.0, Mark.CHOSEN, "timeout of a sensor that reports an error at the start", above(0.0), unit="s"
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "duration over which a zero is averaged", between(0.0, 10.0), unit="s"
    )

    @property
    def period(self) -> float:
        """Time between two records, s."""
        return self.every / RATE_HZ

    @property
    def delay(self) -> float:
        """Delay of the filter at low frequencies, s. Mark: assumed."""
        weight = filter_weight(FILTERS_HZ[self.filter], RATE_HZ)
        return (1.0 - weight) / weight / RATE_HZ

    @property
    def scales(self) -> Wrench:
        """N and N·m per count."""
        n, nm = 1.0 / self.counts_per_n, 1.0 / self.counts_per_nm
        return n, n, n, nm, nm, nm

    def __post_init__(self) -> None:
        check_settings(self)
