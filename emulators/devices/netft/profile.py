"""Settings of an emulated Net F/T."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from emulators.sensing import settings as errors
from emulators.sensing.settings import PerAxis, SensorErrorSettings, check_errors
from protocol.devices.netft.page import FILTERS_HZ
from protocol.devices.netft.records import AXIA_RATES_HZ, BUFFER_LIMIT, INTERNAL_RATE_HZ
from protocol.geometry import Vector
from protocol.marks import (
    Mark,
    Preset,
    SettingError,
    above,
    between,
    check_settings,
    fill_presets,
    setting,
)

_RATES_HZ: Mapping[str, tuple[int, ...]] = {"netbox": (INTERNAL_RATE_HZ,), "axia": AXIA_RATES_HZ}


@dataclass(frozen=True, slots=True)
class NetFtProfile(SensorErrorSettings):
    """Settings in `[cell.netft]`."""

    ratings_n: Vector = setting(
        (130.0, 130.0, 400.0),
        Mark.CHOSEN,
        "calibrated range of fx fy fz, that of a medium-sized transducer",
        above(0.0),
        unit="N",
    )
    ratings_nm: Vector = setting(
        (10.0, 10.0, 10.0), Mark.CHOSEN, "calibrated range of mx my mz", above(0.0), unit="N·m"
    )
    counts_per_unit: int = setting(
        1_000_000,
        Mark.OBSERVED,
        "counts per N and per N·m, as in all known calibrations",
        between(1, 1_000_000),
    )
    noise_n: PerAxis = setting((0.018, 0.019, 0.018), Mark.OBSERVED, *errors.NOISE_N)
    """Source of this and the next setting: a Gamma behind a Net Box on an arm, 698 samples at 698 Hz, Zenodo
    11096791.
    """
    noise_nm: PerAxis = setting((0.0012, 0.0010, 0.0003), Mark.OBSERVED, *errors.NOISE_NM)
    wander_n: PerAxis = setting(0.01, Mark.ASSUMED, *errors.WANDER_N)
    """Upper bound: means over 0.1 s of an Axia80 differed by 0.0007 N. Source: see `creep_share`."""
    creep_share: float = setting(0.01, Mark.DERIVED, *errors.CREEP_SHARE)
    """0.02 … 0.13 N of 10 … 15 N within 15 s. Source: Axia80, leledeyuan00/Gravity-Compensation-F-T-sensor 139efe1."""
    vibration_n: PerAxis = setting((0.03, 0.009, 0.073), Mark.DERIVED, *errors.VIBRATION_N)
    """Total rms over a second less the white noise. Source of this and the next four: the Gamma on a KUKA LBR."""
    vibration_hz: tuple[float, float] = setting((9.0, 16.0), Mark.OBSERVED, *errors.VIBRATION_HZ)
    vibration_peak_hz: float = setting(71.0, Mark.OBSERVED, *errors.VIBRATION_PEAK_HZ)
    vibration_peak_share: float = setting(0.04, Mark.DERIVED, *errors.VIBRATION_PEAK_SHARE)
    """91 % of the variance of fz was below 20 Hz; the rest is the white noise and this."""
    motion_n: PerAxis = setting((0.65, 0.32, 0.21), Mark.OBSERVED, *errors.MOTION_N)
    rate_hz: int = setting(1000, Mark.ASSUMED, "records per second", between(1, AXIA_RATES_HZ[-1]), unit="Hz")
    buffered_records: int = setting(
        BUFFER_LIMIT, Mark.ASSUMED, "records per buffered datagram", between(1, BUFFER_LIMIT)
    )
    filter: int = setting(
        0, Mark.OBSERVED, "number of the low-pass filter; 0: no filter", between(0, len(FILTERS_HZ) - 1)
    )
    saturation_share: float = setting(
        2.6,
        Mark.DERIVED,
        "fraction of the range from which on gages saturate; from the calibration FT4472 in z",
        between(1.0, 5.0),
    )
    saturation_hold_samples: int = setting(
        32,
        Mark.ASSUMED,
        "time for which saturation is still reported after its end",
        between(0, INTERNAL_RATE_HZ),
    )
    boot_s: float = setting(
        5.0, Mark.ASSUMED, "time without response after power-up", between(0.0, 60.0), unit="s"
    )
    latency_s: float = setting(
        0.0003, Mark.ASSUMED, "time from a sample to its record", between(0.0, 0.1), unit="s"
    )
    bias_persistent: bool = setting(True, Mark.ASSUMED, "a bias persists after a power cycle")
    bias_stops_stream: bool = setting(False, Mark.ASSUMED, "a bias ends the current stream")
    stranger_may_stop: bool = setting(True, Mark.ASSUMED, "a stop from another address ends the stream")
    family: Literal["netbox", "axia"] = setting(
        "netbox",
        Mark.OBSERVED,
        "device whose status word and sample rates are emulated: a Net Box or an Ethernet Axia",
    )
    adc_rate_hz: int = setting(
        None,
        Mark.OBSERVED,
        "internal samples per second: 7000 of a Net Box; 488, 976, 1953, 3906 or 7812 of an Axia",
        unit="Hz",
    )
    rdt_enabled: bool = setting(True, Mark.CHOSEN, "raw data transfer is enabled")
    http_port: int = setting(
        0,
        Mark.CHOSEN,
        "port of the configuration page, if the URL does not name one; 0: any free port. A real one uses 80",
        between(0, 65535),
    )

    @property
    def presets(self) -> Mapping[str, Preset]:
        """Defaults that depend on the family."""
        rates = _RATES_HZ[self.family]
        return {"adc_rate_hz": Preset(rates[-1], Mark.OBSERVED if len(rates) == 1 else Mark.ASSUMED)}

    def __post_init__(self) -> None:
        if self.family not in _RATES_HZ:
            raise SettingError("family", f"must be netbox or axia, got {self.family}")
        fill_presets(self)
        check_settings(self)
        check_errors(self)
        for name in ("ratings_n", "ratings_nm"):
            if len(getattr(self, name)) != 3:
                raise SettingError(name, f"must be three values, got {len(getattr(self, name))}")
        rates = _RATES_HZ[self.family]
        if self.adc_rate_hz not in rates:
            known = ", ".join(map(str, rates))
            raise SettingError(
                "adc_rate_hz", f"of family {self.family} must be {known}, got {self.adc_rate_hz}"
            )
        if self.rate_hz > rates[-1]:
            raise SettingError(
                "rate_hz", f"of family {self.family} must be at most {rates[-1]}, got {self.rate_hz}"
            )
