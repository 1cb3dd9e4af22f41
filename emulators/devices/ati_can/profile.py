"""Settings of an emulated NETCANOEM board."""

import struct
from dataclasses import dataclass

import numpy as np

from emulators.seams import Floats
from emulators.sensing import settings as errors
from emulators.sensing.settings import SensorErrorSettings, check_errors
from protocol.devices.ati_can.messages import BASE, GAGES, SLOTS
from protocol.geometry import Vector
from protocol.marks import Mark, SettingError, at_least, between, check_settings, setting

_MINI40 = (
    *(
        -11.6928025731666,
        -3.34657738404844,
        32.7764709067651,
        -926.64603423617,
        38.5192497186425,
        918.091940090325,
    ),
    *(
        49.8475873968464,
        1111.54828736883,
        8.58054953347822,
        -540.982510416618,
        -7.04384116121561,
        -523.956402989209,
    ),
    *(
        -1580.00155551285,
        -6.9911293161961,
        -1574.63107730182,
        14.3099554306112,
        -1614.37889906611,
        7.27537112828615,
    ),
    *(
        0.37477300521384,
        6.04214878084067,
        -22.5165000555478,
        -2.45353141451211,
        22.5514352819426,
        -3.19660800051747,
    ),
    *(
        25.4817193105601,
        -0.21309822296323,
        -13.0953176706754,
        5.46211714273733,
        -13.2800024806153,
        -4.8017154960817,
    ),
    *(
        0.560558370801638,
        13.4460552194242,
        -0.356886435089904,
        12.7776663278492,
        0.341175056695845,
        12.7373831753738,
    ),
)
"""Calibration FT4472 of a Mini40: rows fx fy fz tx ty tz, columns gages 0 … 5. Source: sawATIForceSensor,
FT4472Net.xml.
"""
_SINGULAR = 1e9
"""Condition number from which six gages do not separate six axes. Chosen."""


@dataclass(frozen=True, slots=True)
class AtiCanProfile(SensorErrorSettings):
    """Settings in `[cell.ati_can]`."""

    base: int = setting(BASE, Mark.OBSERVED, "base identifier of the board", between(0, 0x7F))
    matrix: tuple[float, ...] = setting(
        _MINI40, Mark.OBSERVED, "calibration: counts of each axis, fx first, per count of gages 0 … 5"
    )
    counts_per_unit: int = setting(
        1_000_000, Mark.OBSERVED, "counts per N and per N·m", between(1, 2**32 - 1)
    )
    slots: tuple[int, ...] = setting(
        (0,), Mark.CHOSEN, "slots that hold the calibration", between(0, SLOTS - 1)
    )
    offset_gages: int = setting(
        0,
        Mark.CHOSEN,
        "gage reading without a load; if set, a run needs the bias that `identify tool` measures",
        between(-20000, 20000),
        unit="counts",
    )
    noise_gages: float = setting(
        5.0, Mark.CHOSEN, "noise of each gage, rms; up to 80 is normal", at_least(0.0), unit="counts"
    )
    stiffness_n_m: Vector = setting((1.1e7, 1.1e7, 2.0e7), Mark.ASSUMED, *errors.STIFFNESS_N_M)
    """This and the next setting are those of a Mini40, as in the table of ATI's manual 9620-05-Transducer Section.
    Assumed, because they were not compared with the manual.
    """
    stiffness_nm_rad: Vector = setting((2.8e3, 2.8e3, 4.0e3), Mark.ASSUMED, *errors.STIFFNESS_NM_RAD)
    turnaround_s: float = setting(
        0.0002, Mark.ASSUMED, "time from a request to its response", between(0.0, 1.0), unit="s"
    )
    boot_s: float = setting(
        0.5, Mark.ASSUMED, "time without response after power-up and reset", between(0.0, 60.0), unit="s"
    )
    unplugged_gage: int = setting(
        32767, Mark.ASSUMED, "gage reading without a transducer", between(-32768, 32767)
    )
    reset_applies: bool = setting(
        False, Mark.ASSUMED, "a new base identifier takes effect after a reset, too"
    )
    serial: str = setting("FT4472", Mark.OBSERVED, "serial number of the transducer, up to 8 characters")
    firmware: tuple[int, int, int] = setting(
        (3, 8, 2),
        Mark.OBSERVED,
        "firmware version: major, minor, build; units are reported from 3.7 on",
        between(0, 255),
    )

    def __post_init__(self) -> None:
        check_settings(self)
        check_errors(self)
        if len(self.matrix) != GAGES * GAGES or not np.isfinite(self.matrix).all():
            raise SettingError("matrix", f"must be 36 numbers, got {len(self.matrix)}")
        if not np.linalg.cond(self.coefficients) < _SINGULAR:
            raise SettingError("matrix", "must be invertible")
        if len(self.firmware) != 3:
            raise SettingError("firmware", f"must be three numbers, got {len(self.firmware)}")
        if len(self.serial) > 8 or not self.serial.isascii():
            raise SettingError("serial", f"must be at most 8 ASCII characters, got {self.serial!r}")

    @property
    def coefficients(self) -> Floats:
        """Matrix (6, 6) that the board sends, in 32-bit numbers."""
        form = f">{GAGES * GAGES}f"
        return np.reshape(struct.unpack(form, struct.pack(form, *self.matrix)), (GAGES, GAGES))
