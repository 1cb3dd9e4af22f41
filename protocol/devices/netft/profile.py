"""Settings of the client of a Net F/T."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from protocol.devices.netft.page import HTTP_PORT
from protocol.devices.netft.records import AXIA_RATES_HZ, INTERNAL_RATE_HZ
from protocol.marks import (
    Mark,
    Preset,
    SettingError,
    above,
    at_least,
    between,
    check_settings,
    fill_presets,
    setting,
)

_PRESETS: Mapping[str, Mapping[str, Preset]] = {
    "netbox": {"internal_rate_hz": Preset(INTERNAL_RATE_HZ, Mark.OBSERVED)},
    "axia": {"internal_rate_hz": Preset(AXIA_RATES_HZ[-1], Mark.ASSUMED)},
}
"""Default settings of each family."""


@dataclass(frozen=True, slots=True)
class NetFtClientProfile:
    """Settings in `[sensor.netft]`."""

    http_port: int = setting(
        HTTP_PORT,
        Mark.OBSERVED,
        "port of its configuration page, if the URL does not name one",
        between(1, 65535),
    )
    page_timeout_s: float = setting(
        1.0, Mark.OBSERVED, "timeout of one response of the page, as in netft-cpp", above(0.0), unit="s"
    )
    page_patience_s: float = setting(
        15.0, Mark.CHOSEN, "timeout of an unreachable page: longer than a boot", above(0.0), unit="s"
    )
    silence_s: float = setting(
        0.1,
        Mark.OBSERVED,
        "time without a record after which the stream is requested again",
        above(0.0),
        unit="s",
    )
    starts: int = setting(10, Mark.OBSERVED, "requests for a stream before the session fails", at_least(1))
    family: Literal["netbox", "axia"] = setting(
        "netbox", Mark.CHOSEN, "device whose status word it sends: a Net Box or an Ethernet Axia"
    )
    internal_rate_hz: float = setting(
        None,
        Mark.OBSERVED,
        "internal samples per second, which give the age of a record. By the family: 7000 of a "
        "Net Box; 488, 976, 1953, 3906 or 7812 of an Axia, by its setting",
        above(0.0),
        unit="Hz",
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "duration over which a zero is averaged", between(0.0, 10.0), unit="s"
    )

    @property
    def presets(self) -> Mapping[str, Preset]:
        """Default values of the settings that depend on the family."""
        return _PRESETS[self.family]

    def __post_init__(self) -> None:
        if self.family not in _PRESETS:
            raise SettingError("family", f"must be netbox or axia, got {self.family}")
        fill_presets(self)
        check_settings(self)
        if self.family == "netbox" and self.internal_rate_hz in AXIA_RATES_HZ:
            raise SettingError(
                "internal_rate_hz", f'{self.internal_rate_hz:g} Hz is a rate of an Axia; set family = "axia"'
            )
