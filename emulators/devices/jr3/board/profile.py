"""Settings of an emulated receiver board, known or assumed."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal

from emulators.devices.jr3.sensor import SensorProfile
from protocol.devices.jr3.board import REGISTERS
from protocol.marks import Mark, SettingError, at_least, between, check_settings, setting

_WORD, _POSITIVE = 65535, 32767


@dataclass(frozen=True)
class SecondSensorProfile:
    """Second sensor that can be plugged into the board: its differences from the first."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    serial_no: int = setting(1002, Mark.CHOSEN, "serial number of the sensor", between(1, _WORD))
    model_no: int = setting(1, Mark.ASSUMED, "the sensor's model number, assigned by JR3", between(1, _WORD))
    cal_day: int = setting(1, Mark.CHOSEN, "day of the year of the calibration", between(1, 366))
    cal_year: int = setting(2021, Mark.CHOSEN, "year of the calibration", between(0, _POSITIVE))
    full_scales_n: tuple[float, float, float] = setting(
        (317.0, 314.0, 845.0),
        Mark.OBSERVED,
        "full scales of fx fy fz, integer N (an ankle sensor on PCI)",
        between(1.0, 65535.0),
        unit="N",
    )
    full_scales_nm: tuple[float, float, float] = setting(
        (22.1, 21.9, 30.7),
        Mark.OBSERVED,
        "full scales of mx my mz, multiples of 0.1 N·m (an ankle sensor on PCI)",
        between(0.1, 6553.5),
        unit="N·m",
    )
    coupling: tuple[float, ...] = setting(
        (),
        Mark.ASSUMED,
        "coupling of the axes to the raw channels, as `coupling` of the first sensor; empty: "
        "each axis on its own channel",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        self.of(SensorProfile())

    def of(self, first: SensorProfile) -> SensorProfile:
        """Return the complete sensor, given the first. Raises ValueError for an impossible one."""
        return replace(
            first,
            full_scales_n=self.full_scales_n,
            full_scales_nm=self.full_scales_nm,
            coupling=self.coupling,
        )


@dataclass(frozen=True)
class BoardProfile:
    """A board with its sensor's identification."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    boot_s: float = setting(
        0.02,
        Mark.ASSUMED,
        "time from reset to the first sample; a driver waits 25 ms",
        at_least(0.0),
        unit="s",
    )
    calibration_s: float = setting(
        0.033,
        Mark.DERIVED,
        "time to read the calibration: 256 bytes, one per sample",
        at_least(0.0),
        unit="s",
    )
    offsets_zeroed_s: float = setting(
        2.0,
        Mark.ASSUMED,
        "time from the end of that until the board zeroes its offsets by itself; observed: less than 10 s",
        between(0.0, 10.0),
        unit="s",
    )
    command_times: Literal["typical", "maximum"] = setting(
        "typical", Mark.CHOSEN, "duration of a command: which of the manual's two times applies"
    )
    adoption_samples: int = setting(
        16,
        Mark.OBSERVED,
        "interval at which the board checks the words that the host writes",
        at_least(1),
        unit="samples",
    )
    watch_dog_s: float = setting(
        0.01, Mark.ASSUMED, "time from the last sample to the watchdog's error bit", at_least(0.0), unit="s"
    )
    unplugged_errors: int = setting(
        0x8000, Mark.ASSUMED, "error bits while no sensor is connected", between(0, _WORD)
    )
    unplugged_data: Literal["frozen", "zero"] = setting(
        "frozen", Mark.ASSUMED, "data while no sensor is connected"
    )
    turn: Literal["load", "frame"] = setting(
        "load",
        Mark.OBSERVED,
        "what a positive rotation of a transform turns, by the right-hand rule: load, as in the "
        "manual's example where 90° about z turn fx into fy; frame, the opposite, as in textbooks",
    )
    units: Literal[0, 1, 2, 3] = setting(
        1,
        Mark.CHOSEN,
        "unit of full scales and lengths: 0 lb in·lb mil, 1 N N·m×10 mm×10, 2 kgf×10 kgf·cm mm×10, "
        "3 klb kin·lb mil",
    )
    serial_no: int = setting(1001, Mark.CHOSEN, "serial number of the sensor", between(1, _WORD))
    model_no: int = setting(1, Mark.ASSUMED, "the sensor's model number, assigned by JR3", between(1, _WORD))
    eeprom_ver: int = setting(1, Mark.ASSUMED, "version of the sensor's EEPROM", between(0, 255))
    cal_day: int = setting(1, Mark.CHOSEN, "day of the year of the calibration", between(1, 366))
    cal_year: int = setting(2020, Mark.CHOSEN, "year of the calibration", between(0, _POSITIVE))
    second: SecondSensorProfile = field(default_factory=SecondSensorProfile)
    thickness_mm: float = setting(
        31.8, Mark.ASSUMED, "thickness of the sensor, flange to flange", between(0.0, 800.0), unit="mm"
    )
    channels: int = setting(
        0x00FF, Mark.ASSUMED, "bit mask of the raw channels that the sensor sends", between(0, _WORD)
    )
    software_ver: int = setting(
        302, Mark.OBSERVED, "version of the board's firmware × 100", between(0, _POSITIVE)
    )
    software_day: int = setting(1, Mark.ASSUMED, "day of the year of that firmware", between(1, 366))
    software_year: int = setting(1994, Mark.ASSUMED, "year of that firmware", between(0, _POSITIVE))
    copyright: str = setting("Emulated JR3 receiver", Mark.CHOSEN, "text of the copyright words")
    vect_axes: int = setting(
        0x3F, Mark.ASSUMED, "vector axes at power-up: V1 of all forces, V2 of all moments", between(0, 255)
    )
    peak_address: int = setting(
        0x90, Mark.ASSUMED, "filter whose peaks are recorded at power-up: filter0", between(0, _WORD)
    )
    rate_address: int = setting(
        0xA0, Mark.ASSUMED, "filter whose rate is computed at power-up: filter2", between(0, _WORD)
    )
    rate_divisor: int = setting(8, Mark.ASSUMED, "samples between two rates at power-up", between(0, _WORD))
    near_sat_value: int = setting(
        26214, Mark.OBSERVED, "raw magnitude that sets a warning", between(0, _POSITIVE)
    )
    full_scale_span: float = setting(
        1.0,
        Mark.ASSUMED,
        "largest recommended full scale over the smallest, at most: 1 keeps a driver's start-up "
        "at the sensor's rating; from 2^(16 − ADC bits) on, the step of the converter is the "
        "only limit",
        between(1.0, 16.0),
    )
    idle_hz: float = setting(
        50_000.0, Mark.ASSUMED, "idle loops of the processor per second", at_least(0.0), unit="Hz"
    )

    def __post_init__(self) -> None:
        check_settings(self)
        for name, allowed in (
            ("command_times", ("typical", "maximum")),
            ("unplugged_data", ("frozen", "zero")),
            ("turn", ("load", "frame")),
            ("units", (0, 1, 2, 3)),
        ):
            if getattr(self, name) not in allowed:
                text = " or ".join(map(str, allowed))
                raise SettingError(name, f"must be {text}, got {getattr(self, name)}")
        longest = REGISTERS["copyright"].count
        if len(self.copyright) > longest or not self.copyright.isascii():
            raise SettingError(
                "copyright", f"must be at most {longest} ASCII characters, got {self.copyright!r}"
            )
