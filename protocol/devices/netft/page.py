"""The configuration page of a Net F/T, `/netftapi2.xml` over HTTP: what its counts mean, and how it is set.

Nothing of it is trusted: a page is bounded, a tag that is needed must be there once, and every number is finite.
"""

import math
import re
from dataclasses import dataclass

from protocol.devices.netft.records import INTERNAL_RATE_HZ, output_step
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Wrench

HTTP_PORT = 80
"""Source: manual."""
PAGE = "/netftapi2.xml"
"""Source: manual."""
PAGE_LIMIT = 65536
"""Most bytes of an answer. Source: netft-cpp, which takes no more."""
_VALUE_LIMIT = 128
"""Most characters of a value. Source: netft-cpp."""

FORCE_UNITS = {
    "lbf": 4.4482216152605,
    "N": 1.0,
    "klbf": 4448.2216152605,
    "kN": 1000.0,
    "kgf": 9.80665,
    "gf": 9.80665e-3,
}
"""N for one of each. Names: netft-cpp; the last one is the manual's."""
FORCE_CODES = ("lbf", "N", "klbf", "kN", "kgf", "gf")
TORQUE_CODES = ("lbf-in", "lbf-ft", "N-m", "N-mm", "kgf-cm", "kN-m")
"""Units by their code, from 1 on, for a page without their names. Source: manual."""
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
"""N·m for one of each. Names: netft-cpp."""
FILTERS_HZ = (0.0, 838.0, 326.0, 152.0, 73.0, 35.0, 18.0, 8.0, 5.0, 1500.0, 2000.0, 2500.0, 3000.0)
"""Cut-off of each filter by its number, `setuserfilter`; 0 is no filter. Source: ROS driver net_ft_driver.

Assumed: one pole each; the shape is published nowhere.
"""


@dataclass(frozen=True, slots=True)
class Configuration:
    """Facts of a Net F/T from its page."""

    product: str
    scales: Wrench
    """N or N·m for one count."""
    ratings: Wrench | None
    """Calibrated range, N and N·m; None where the page tells none that can be read."""
    streams: bool
    """Whether RDT is switched on."""
    period: float | None
    """Between two records, s; None where the page does not tell the rate."""
    delay: float
    """Delay of its filter at low frequencies, s."""
    internal_rate_hz: float | None
    """Internal samples a second; None where the page does not tell them."""


def filter_weight(cutoff_hz: float) -> float:
    """Weight of a new sample in a filter of one pole at the internal rate; 1 without a filter. Mark: assumed."""
    return 1.0 if not cutoff_hz else 1.0 - math.exp(-2.0 * math.pi * cutoff_hz / INTERNAL_RATE_HZ)


def filter_delay(number: int) -> float:
    """Delay of a filter at low frequencies, s; 0 for a number that is none. Mark: assumed."""
    weight = filter_weight(FILTERS_HZ[number] if 0 <= number < len(FILTERS_HZ) else 0.0)
    return (1.0 - weight) / weight / INTERNAL_RATE_HZ


def parse_page(page: bytes) -> Configuration:
    """Parse a configuration page. Raises RemoteProtocolError, in one line, for an invalid page or impossible values."""
    if len(page) > PAGE_LIMIT:
        raise RemoteProtocolError(f"the page has more than {PAGE_LIMIT} bytes")
    text = page.decode("ascii", "replace")
    if "<!DOCTYPE" in text.upper() or "<netft" not in text:
        raise RemoteProtocolError("the page is not one of a Net F/T")
    force = _unit(text, "cfgfu", FORCE_UNITS, FORCE_CODES)
    torque = _unit(text, "cfgtu", TORQUE_UNITS, TORQUE_CODES)
    per_force, per_torque = (_number(_needed(text, name), name) for name in ("cfgcpf", "cfgcpt"))
    units: Wrench = (force, force, force, torque, torque, torque)
    scales: Wrench = (*(force / per_force,) * 3, *(torque / per_torque,) * 3)
    rate, number = _value(text, "comrdtrate"), _value(text, "setuserfilter")
    told = _value(text, "runrate") or _value(text, "setrate")
    internal = _number(told, "runrate") if told else None
    return Configuration(
        " ".join((_needed(text, "prodname"), _value(text, "cfgnam") or "")).strip(),
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
    """Text of a tag that is there once; None for one that is not there. Raises RemoteProtocolError for two of it."""
    found = re.findall(rf"<{name}>([^<]*)</{name}>", text)
    if len(found) > 1:
        raise RemoteProtocolError(f"the page tells {name} {len(found)} times")
    if not found:
        return None
    value = str(found[0]).strip()
    if len(value) > _VALUE_LIMIT or not value.isprintable():
        raise RemoteProtocolError(f"the page tells {name} as something that is no value")
    return value


def _needed(text: str, name: str) -> str:
    value = _value(text, name)
    if not value:
        raise RemoteProtocolError(f"the page does not tell {name}")
    return value


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1e-9 < value < 1e15:
        raise RemoteProtocolError(f"the page tells {name} as {text!r}, and that is not a number above 0")
    return value


def _unit(text: str, code_tag: str, units: dict[str, float], codes: tuple[str, ...]) -> float:
    """Return the unit that a page gives by name, in the tag `s…`, or only by its code."""
    unit, code = _value(text, f"s{code_tag}"), _value(text, code_tag)
    if not unit and code:
        unit = codes[int(code) - 1] if code in tuple("123456") else f"of code {code}"
    if not unit:
        raise RemoteProtocolError(f"the page does not tell s{code_tag}")
    if unit not in units:
        raise RemoteProtocolError(f"the page tells the unit {unit!r}; known: {', '.join(units)}")
    return units[unit]


def _ratings(text: str, units: Wrench) -> Wrench | None:
    """Full scales, with semicolons, commas or blanks between; None where they cannot be read."""
    try:
        found = [_number(part, "cfgmr") for part in re.split(r"[;,\s]+", _needed(text, "cfgmr").strip(";, "))]
    except RemoteProtocolError:
        return None
    if len(found) != len(units):
        return None
    fx, fy, fz, tx, ty, tz = (a * b for a, b in zip(found, units, strict=True))
    return fx, fy, fz, tx, ty, tz
