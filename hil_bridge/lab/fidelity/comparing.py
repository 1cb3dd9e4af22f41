"""A measured table against that of the emulated device: figures of each quantity for both, and how far they are apart.

An output is judged behind its own input: the measured one behind the measured input, the emulated one behind the
emulated input. So a set point that the devices tell differently does not count as a lag of the arm.
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
"""Chosen: below it variance counts as slow. Vibrations of an arm that were recorded have 9 to 16 Hz."""

INTEGRAL = "∫"
"""Stands before an input whose way is followed."""


class Pair(NamedTuple):
    """Families of an input and of the output that follows it."""

    source: str
    output: str
    integrated: bool = False
    """The output is the way that the input makes as a speed."""
    free: int = 0
    """As of `measures.shift_of`."""


ROBOT_PAIRS = (
    Pair("order_q", "q"),
    Pair("order_position", "position"),
    Pair("target_q", "q"),
    Pair("target_qd", "qd"),
    Pair("target_qd", "q", integrated=True, free=2),
    Pair("target_position", "position"),
)
ROBOT_FREE = ("q", "qd", "position", "force", "moment")
"""Outputs of a robot. Of those that follow no input here, the noise alone is compared."""


class Figures(Struct, frozen=True):
    """Figures of one output. NaN stands for one that the samples do not tell."""

    lag_s: float
    """Lag behind the input, s."""
    lag_spread_s: float
    """Standard deviation of the lag over parts of the recording, s."""
    rest_rms: float
    """Root mean square of output less input, after that shift; of an output without an input, NaN."""
    noise: float
    """Of that rest, or of the output: standard deviation of successive differences, divided by √2."""
    slow_share: float
    """Share of the variance of the same below `Comparison.slow_hz`."""
    grid: float
    """Step on which the output lies."""


class Line(Struct, frozen=True):
    """One quantity."""

    output: str
    source: str
    """Its input; empty without one."""
    unit: str
    measured: Figures
    emulated: Figures
    apart_s: float
    """Lag of the emulated output behind the measured one, s; NaN where none is told."""
    apart_rms: float
    """Root mean square of their difference after that shift, a constant taken off; NaN without an input. Of a contact:
    without a shift, and with the constant.
    """


class Law(Struct, frozen=True):
    """A figure of a contact."""

    name: str
    unit: str
    measured: float
    emulated: float


class Comparison(Struct, frozen=True):
    """A recording against the emulated device."""

    kind: str
    """Name of the kind."""
    samples: int
    """Of the recording."""
    seconds: float
    """Length of the recording, s."""
    slow_hz: float
    measured_gaps: Gaps
    emulated_gaps: Gaps
    lines: tuple[Line, ...]
    laws: tuple[Law, ...] = ()
    left_out: tuple[str, ...] = ()
    """Families that could not be compared, in words."""


class Sides(NamedTuple):
    """The two tables that are compared."""

    kind: str
    """Name of the kind of the emulated device."""
    measured: Table
    emulated: Table

    @property
    def tables(self) -> tuple[Table, Table]:
        """Measured, then emulated."""
        return self.measured, self.emulated

    def tell(self, *names: str) -> bool:
        """Whether both tables tell all these columns."""
        return all(name in table.columns for name in names for table in self.tables)


def compare_robot(sides: Sides) -> Comparison:
    """All quantities of a robot that both tables tell. Raises ConfigError where there is none."""
    lines, done = [], set[tuple[str, str]]()
    for pair in ROBOT_PAIRS:
        if pair.integrated and (pair.output, pair.source[:-1]) in done:
            continue  # the places themselves are there
        for source, output in zip(FAMILIES[pair.source], FAMILIES[pair.output], strict=True):
            if sides.tell(source, output):
                lines.append(followed_line(sides, source, output, pair.free, pair.integrated))
                done.add((pair.output, pair.source))
    followed = {line.output for line in lines}
    for family in ROBOT_FREE:
        lines += [
            free_line(sides, output)
            for output in FAMILIES[family]
            if sides.tell(output) and output not in followed
        ]
    missing = [
        family for family in FAMILIES if sides.measured.family(family) and not sides.emulated.family(family)
    ]
    if not lines:
        raise ConfigError(
            f"nothing is left to compare: the emulated {sides.kind} does not tell {', '.join(missing)}"
        )
    words = tuple(f"{family}: the emulated {sides.kind} does not tell it" for family in missing)
    return joined(sides, lines, left_out=words)


def joined(
    sides: Sides, lines: Sequence[Line], laws: tuple[Law, ...] = (), left_out: tuple[str, ...] = ()
) -> Comparison:
    """The comparison with these lines."""
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
    """An output without an input: its own noise."""
    measured, emulated = (
        _own_figures(table.times, table.columns[output], table.columns[output]) for table in sides.tables
    )
    return Line(output, "", unit_of(output), measured, emulated, math.nan, math.nan)


def direct_line(sides: Sides, output: str) -> Line:
    """An output whose input is the same in both, sample by sample: its difference without a shift, and noises."""
    apart = sides.emulated.columns[output] - sides.measured.columns[output]
    return replace(free_line(sides, output), apart_s=0.0, apart_rms=measures.rms(apart))


def followed_line(sides: Sides, source: str, output: str, free: int, integrated: bool = False) -> Line:
    """An output behind an input, or behind the way that the input makes as a speed; `free` as of `shift_of`."""
    figures = []
    for table in sides.tables:
        given, values = table.columns[source], table.columns[output]
        if integrated:
            given = measures.integral_of(table.times, given)
        lag = measures.shift_of(table.times, given, values, free)
        own = _own_figures(table.times, lag.rest, values)
        figures.append(
            replace(own, lag_s=lag.seconds, lag_spread_s=lag.spread, rest_rms=measures.rms(lag.rest))
        )
    measured, emulated = sides.tables
    nearest = np.interp(measured.times, emulated.times, emulated.columns[output])
    apart = measures.shift_of(measured.times, measured.columns[output], nearest, max(free, 1))
    words = f"{INTEGRAL}{source}" if integrated else source
    return Line(
        output, words, unit_of(output), figures[0], figures[1], apart.seconds, measures.rms(apart.rest)
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
