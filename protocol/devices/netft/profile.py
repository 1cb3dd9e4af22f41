"""Settings of a client about its Net F/T."""

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
"""Defaults by the family."""


@dataclass(frozen=True, slots=True)
class NetFtClientProfile:
    """Settings in `[sensor.netft]`."""

    http_port: int = setting(
        HTTP_PORT,
        Mark.OBSERVED,
        "port of its configuration page, where the URL does not name it",
        between(1, 65535),
    )
    page_timeout_s: float = setting(
        1.0, Mark.OBSERVED, "wait for one answer of the page, as netft-cpp does", above(0.0), unit="s"
    )
    page_patience_s: float = setting(
        15.0, Mark.CHOSEN, "patience with a page that does not come: a boot and more", above(0.0), unit="s"
    )
    silence_s: float = setting(
        0.1, Mark.OBSERVED, "silence after which the stream is asked for again", above(0.0), unit="s"
    )
    starts: int = setting(10, Mark.OBSERVED, "requests for a stream before it is given up", at_least(1))
    family: Literal["netbox", "axia"] = setting(
        "netbox", Mark.CHOSEN, "whose status word it sends: of a Net Box, or of an Ethernet Axia"
    )
    internal_rate_hz: float = setting(
        None,
        Mark.OBSERVED,
        "internal samples a second, which give the age of a record. By the family: 7000 of a Net Box; 488, 976, 1953, "
        "3906 or 7812 of an Axia, by its setting",
        above(0.0),
        unit="Hz",
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "time of which the mean makes a zero", between(0.0, 10.0), unit="s"
    )

    @property
    def presets(self) -> Mapping[str, Preset]:
        """Defaults that depend on the family."""
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
