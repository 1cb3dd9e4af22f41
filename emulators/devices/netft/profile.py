"""Settings of an emulated Net F/T."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from emulators.sensing import settings as errors
from emulators.sensing.settings import PerAxis, check_errors
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
class NetFtProfile:
    """Settings in `[cell.netft]`."""

    ratings_n: Vector = setting(
        (130.0, 130.0, 400.0),
        Mark.CHOSEN,
        "calibrated range of fx fy fz: a middle-sized one",
        above(0.0),
        unit="N",
    )
    ratings_nm: Vector = setting(
        (10.0, 10.0, 10.0), Mark.CHOSEN, "calibrated range of mx my mz", above(0.0), unit="N·m"
    )
    counts_per_unit: int = setting(
        1_000_000,
        Mark.OBSERVED,
        "counts for 1 N and for 1 N·m, as in all calibrations seen",
        between(1, 1_000_000),
    )
    noise_n: PerAxis = setting((0.018, 0.019, 0.018), Mark.OBSERVED, *errors.NOISE_N)
    """Source of this and the next: a Gamma behind a Net Box on an arm, 698 samples at 698 Hz, Zenodo 11096791."""
    noise_nm: PerAxis = setting((0.0012, 0.0010, 0.0003), Mark.OBSERVED, *errors.NOISE_NM)
    wander_n: PerAxis = setting(0.01, Mark.ASSUMED, *errors.WANDER_N)
    """No more than this: means of 0.1 s of an Axia80 differed by 0.0007 N. Source: see `creep_share`."""
    slope_n_min: PerAxis = setting(0.0, Mark.ASSUMED, *errors.SLOPE_N_MIN)
    creep_share: float = setting(0.01, Mark.DERIVED, *errors.CREEP_SHARE)
    """0.02 … 0.13 N of 10 … 15 N within 15 s. Source: Axia80, leledeyuan00/Gravity-Compensation-F-T-sensor 139efe1."""
    creep_s: float = setting(5.0, Mark.ASSUMED, *errors.CREEP_S)
    vibration_n: PerAxis = setting((0.03, 0.009, 0.073), Mark.DERIVED, *errors.VIBRATION_N)
    """All rms over a second less the white noise. Source of this and all below: the Gamma on a KUKA LBR."""
    vibration_hz: tuple[float, float] = setting((9.0, 16.0), Mark.OBSERVED, *errors.VIBRATION_HZ)
    vibration_peak_hz: float = setting(71.0, Mark.OBSERVED, *errors.VIBRATION_PEAK_HZ)
    vibration_peak_share: float = setting(0.04, Mark.DERIVED, *errors.VIBRATION_PEAK_SHARE)
    """91 % of the variance of fz lay below 20 Hz; the rest is the white noise and this."""
    motion_n: PerAxis = setting((0.65, 0.32, 0.21), Mark.OBSERVED, *errors.MOTION_N)
    motion_mm_s: float = setting(100.0, Mark.ASSUMED, *errors.MOTION_MM_S)
    rate_hz: int = setting(1000, Mark.ASSUMED, "records a second", between(1, AXIA_RATES_HZ[-1]), unit="Hz")
    buffered_records: int = setting(
        BUFFER_LIMIT, Mark.ASSUMED, "records in a buffered datagram", between(1, BUFFER_LIMIT)
    )
    filter: int = setting(0, Mark.OBSERVED, "number of its filter, 0 = none", between(0, len(FILTERS_HZ) - 1))
    saturation_share: float = setting(
        2.6,
        Mark.DERIVED,
        "of the range, from where on gages are at their end: from the calibration FT4472 in z",
        between(1.0, 5.0),
    )
    saturation_hold_samples: int = setting(
        32, Mark.ASSUMED, "for so long saturation is told after it", between(0, INTERNAL_RATE_HZ)
    )
    boot_s: float = setting(5.0, Mark.ASSUMED, "deaf and silent after power-up", between(0.0, 60.0), unit="s")
    latency_s: float = setting(
        0.0003, Mark.ASSUMED, "from a sample to its record", between(0.0, 0.1), unit="s"
    )
    bias_persistent: bool = setting(True, Mark.ASSUMED, "whether a bias outlives a power-down")
    bias_stops_stream: bool = setting(False, Mark.ASSUMED, "whether a bias ends the stream under way")
    stranger_may_stop: bool = setting(
        True, Mark.ASSUMED, "whether a stop from another address ends the stream"
    )
    family: Literal["netbox", "axia"] = setting(
        "netbox",
        Mark.OBSERVED,
        "whose status word and sample rates it has: of a Net Box, or of an Ethernet Axia",
    )
    adc_rate_hz: int = setting(
        None,
        Mark.OBSERVED,
        "internal samples a second: 7000 of a Net Box; 488, 976, 1953, 3906 or 7812 of an Axia",
        unit="Hz",
    )
    rdt_enabled: bool = setting(True, Mark.CHOSEN, "whether raw data transfer is switched on")
    http_port: int = setting(
        0,
        Mark.CHOSEN,
        "port of its page where its URL does not name it; 0: a free one, a real one has 80",
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
