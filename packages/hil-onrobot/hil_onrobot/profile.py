"""Settings of an emulated OnRobot HEX."""

from dataclasses import dataclass

from emulators.sensing import settings as errors
from emulators.sensing.settings import PerAxis, SensorErrorSettings, check_errors
from hil_onrobot.messages import COUNTS_PER_N, COUNTS_PER_NM, FILTERS_HZ, RATE_HZ, TCP_PORT
from protocol.geometry import Vector
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class HexProfile(SensorErrorSettings):
    """Settings in `[cell.onrobot_hex]`. The figures of the signal are those of the maker's data sheet of a HEX-E, from
    memory; they are assumed, because they were not compared with it.
    """

    ratings_n: Vector = setting(
        (200.0, 200.0, 200.0), Mark.ASSUMED, "nominal range of fx fy fz", above(0.0), unit="N"
    )
    ratings_nm: Vector = setting(
        (10.0, 10.0, 6.5),
        Mark.ASSUMED,
        "nominal range of mx my mz; of a HEX-H: 20, 20, 13",
        above(0.0),
        unit="N·m",
    )
    overload_share: float = setting(
        1.2, Mark.ASSUMED, "fraction of the range at which counts are clipped", between(1.0, 10.0)
    )
    counts_per_n: int = setting(COUNTS_PER_N, Mark.OBSERVED, "counts per N", between(1, 1_000_000))
    counts_per_nm: int = setting(COUNTS_PER_NM, Mark.OBSERVED, "counts per N·m", between(1, 10_000_000))
    stiffness_n_m: Vector = setting((1.2e5, 1.2e5, 6.7e5), Mark.ASSUMED, *errors.STIFFNESS_N_M)
    """Derived from a deflection of 1.7 mm in the plane and 0.3 mm along the axis under the nominal force."""
    stiffness_nm_rad: Vector = setting((230.0, 230.0, 74.0), Mark.ASSUMED, *errors.STIFFNESS_NM_RAD)
    """Derived from a deflection of 2.5° about the axes of the plane and 5° about z under the nominal moment."""
    noise_n: PerAxis = setting((0.035, 0.035, 0.15), Mark.ASSUMED, *errors.NOISE_N)
    noise_nm: PerAxis = setting((0.002, 0.002, 0.001), Mark.ASSUMED, *errors.NOISE_NM)
    wander_n: PerAxis = setting(0.05, Mark.ASSUMED, *errors.WANDER_N)
    """Five times that of a Net F/T, because a soft optical sensor depends more on temperature."""
    hysteresis_share: float = setting(0.02, Mark.ASSUMED, *errors.HYSTERESIS_SHARE)
    """The data sheet states less than 2 %."""
    cross_talk_share: float = setting(0.05, Mark.ASSUMED, *errors.CROSS_TALK_SHARE)
    every: int = setting(
        10,
        Mark.ASSUMED,
        "number of samples from record to record, until a client sets it",
        between(1, 0xFFFF),
    )
    filter: int = setting(
        4,
        Mark.ASSUMED,
        "number of the low-pass filter, until a client sets it",
        between(0, len(FILTERS_HZ) - 1),
    )
    latency_s: float = setting(
        0.0003, Mark.ASSUMED, "time from a sample to its record", between(0.0, 0.1), unit="s"
    )
    boot_s: float = setting(
        2.0, Mark.ASSUMED, "time without response after a power cycle", between(0.0, 60.0), unit="s"
    )
    saturated_status: int = setting(
        1, Mark.ASSUMED, "status word of an overloaded sensor", between(1, 2**32 - 1)
    )
    saturation_hold_samples: int = setting(
        32, Mark.ASSUMED, "time for which saturation is still reported after its end", between(0, RATE_HZ)
    )
    unplugged_status: int = setting(2, Mark.ASSUMED, "status word without a sensor", between(1, 2**32 - 1))
    bias_persistent: bool = setting(False, Mark.ASSUMED, "the bias persists after a power cycle")
    stranger_may_stop: bool = setting(True, Mark.ASSUMED, "a stop from another address ends the stream")
    first_client_only: bool = setting(
        False,
        Mark.ASSUMED,
        "only the first address is served until a power cycle, as reported of another device with such records",
    )
    tcp_port: int = setting(
        0,
        Mark.CHOSEN,
        f"TCP port, if the URL does not name one; 0: any free port. A real one uses {TCP_PORT}",
        between(0, 65535),
    )
    tcp_clients: int = setting(8, Mark.ASSUMED, "connections over TCP at a time", at_least(1))

    def __post_init__(self) -> None:
        check_settings(self)
        check_errors(self)
        for name in ("ratings_n", "ratings_nm"):
            if len(getattr(self, name)) != 3:
                raise SettingError(name, f"must be three values, got {len(getattr(self, name))}")
