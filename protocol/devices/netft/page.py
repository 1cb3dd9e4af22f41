"""Configuration page of a Net F/T, `/netftapi2.xml` over HTTP: the scaling of its counts, and its settings.

The page is not trusted: its size is limited, a required tag must occur exactly once, and every number must be
finite.
"""

import math
import re
from dataclasses import dataclass

from protocol.devices.netft.records import INTERNAL_RATE_HZ, output_step
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Wrench

HTTP_PORT = 80
"""TCP port of the configuration page. Source: manual."""
PAGE = "/netftapi2.xml"
"""Path of the configuration page. Source: manual."""
PAGE_LIMIT = 65536
"""Maximum number of bytes in a page. Source: netft-cpp, which accepts no more."""
_VALUE_LIMIT = 128
"""Maximum number of characters in a value. Source: netft-cpp."""

FORCE_UNITS = {
    "lbf": 4.4482216152605,
    "N": 1.0,
    "klbf": 4448.2216152605,
    "kN": 1000.0,
    "kgf": 9.80665,
    "gf": 9.80665e-3,
}
"""Size of each force unit in N, by name. Source of the names: netft-cpp; the last one is from the manual."""
FORCE_CODES = ("lbf", "N", "klbf", "kN", "kgf", "gf")
TORQUE_CODES = ("lbf-in", "lbf-ft", "N-m", "N-mm", "kgf-cm", "kN-m")
"""Torque units in the order of their codes, from 1 on, for a page without unit names. Source: manual."""
TORQUE_UNITS = {
    "lbf-in": 0.1129848290276167,
    "lbf-ft": 1.3558179483314004,
    "N-m": 1.0,
    "Nm": 1.0,
    "N-mm": 1e-3,
    "Nmm": 1e-3,
    "kgf-cm": 0.0980665,
    "kg-cm": 0.0980665,
    "kN-m": 1000.0,
}
"""Size of each torque unit in N·m, by name. Source of the names: netft-cpp."""
FILTERS_HZ = (0.0, 838.0, 326.0, 152.0, 73.0, 35.0, 18.0, 8.0, 5.0, 1500.0, 2000.0, 2500.0, 3000.0)
"""Cut-off of each filter, Hz, by the filter number, `setuserfilter`; 0 means unfiltered. Source: ROS driver
net_ft_driver.

Assumed: each filter has one pole; the filter shape is not published.
"""


@dataclass(frozen=True, slots=True)
class Configuration:
    """Properties of a Net F/T as reported by its page."""

    product: str
    scales: Wrench
    """Scale of each axis, N or N·m per count."""
    ratings: Wrench | None
    """Calibrated range of each axis, N and N·m; None if the page has none or it cannot be read."""
    streams: bool
    """Whether the raw data transfer (RDT) is enabled."""
    period: float | None
    """Time between two records, s; None if the page does not report the rate."""
    delay: float
    """Delay of the filter at low frequencies, s."""
    internal_rate_hz: float | None
    """Number of internal samples per second; None if the page does not report it."""


def filter_weight(cutoff_hz: float, rate_hz: float = INTERNAL_RATE_HZ) -> float:
    """Return the weight of a new sample in a one-pole filter at this sample rate, Hz; 1 for a cut-off of 0, which
    means unfiltered. Mark: assumed.
    """
    return 1.0 if not cutoff_hz else 1.0 - math.exp(-2.0 * math.pi * cutoff_hz / rate_hz)


def filter_delay(number: int) -> float:
    """Return the delay of the filter with this number at low frequencies, s; 0 for an unknown number. Mark: assumed."""
    weight = filter_weight(FILTERS_HZ[number] if 0 <= number < len(FILTERS_HZ) else 0.0)
    return (1.0 - weight) / weight / INTERNAL_RATE_HZ


def parse_page(page: bytes) -> Configuration:
    """Parse a configuration page. Raises RemoteProtocolError, with a one-line message, if the page or one of its
    values is invalid.
    """
    if len(page) > PAGE_LIMIT:
        raise RemoteProtocolError(f"the page has more than {PAGE_LIMIT} bytes")
    text = page.decode("ascii", "replace")
    if "<!DOCTYPE" in text.upper() or "<netft" not in text:
        raise RemoteProtocolError("the page is not from a Net F/T")
    force = _unit(text, "cfgfu", FORCE_UNITS, FORCE_CODES)
    torque = _unit(text, "cfgtu", TORQUE_UNITS, TORQUE_CODES)
    per_force, per_torque = (_number(_required(text, name), name) for name in ("cfgcpf", "cfgcpt"))
    units: Wrench = (force, force, force, torque, torque, torque)
    scales: Wrench = (*(force / per_force,) * 3, *(torque / per_torque,) * 3)
    rate, number = _value(text, "comrdtrate"), _value(text, "setuserfilter")
    rate_text = _value(text, "runrate") or _value(text, "setrate")
    internal = _number(rate_text, "runrate") if rate_text else None
    return Configuration(
        " ".join((_required(text, "prodname"), _value(text, "cfgnam") or "")).strip(),
        scales,
        _ratings(text, units),
        (_value(text, "comrdte") or "Enabled") not in ("Disabled", "0"),
        _period(_number(rate, "comrdtrate"), internal or INTERNAL_RATE_HZ) if rate else None,
        filter_delay(int(number) if number and number.isdigit() and len(number) < 3 else 0),
        internal,
    )


def _period(rate_hz: float, internal_rate_hz: float) -> float:
    return output_step(rate_hz, internal_rate_hz) / internal_rate_hz


def _value(text: str, name: str) -> str | None:
    """Return the text of a tag that may occur once; None if the tag is absent. Raises RemoteProtocolError if the
    tag is repeated.
    """
    values = re.findall(rf"<{name}>([^<]*)</{name}>", text)
    if len(values) > 1:
        raise RemoteProtocolError(f"the page contains {name} {len(values)} times")
    if not values:
        return None
    value = str(values[0]).strip()
    if len(value) > _VALUE_LIMIT or not value.isprintable():
        raise RemoteProtocolError(f"the page has an invalid value for {name}")
    return value


def _required(text: str, name: str) -> str:
    value = _value(text, name)
    if not value:
        raise RemoteProtocolError(f"the page does not contain {name}")
    return value


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1e-9 < value < 1e15:
        raise RemoteProtocolError(f"the page has {name} = {text!r}, which is not a number above 0")
    return value


def _unit(text: str, code_tag: str, units: dict[str, float], codes: tuple[str, ...]) -> float:
    """Return the size of a unit in SI. The page gives the unit by its name, in the tag `s` + `code_tag`, or only by
    its code.
    """
    unit, code = _value(text, f"s{code_tag}"), _value(text, code_tag)
    if not unit and code:
        unit = codes[int(code) - 1] if code in tuple("123456") else f"of code {code}"
    if not unit:
        raise RemoteProtocolError(f"the page does not contain s{code_tag}")
    if unit not in units:
        raise RemoteProtocolError(f"the page has the unknown unit {unit!r}; known: {', '.join(units)}")
    return units[unit]


def _ratings(text: str, units: Wrench) -> Wrench | None:
    """Parse the full scales, which are separated by semicolons, commas or blanks; None if they cannot be read."""
    try:
        ratings = [
            _number(part, "cfgmr") for part in re.split(r"[;,\s]+", _required(text, "cfgmr").strip(";, "))
        ]
    except RemoteProtocolError:
        return None
    if len(ratings) != len(units):
        return None
    fx, fy, fz, tx, ty, tz = (a * b for a, b in zip(ratings, units, strict=True))
    return fx, fy, fz, tx, ty, tz
