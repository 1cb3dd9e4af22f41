"""Settings of an emulated FT 300."""

from dataclasses import dataclass
from typing import Literal

from emulators.sensing import settings as errors
from emulators.sensing.settings import PerAxis, SensorErrorSettings, check_errors
from protocol.marks import Mark, SettingError, above, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class Ft300Profile(SensorErrorSettings):
    """Settings in `[cell.ft300]`."""

    noise_n: PerAxis = setting((0.08, 0.10, 0.04), Mark.OBSERVED, *errors.NOISE_N)
    """Source of this and the next setting: Sijiahui/FT300-sensor 91440f9, two records of 30 samples at 10 Hz."""
    noise_nm: PerAxis = setting((0.0065, 0.0055, 0.004), Mark.OBSERVED, *errors.NOISE_NM)
    wander_n: PerAxis = setting(0.05, Mark.ASSUMED, *errors.WANDER_N)
    """As for a UR's own sensor. Source: charintorn/UR_RTDE_Force_Recorder 134e620."""
    vibration_n: PerAxis = setting(0.0, Mark.ASSUMED, *errors.VIBRATION_N)
    """Records at 10 Hz do not distinguish it from the white noise, which includes it."""
    motion_n: PerAxis = setting(0.0, Mark.ASSUMED, *errors.MOTION_N)
    latency_s: float = setting(
        0.010, Mark.ASSUMED, "time from a sample to its message", between(0.0, 0.1), unit="s"
    )
    jitter_s: float = setting(
        0.0005, Mark.ASSUMED, "largest additional delay of a message", between(0.0, 0.005), unit="s"
    )
    stream_start_s: float = setting(
        0.01,
        Mark.ASSUMED,
        "time from the response that starts the stream to the first message",
        between(0.0, 1.0),
        unit="s",
    )
    stop_after_ff: int = setting(1, Mark.ASSUMED, "number of bytes FF that end the stream", between(1, 50))
    power_up: Literal["modbus", "stream"] = setting("modbus", Mark.ASSUMED, "state after power-up")
    modbus_turnaround_s: float = setting(
        0.004, Mark.ASSUMED, "time from a request to its response", between(0.0, 1.0), unit="s"
    )
    frame_timeout_s: float = setting(
        0.05,
        Mark.ASSUMED,
        "time without a byte after which an incomplete request is discarded",
        above(0.0),
        unit="s",
    )
    fc04: bool = setting(True, Mark.ASSUMED, "function 04 reads registers as 03 does")
    fc06: bool = setting(True, Mark.ASSUMED, "function 06 writes the mode as 16 does")
    boot_s: float = setting(
        0.5, Mark.ASSUMED, "time without response after power-up", between(0.0, 60.0), unit="s"
    )
    urcap_period_s: float = setting(
        0.0101,
        Mark.ASSUMED,
        "time between two texts of the URCap: its sleep of 10 ms and its computing time",
        between(0.001, 1.0),
        unit="s",
    )
    """Observed: the sleep; the maker's server sent 94 texts a second on a busy computer."""
    urcap_clients: int = setting(
        1,
        Mark.OBSERVED,
        "clients that the URCap serves at a time; further ones wait without data",
        between(1, 64),
    )
    """Source of this and the next setting: the maker's server, robotiq_ft_sensor_dev 1.0.1, run with two clients."""
    urcap_repeats: int = setting(
        41, Mark.OBSERVED, "texts that repeat the newest value of a silent sensor", between(0, 10_000)
    )
    urcap_search_s: float = setting(
        1.5, Mark.ASSUMED, "time from the sensor's return to the next text", between(0.0, 60.0), unit="s"
    )
    """Observed: one second between two searches."""
    version: tuple[int, int, int] = setting(
        (1, 0, 0), Mark.CHOSEN, "numbers of the firmware version", between(0, 255)
    )
    serial: int = setting(1234, Mark.CHOSEN, "serial number", between(0, 2**32 - 1))
    year: int = setting(2021, Mark.CHOSEN, "year of production", between(0, 65535))

    def __post_init__(self) -> None:
        check_settings(self)
        check_errors(self)
        if len(self.version) != 3:
            raise SettingError("version", f"must be three numbers, got {len(self.version)}")
        if self.power_up not in ("modbus", "stream"):
            raise SettingError("power_up", f"must be modbus or stream, got {self.power_up}")
