"""Text of a comparison."""

import math
from collections.abc import Callable, Iterator

from hil_bridge.lab.fidelity.comparing import Comparison, Line
from hil_bridge.lab.fidelity.measures import Gaps
from hil_bridge.lab.fidelity.units import prefixed_unit
from hil_bridge.record.analysis.definition import UNKNOWN

_NOTHING = 1e-12
"""Magnitude below which a value counts as rounding, in every unit used here. Chosen."""


def describe(comparison: Comparison) -> Iterator[str]:
    """Yield the comparison line by line: a summary, then each quantity with its figures."""
    yield (
        f"{comparison.kind}: {comparison.samples} samples over {comparison.seconds:.2f} s; "
        "distance is emulated minus measured for times, else their ratio"
    )
    yield f"{'':<34}{'measured':>18}{'emulated':>18}{'distance':>14}"
    for title, rows in tables(comparison):
        yield title
        for name, measured, emulated, distance in rows:
            yield f"  {name:<32}{measured:>18}{emulated:>18}{distance:>14}"
    for text in comparison.left_out:
        yield f"not compared: {text}"


Row = tuple[str, str, str, str]
"""Row of a table: name of a figure, measured value, emulated value, and distance."""


def tables(comparison: Comparison) -> Iterator[tuple[str, list[Row]]]:
    """Yield the title and the rows of each table."""
    yield "sample intervals", list(_gap_rows(comparison.measured_gaps, comparison.emulated_gaps))
    for line in comparison.lines:
        title = f"{line.output} behind {line.source}" if line.source else line.output
        yield title, list(_rows(line, comparison.slow_hz))
    if comparison.laws:
        yield (
            "law of the contact",
            [
                (
                    law.name,
                    format_quantity(law.measured, law.unit),
                    format_quantity(law.emulated, law.unit),
                    _ratio(law.measured, law.emulated),
                )
                for law in comparison.laws
            ],
        )


def _gap_rows(measured: Gaps, emulated: Gaps) -> Iterator[Row]:
    labels = {
        "mean_s": "mean",
        "deviation_s": "standard deviation",
        "percentile_99_s": "99 % are below",
        "longest_s": "longest",
    }
    for key, name in labels.items():
        here, there = getattr(measured, key), getattr(emulated, key)
        yield name, _ms(here), _ms(there), _difference(here, there)


def _rows(line: Line, slow_hz: float) -> Iterator[Row]:
    measured, emulated, unit = line.measured, line.emulated, line.unit

    def row(name: str, here: float, there: float, format_value: Callable[[float], str]) -> Iterator[Row]:
        if not (math.isnan(here) and math.isnan(there)):
            yield name, format_value(here), format_value(there), _ratio(here, there)

    def size(value: float) -> str:
        return format_quantity(value, unit)

    if line.source:
        yield (
            "lag",
            _lag(measured.lag_s, measured.lag_spread_s),
            _lag(emulated.lag_s, emulated.lag_spread_s),
            _difference(measured.lag_s, emulated.lag_s),
        )
        yield from row("residual after the lag, rms", measured.rest_rms, emulated.rest_rms, size)
    yield from row("noise", measured.noise, emulated.noise, size)
    yield from row(f"variance below {slow_hz:g} Hz", measured.slow_share, emulated.slow_share, _percent)
    yield from row("grid", measured.grid, emulated.grid, size)
    if not math.isnan(line.apart_rms):
        apart = "" if math.isnan(line.apart_s) else _difference(0.0, line.apart_s)
        yield "emulated minus measured, rms", "", size(line.apart_rms), apart


def format_quantity(value: float, unit: str) -> str:
    """Format a number with three digits and a prefixed unit."""
    if math.isnan(value):
        return UNKNOWN
    if abs(value) < _NOTHING:
        return f"0 {unit}".rstrip()
    if abs(value) >= 1e3:
        return f"{value:.0f} {unit}".rstrip()
    if not unit:
        return f"{value:.3g}"
    size, name = prefixed_unit(abs(value), unit)
    return f"{value / size:.3g} {name}"


def _ms(seconds: float) -> str:
    return UNKNOWN if math.isnan(seconds) else f"{seconds * 1e3:.3f} ms"


def _lag(seconds: float, spread: float) -> str:
    return UNKNOWN if math.isnan(seconds) else f"{_rounded(seconds, 1)} ± {spread * 1e3:.1f} ms"


def _difference(here: float, there: float) -> str:
    change = there - here
    return UNKNOWN if math.isnan(change) else f"{_rounded(change, 1, '+')} ms"


def _rounded(seconds: float, digits: int, sign: str = "") -> str:
    """Format a time, s, as milliseconds, without a sign if it rounds to zero."""
    value = round(seconds * 1e3, digits) + 0.0
    return f"{value:{sign if value else ''}.{digits}f}"


def _percent(share: float) -> str:
    return UNKNOWN if math.isnan(share) else f"{100.0 * share:.1f} %"


def _ratio(here: float, there: float) -> str:
    if math.isnan(here) or math.isnan(there) or abs(here) < _NOTHING:
        return UNKNOWN
    return f"× {0.0 if abs(there) < _NOTHING else there / here:.3g}"
