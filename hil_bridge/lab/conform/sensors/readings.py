"""Readings of a sensor's client: lines of its standard output with six numbers, and no other lines.

The numbers are fx fy fz in N and mx my mz in N·m, in the sensor's own frame, with blanks, tabs, commas or semicolons
between them. Any other line is the client's own matter. Their size is bounded.
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
"""Chosen: bytes of a line that are kept."""
READINGS_MAX = 200_000
"""Chosen: readings of a scenario that are kept, those of 7 kHz for 28 s."""
_BETWEEN = re.compile(r"[\s,;]+")


class Reading(NamedTuple):
    """A reading as it was heard."""

    at: float
    """s since the begin of the scenario."""
    wrench: Wrench


class Part(NamedTuple):
    """A time in which readings are looked at, s since the begin of the scenario."""

    begin: float
    end: float


@dataclass(slots=True)
class Heard(Ending):
    """Evidence of one scenario of a sensor. Times are seconds since its begin; six values are N and N·m."""

    readings: int = 0
    """Lines with six numbers."""
    no_numbers: int = 0
    """Lines of six words of which one is no finite number."""
    first_at: float | None = None
    """First reading."""
    last_at: float | None = None
    truth: Wrench | None = None
    """Load of the standing tool that the sensor feels."""
    at_rest: Wrench | None = None
    """Mean reading before the first load or fault."""
    loads: list[tuple[str, Wrench | None]] = field(default_factory=list)
    """Each loaded axis, with how the mean reading changed; None where there was no reading under the load."""
    fault_at: float | None = None
    behind_fault: int = 0
    """Readings while the fault held, later than `react_s` behind its begin."""
    same_behind_fault: int = 0
    """Those of them that are equal to the last one before the fault."""
    returned_at: float | None = None
    """End of a fault that ends."""
    back_at: float | None = None
    """First reading behind that."""
    at_end: Wrench | None = None
    """Mean reading behind the fault, when its begin or its end was `react_s` ago."""
    worst: Wrench | None = None
    """Reading behind the fault that is farthest from the one at rest, by its tolerance."""


class Lines:
    """Takes a client's output apart into readings."""

    def __init__(self) -> None:
        self.readings: list[Reading] = []
        self.no_numbers = 0
        self._rest = b""
        self._skips = False
        """The line that came last is too long, and its rest is left out."""

    def take(self, piece: bytes, at: float) -> None:
        """A piece of output was heard at this time, s."""
        *whole, self._rest = (self._rest + piece).split(b"\n")
        for line in whole:
            if not self._skips:
                self._read(line, at)
            self._skips = False
        if len(self._rest) > LINE_MAX:
            self._rest, self._skips = b"", True

    def during(self, part: Part) -> Sequence[Reading]:
        """Readings of a time, oldest first."""
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
    """Mean of each axis; None without readings."""
    if not readings:
        return None
    fx, fy, fz, mx, my, mz = (
        math.fsum(values) / len(readings) for values in zip(*(one.wrench for one in readings), strict=True)
    )
    return fx, fy, fz, mx, my, mz


def difference(one: Wrench, other: Wrench) -> Wrench:
    """The first less the second, axis by axis."""
    fx, fy, fz, mx, my, mz = (a - b for a, b in zip(one, other, strict=True))
    return fx, fy, fz, mx, my, mz


def units() -> Iterator[tuple[str, str]]:
    """Each axis with its unit."""
    for axis in AXES:
        yield axis, "N" if axis.startswith("f") else "N·m"
