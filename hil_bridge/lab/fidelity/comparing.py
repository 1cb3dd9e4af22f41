"""Comparison of a measured table with that of the emulated device: figures of each quantity, and their difference.

Each output is judged against its own input: the measured one against the measured input, the emulated one against the
emulated input. A setpoint that the devices report differently therefore does not count as a lag of the arm.
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
"""Chosen: frequency below which variance counts as slow. Recorded arm vibrations have 9 to 16 Hz."""

INTEGRAL = "∫"
"""Prefix of an input whose integral is followed."""


class Pair(NamedTuple):
    """Families of an input and the output that follows it."""

    source: str
    output: str
    integrated: bool = False
    """Whether the output follows the integral of the input, a speed."""
    free: int = 0
    """Free parameters, as in `measures.shift_of`."""


ROBOT_PAIRS = (
    Pair("order_q", "q"),
    Pair("order_position", "position"),
    Pair("target_q", "q"),
    Pair("target_qd", "qd"),
    Pair("target_qd", "q", integrated=True, free=2),
    Pair("target_position", "position"),
)
ROBOT_FREE = ("q", "qd", "position", "force", "moment")
"""Outputs of a robot. If an output follows no input here, only its noise is compared."""


class Figures(Struct, frozen=True):
    """Figures of one output. NaN marks a figure that cannot be determined from the samples."""

    lag_s: float
    """Lag behind the input, s."""
    lag_spread_s: float
    """Standard deviation of the lag over parts of the recording, s."""
    rest_rms: float
    """Root mean square of output minus input after that shift (the residual); NaN without an input."""
    noise: float
    """Standard deviation of successive differences of the residual, or of the output, divided by √2."""
    slow_share: float
    """Share of the residual's (or output's) variance below `Comparison.slow_hz`."""
    grid: float
    """Quantisation step of the output."""


class Line(Struct, frozen=True):
    """Comparison of one quantity."""

    output: str
    source: str
    """Its input; empty for none."""
    unit: str
    measured: Figures
    emulated: Figures
    apart_s: float
    """Lag of the emulated output behind the measured one, s; NaN if it cannot be determined."""
    apart_rms: float
    """Root mean square of their difference after that shift, without a constant; NaN without an input. For a contact,
    unshifted and with the constant.
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
    """Device kind."""
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
    """The two compared tables."""

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
            continue  # compared directly already
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
    words = tuple(f"{family}: the emulated {sides.kind} does not report it" for family in missing)
    return make_comparison(sides, lines, left_out=words)


def make_comparison(
    sides: Sides, lines: Sequence[Line], laws: tuple[Law, ...] = (), left_out: tuple[str, ...] = ()
) -> Comparison:
    """Build the comparison from these lines."""
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
    """Compare an output without an input by its noise."""
    measured, emulated = (
        _own_figures(table.times, table.columns[output], table.columns[output]) for table in sides.tables
    )
    return Line(output, "", unit_of(output), measured, emulated, math.nan, math.nan)


def direct_line(sides: Sides, output: str) -> Line:
    """Compare an output with the same input in both tables: its unshifted difference, and its noise."""
    apart = sides.emulated.columns[output] - sides.measured.columns[output]
    return replace(free_line(sides, output), apart_s=0.0, apart_rms=measures.rms(apart))


def followed_line(sides: Sides, source: str, output: str, free: int, integrated: bool = False) -> Line:
    """Compare an output that follows an input, or the integral of an input speed; `free` as in `shift_of`."""
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
