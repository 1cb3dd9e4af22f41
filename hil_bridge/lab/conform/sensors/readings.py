"""Readings of a sensor client: the lines of its standard output that consist of six numbers.

The numbers are fx fy fz in N and mx my mz in N·m, in the sensor's frame, separated by blanks, tabs, commas or
semicolons. All other lines are ignored. The length of a line and the number of readings are bounded.
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
"""Maximum length of a line, bytes. Chosen."""
READINGS_MAX = 200_000
"""Maximum number of readings kept in a scenario. Chosen: 28 s at 7 kHz."""
_BETWEEN = re.compile(r"[\s,;]+")


class Reading(NamedTuple):
    """Wrench that the client reported, with the time at which it was received."""

    at: float
    """Time since the start of the scenario, s."""
    wrench: Wrench


class Part(NamedTuple):
    """Time interval with its beginning and end, s since the start of the scenario."""

    begin: float
    end: float


@dataclass(slots=True)
class SensorEvidence(Ending):
    """Evidence of one scenario with a sensor. Times are in s since the start of the scenario, wrenches in N and N·m."""

    readings: int = 0
    """Number of readings: lines with six finite numbers."""
    no_numbers: int = 0
    """Number of lines with six numbers that are not all finite."""
    first_at: float | None = None
    """Time of the first reading."""
    last_at: float | None = None
    truth: Wrench | None = None
    """True load of the stationary tool on the sensor."""
    at_rest: Wrench | None = None
    """Mean of the readings before the first load or fault."""
    loads: list[tuple[str, Wrench | None]] = field(default_factory=list)
    """Each loaded axis, and the change of the mean reading under the load; None if there was no reading under the
    load.
    """
    loaded_at: list[float] = field(default_factory=list)
    """Time of each load."""
    fault_at: float | None = None
    last_before_fault_at: float | None = None
    """Time of the last reading before the fault."""
    behind_fault: int = 0
    """Number of readings during the fault, later than `react_s` after its start."""
    behind_at: float | None = None
    """Time of the first of these readings."""
    same_behind_fault: int = 0
    """Number of these readings that are equal to the last reading before the fault."""
    returned_at: float | None = None
    """Time at which a temporary fault ended."""
    back_at: float | None = None
    """Time of the first reading after the fault ended."""
    at_end: Wrench | None = None
    """Mean of the readings later than `react_s` after the first reading that followed the fault."""
    worst: Wrench | None = None
    """Reading during the fault that deviates most from the unloaded reading, in tolerances."""
    worst_at: float | None = None


class Lines:
    """Parser that extracts readings from a client's output."""

    def __init__(self) -> None:
        self.readings: list[Reading] = []
        self.no_numbers = 0
        self._rest = b""
        self._skips = False
        """Whether the rest of an overlong line is being skipped."""

    def take(self, piece: bytes, at: float) -> None:
        """Parse a piece of output that was received at the time `at`, s."""
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
        parts = _BETWEEN.split(line.decode("utf-8", "replace").strip(" \t\r,;"))
        if len(parts) != len(AXES):
            return
        try:
            fx, fy, fz, mx, my, mz = map(float, parts)
        except ValueError:
            return
        if not math.isfinite(fx + fy + fz + mx + my + mz):
            self.no_numbers += 1
        elif len(self.readings) < READINGS_MAX:
            self.readings.append(Reading(at, (fx, fy, fz, mx, my, mz)))


def mean_of(readings: Sequence[Reading]) -> Wrench | None:
    """Return the mean of each axis; None if there are no readings."""
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
    """Yield the name and the unit of each axis."""
    for axis in AXES:
        yield axis, "N" if axis.startswith("f") else "N·m"
