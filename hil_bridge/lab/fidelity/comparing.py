"""Comparison of a measured table with the table of an emulated device: figures of each quantity, and their
difference.

Each output is judged against its own input: the measured output against the measured input, and the emulated output
against the emulated input. A setpoint that the devices report differently therefore does not count as a lag of the
arm.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity import measures
from hil_bridge.lab.fidelity.measures import Floats, Gaps
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.units import FAMILIES, unit_of

SLOW_HZ = 20.0
"""Frequency below which variance counts as slow, Hz. Chosen: recorded arm vibrations have 9 to 16 Hz."""

INTEGRAL = "∫"
"""Prefix of the name of an input whose integral the output follows."""


class Pair(NamedTuple):
    """Families of an input, and of the output that follows it."""

    source: str
    output: str
    integrated: bool = False
    """Whether the output follows the integral of the input, which is then a speed."""
    free: int = 0
    """Number of free parameters, as in `measures.shift_of`."""


ROBOT_PAIRS = (
    Pair("order_q", "q"),
    Pair("order_position", "position"),
    Pair("target_q", "q"),
    Pair("target_qd", "qd"),
    Pair("target_qd", "q", integrated=True, free=2),
    Pair("target_position", "position"),
)
ROBOT_FREE = ("q", "qd", "position", "force", "moment")
"""Families of a robot's outputs. Only the noise is compared for an output that follows no input of the recording."""


class Figures(Struct, frozen=True):
    """Figures of one output. NaN marks a figure that cannot be determined from the samples."""

    lag_s: float
    """Lag of the output behind its input, s."""
    lag_spread_s: float
    """Standard deviation of the lags of the parts of the recording, s."""
    rest_rms: float
    """Root mean square of the residual: output minus input, after the input is shifted by the lag. NaN without an
    input.
    """
    noise: float
    """Standard deviation of the successive differences of the residual, divided by √2. Without an input, the
    differences of the output are used.
    """
    slow_share: float
    """Share of the residual's variance below `Comparison.slow_hz`. Without an input, the variance of the output is
    used.
    """
    grid: float
    """Quantisation step of the output."""


class Line(Struct, frozen=True):
    """Comparison of one quantity."""

    output: str
    source: str
    """Name of the input; empty if the output has none."""
    unit: str
    measured: Figures
    emulated: Figures
    apart_s: float
    """Lag of the emulated output behind the measured one, s; NaN if it cannot be determined."""
    apart_rms: float
    """Root mean square of the difference between the emulated and the measured output, after the shift by `apart_s`
    and without a constant offset. NaN without an input.

    For a contact, the difference is neither shifted nor freed from the offset.
    """


class Law(Struct, frozen=True):
    """Figure of a contact law."""

    name: str
    unit: str
    measured: float
    emulated: float


class Comparison(Struct, frozen=True):
    """Comparison of a recording with the emulated device."""

    kind: str
    """Kind of the emulated device."""
    samples: int
    """Number of samples of the recording."""
    seconds: float
    """Duration of the recording, s."""
    slow_hz: float
    measured_gaps: Gaps
    emulated_gaps: Gaps
    lines: tuple[Line, ...]
    laws: tuple[Law, ...] = ()
    left_out: tuple[str, ...] = ()
    """Families that could not be compared, as text."""


class Sides(NamedTuple):
    """Measured and emulated table, which are compared."""

    kind: str
    """Kind of the emulated device."""
    measured: Table
    emulated: Table

    @property
    def tables(self) -> tuple[Table, Table]:
        """Measured and emulated table."""
        return self.measured, self.emulated

    def have(self, *names: str) -> bool:
        """Return whether both tables have all these columns."""
        return all(name in table.columns for name in names for table in self.tables)


def compare_robot(sides: Sides) -> Comparison:
    """Compare all robot quantities that both tables have. Raises ConfigError if there is none."""
    lines, done = [], set[tuple[str, str]]()
    for pair in ROBOT_PAIRS:
        if pair.integrated and (pair.output, pair.source[:-1]) in done:
            continue  # already compared directly
        for source, output in zip(FAMILIES[pair.source], FAMILIES[pair.output], strict=True):
            if sides.have(source, output):
                lines.append(followed_line(sides, source, output, pair.free, pair.integrated))
                done.add((pair.output, pair.source))
    followed = {line.output for line in lines}
    for family in ROBOT_FREE:
        lines += [
            free_line(sides, output)
            for output in FAMILIES[family]
            if sides.have(output) and output not in followed
        ]
    missing = [
        family for family in FAMILIES if sides.measured.family(family) and not sides.emulated.family(family)
    ]
    if not lines:
        raise ConfigError(
            f"nothing to compare: the emulated {sides.kind} does not report {', '.join(missing)}"
        )
    notes = tuple(f"{family}: the emulated {sides.kind} does not report it" for family in missing)
    return make_comparison(sides, lines, left_out=notes)


def make_comparison(
    sides: Sides, lines: Sequence[Line], laws: tuple[Law, ...] = (), left_out: tuple[str, ...] = ()
) -> Comparison:
    """Build a comparison from the compared quantities."""
    measured, emulated = (measures.gaps_of(table.times) for table in sides.tables)
    times = sides.measured.times
    return Comparison(
        sides.kind,
        len(times),
        float(times[-1]),
        SLOW_HZ,
        measured,
        emulated,
        tuple(lines),
        laws,
        left_out,
    )


def free_line(sides: Sides, output: str) -> Line:
    """Compare the noise of an output that has no input."""
    measured, emulated = (
        _own_figures(table.times, table.columns[output], table.columns[output]) for table in sides.tables
    )
    return Line(output, "", unit_of(output), measured, emulated, math.nan, math.nan)


def direct_line(sides: Sides, output: str) -> Line:
    """Compare an output whose input is the same in both tables: its unshifted difference, and its noise."""
    apart = sides.emulated.columns[output] - sides.measured.columns[output]
    return replace(free_line(sides, output), apart_s=0.0, apart_rms=measures.rms(apart))


def followed_line(sides: Sides, source: str, output: str, free: int, integrated: bool = False) -> Line:
    """Compare an output that follows an input, or the integral of a speed. `free` is as in `measures.shift_of`."""
    figures = []
    for table in sides.tables:
        inputs, values = table.columns[source], table.columns[output]
        if integrated:
            inputs = measures.integral_of(table.times, inputs)
        lag = measures.shift_of(table.times, inputs, values, free)
        own = _own_figures(table.times, lag.rest, values)
        figures.append(
            replace(own, lag_s=lag.seconds, lag_spread_s=lag.spread, rest_rms=measures.rms(lag.rest))
        )
    measured, emulated = sides.tables
    nearest = np.interp(measured.times, emulated.times, emulated.columns[output])
    apart = measures.shift_of(measured.times, measured.columns[output], nearest, max(free, 1))
    label = f"{INTEGRAL}{source}" if integrated else source
    return Line(
        output, label, unit_of(output), figures[0], figures[1], apart.seconds, measures.rms(apart.rest)
    )


def _own_figures(times: Floats, rest: Floats, values: Floats) -> Figures:
    return Figures(
        math.nan,
        math.nan,
        math.nan,
        measures.noise_of(rest),
        measures.share_below(times, rest, SLOW_HZ),
        measures.grid_of(values),
    )
