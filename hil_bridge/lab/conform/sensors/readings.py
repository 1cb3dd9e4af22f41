"""Readings of a sensor client: the lines of its standard output that consist of six numbers.

The numbers are fx fy fz in N and mx my mz in N·m, in the sensor's frame, separated by blanks, tabs, commas or
semicolons. All other lines are ignored. Their size is bounded.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from hil_bridge.lab.conform.ending import Ending
from protocol.geometry import Wrench
from protocol.wrench import AXES

LINE_MAX = 4096
"""Chosen: longest line, bytes."""
READINGS_MAX = 200_000
"""Chosen: most readings kept in a scenario, 28 s at 7 kHz."""
_BETWEEN = re.compile(r"[\s,;]+")


class Reading(NamedTuple):
    """Received reading."""

    at: float
    """Time since the start of the scenario, s."""
    wrench: Wrench


class Part(NamedTuple):
    """Time interval, s since the start of the scenario."""

    begin: float
    end: float


@dataclass(slots=True)
class SensorEvidence(Ending):
    """Evidence of one scenario of a sensor. Times are seconds since its start; wrenches in N and N·m."""

    readings: int = 0
    """Lines with six numbers."""
    no_numbers: int = 0
    """Lines of six numbers of which one is not finite."""
    first_at: float | None = None
    """Time of the first reading."""
    last_at: float | None = None
    truth: Wrench | None = None
    """True load of the stationary tool on the sensor."""
    at_rest: Wrench | None = None
    """Mean reading before the first load or fault."""
    loads: list[tuple[str, Wrench | None]] = field(default_factory=list)
    """Each loaded axis, with the change of the mean reading; None if there was no reading under the load."""
    fault_at: float | None = None
    behind_fault: int = 0
    """Number of readings during the fault, later than `react_s` after its start."""
    same_behind_fault: int = 0
    """Number of those equal to the last one before the fault."""
    returned_at: float | None = None
    """End of a temporary fault."""
    back_at: float | None = None
    """Time of the first reading after that."""
    at_end: Wrench | None = None
    """Mean reading from `react_s` after the return on."""
    worst: Wrench | None = None
    """Reading during the fault with the largest deviation from the unloaded one, in tolerances."""


class Lines:
    """Parser of a client's output."""

    def __init__(self) -> None:
        self.readings: list[Reading] = []
        self.no_numbers = 0
        self._rest = b""
        self._skips = False
        """Whether the rest of an overlong line is being skipped."""

    def take(self, piece: bytes, at: float) -> None:
        """Parse a piece of output received at `at`, s."""
        *lines, self._rest = (self._rest + piece).split(b"\n")
        for line in lines:
            if not self._skips:
                self._read(line, at)
            self._skips = False
        if len(self._rest) > LINE_MAX:
            self._rest, self._skips = b"", True

    def during(self, part: Part) -> Sequence[Reading]:
        """Return the readings of an interval, oldest first."""
        return [reading for reading in self.readings if part.begin <= reading.at < part.end]

    def _read(self, line: bytes, at: float) -> None:
        words = _BETWEEN.split(line.decode("utf-8", "replace").strip(" \t\r,;"))
        if len(words) != len(AXES):
            return
        try:
            fx, fy, fz, mx, my, mz = map(float, words)
        except ValueError:
            return
        if not math.isfinite(fx + fy + fz + mx + my + mz):
            self.no_numbers += 1
        elif len(self.readings) < READINGS_MAX:
            self.readings.append(Reading(at, (fx, fy, fz, mx, my, mz)))


def mean_of(readings: Sequence[Reading]) -> Wrench | None:
    """Return the mean of each axis; None without readings."""
    if not readings:
        return None
    fx, fy, fz, mx, my, mz = (
        math.fsum(values) / len(readings) for values in zip(*(one.wrench for one in readings), strict=True)
    )
    return fx, fy, fz, mx, my, mz


def difference(one: Wrench, other: Wrench) -> Wrench:
    """Return the first wrench minus the second."""
    fx, fy, fz, mx, my, mz = (a - b for a, b in zip(one, other, strict=True))
    return fx, fy, fz, mx, my, mz


def units() -> Iterator[tuple[str, str]]:
    """Yield each axis with its unit."""
    for axis in AXES:
        yield axis, "N" if axis.startswith("f") else "N·m"
