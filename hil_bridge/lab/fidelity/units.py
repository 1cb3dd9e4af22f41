"""Quantities of a table by family, and their units in mappings and headers."""

import math
import re
from collections.abc import Mapping

from hil_bridge.devices.trajectory import FAMILIES as OF_ROBOTS

ROTATION = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
FAMILIES: Mapping[str, tuple[str, ...]] = {
    **OF_ROBOTS,
    "rotation": ROTATION,
    "depth": ("depth",),
    "press": ("press",),
}
"""Quantities by family: the families of robots, and three more.

`rotation` is the rotation of the sensor in the base frame, row by row. `depth` is the depth of a tip below its
reference, m. `press` is the contact force on the tip, N.
"""
WRENCH = (*FAMILIES["force"], *FAMILIES["moment"])
"""Columns of a wrench, in order."""
LBF = 4.4482216152605
"""One pound-force, N; exact. Source: NIST SP 811 (2008), appendix B.8."""
KGF = 9.80665
"""One kilogram-force, N; exact. Source: NIST SP 811 (2008), appendix B.8."""
INCH, FOOT = 0.0254, 0.3048
"""One inch and one foot, m; exact. Source: NIST SP 811 (2008), appendix B.8."""
_ANGLE = {"rad": 1.0, "mrad": 1e-3, "µrad": 1e-6, "deg": math.pi / 180.0, "°": math.pi / 180.0}
_SPEED = {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180.0, "°/s": math.pi / 180.0}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "in": INCH}
_FORCE = {"N": 1.0, "µN": 1e-6, "mN": 1e-3, "kN": 1e3, "lbf": LBF, "ozf": LBF / 16.0, "kgf": KGF}
_MOMENT = {
    "N·m": 1.0,
    "µN·m": 1e-6,
    "mN·m": 1e-3,
    "kN·m": 1e3,
    "N·cm": 1e-2,
    "N·mm": 1e-3,
    "lbf·in": LBF * INCH,
    "lbf·ft": LBF * FOOT,
    "ozf·in": LBF / 16.0 * INCH,
    "kgf·m": KGF,
    "kgf·cm": KGF * 1e-2,
}
TIME: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_NUMBER = {"1": 1.0}
UNITS: Mapping[str, Mapping[str, float]] = {
    **dict.fromkeys(("order_q", "target_q", "q"), _ANGLE),
    **dict.fromkeys(("order_qd", "target_qd", "qd"), _SPEED),
    **dict.fromkeys(("order_position", "target_position", "position", "depth"), _LENGTH),
    **dict.fromkeys(("force", "press"), _FORCE),
    "moment": _MOMENT,
    "rotation": _NUMBER,
}
"""Units of each family, with their sizes in its base unit, which is the first."""
COUNTS = ("counts", "count", "raw", "digits", "lsb")
"""Units whose size is known only from the calibration of a sensor."""
_KNOWN = {unit for units in (*UNITS.values(), TIME) for unit in units if unit != "1"} | {*COUNTS}
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_PREFIXED = ("s", "rad", "m", "N", "N·m")
_BRACKETS = re.compile(r"(.+?)\s*(?:\[([^\[\]]+)\]|\(([^()]+)\))")
_JOINED = re.compile(r"([µmk]?N)([cm]?m)")
_TIMES_SIGNS = re.compile(r"\s*[*⋅·.-]\s*|\s+")


def unit_of(column: str) -> str:
    """Return the unit of a quantity; empty for a dimensionless number."""
    family = next(name for name, parts in FAMILIES.items() if column in parts)
    unit = next(iter(UNITS[family]))
    return "" if unit == "1" else unit


def plain_unit(text: str) -> str:
    """Normalise a unit to its spelling in `UNITS`.

    `uN` becomes `µN`; `Nm`, `N*m`, `N-m` and `N m` become `N·m`; `in-lbf` becomes `lbf·in`.
    """
    text = _TIMES_SIGNS.sub("·", text.strip()).replace("μ", "µ")  # the Greek letter
    if text.casefold() in COUNTS:
        return text.casefold()
    text = f"µ{text[1:]}" if text.startswith("u") else text
    if joined := _JOINED.fullmatch(text):
        return "·".join(joined.groups())
    first, _, second = text.partition("·")
    return f"{second}·{first}" if first in ("in", "ft") and second else text


def prefixed_unit(largest: float, unit: str) -> tuple[float, str]:
    """Return the size and the name of the unit in which values up to `largest` are displayed.

    Small values get a prefix if the unit allows one.
    """
    if unit.partition("/")[0] not in _PREFIXED:
        return 1.0, unit
    size, prefix = next((pair for pair in _PREFIXES if largest >= pair[0]), _PREFIXES[-1])
    return size, f"{prefix}{unit}"


def is_unit(unit: str) -> bool:
    """Return whether the text is a unit of any quantity, or of counts, in the spelling of `plain_unit`."""
    return unit in _KNOWN


def split_heading(heading: str) -> tuple[str, str, bool]:
    """Split a heading such as `fx [lbf]`, `Fx (N)` or `force_z_uN` into name and unit.

    Also returns whether the unit is in brackets. An unknown unit is returned as an empty text.
    """
    if brackets := _BRACKETS.fullmatch(heading):
        unit = plain_unit(brackets[2] or brackets[3])
        return brackets[1], unit if unit in _KNOWN else "", True
    unit = plain_unit(heading.rpartition("_")[2]) if "_" in heading else ""
    return heading, unit if unit in _KNOWN else "", False
