"""The steps of a program as an operator reads them: each one once, with its way, force, time and passes."""

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.leg import Leg, Row
from hil_bridge.control.program.legs import seconds
from hil_bridge.control.steps.repeat import Repeat
from hil_bridge.control.steps.seam import Step

HEAD = ("step", "word", "way mm", "force N", "orientation", "time s", "passes", "more")
_RIGHT = {2, 5}
"""Columns of numbers."""
_MORE_WIDTH = 56
"""Chosen: letters of the last column in a line."""


@dataclass(frozen=True, slots=True)
class Shown:
    """One step as it is in its first pass."""

    number: str
    """As an operator counts; "4.2" for the second step of a repeat."""
    leg: Leg
    begin: Place | None
    """Where it begins in the work frame, mm; None where that is known in the run alone."""
    seconds: float
    """Time of one pass, s; of the longest one where they differ."""
    passes: int
    """Passes, at most."""
    ends: str = ""
    """Condition that ends a repeat before all passes, at its first step."""
    again: Place | None = None
    """Where it begins in the passes behind the first, mm; None if there are none, or where that is not known."""

    @property
    def word(self) -> str:
        """Word of the step."""
        return self.leg.step.do

    @property
    def presses(self) -> bool:
        """Whether the tool presses with the wanted force in the step."""
        return self.leg.step.controls


def list_steps(steps: Sequence[Step], row: Row) -> list[Shown]:
    """The steps of a program, those of a repeat once."""
    times = seconds(row)

    found, leg = [], 0
    for number, step in enumerate(steps, 1):
        if not isinstance(step, Repeat):
            found.append(Shown(str(number), row.legs[leg], row.places[leg], times[leg], 1))
            leg += 1
            continue
        removed = step.until_removed_mm
        ends = "" if removed is None else f"until {removed:g} mm are removed"
        inner = len(step.step)
        behind = leg + step.times * inner
        found += [
            Shown(
                f"{number}.{k - leg + 1}",
                row.legs[k],
                row.places[k],
                max(times[k:behind:inner]),
                step.times,
                ends if k == leg else "",
                row.places[k + inner] if step.times > 1 else None,
            )
            for k in range(leg, leg + inner)
        ]
        leg = behind
    return found


def table_lines(steps: Sequence[Shown]) -> Iterator[str]:
    """The table of the steps in lines of text; what is long in the last column continues in the next line."""
    rows = [HEAD, *(_cells(step) for step in steps)]
    *widths, _ = [max(len(row[column]) for row in rows) for column in range(len(HEAD))]
    for row in rows:
        *cells, more = row
        cells = [
            cell.rjust(width) if column in _RIGHT else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ]
        first, *others = textwrap.wrap(more, _MORE_WIDTH) or [""]
        yield "  ".join([*cells, first]).rstrip()
        for text in others:
            yield "  ".join([*(" " * width for width in widths), text])


def total_line(steps: Sequence[Shown], row: Row) -> str:
    """The time of the whole program in words."""
    most = " at most, with all passes" if any(step.passes > 1 for step in steps) else ""
    return f"about {duration(sum(seconds(row)))}{most}"


def duration(seconds: float) -> str:
    """A time in words."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"


def way_mm(step: Shown) -> float | None:
    """Length of the step's way across the approach, mm; None where it has none, or where it is not known."""
    if step.leg.way is not None:
        return step.leg.way.length * 1e3
    goal = step.leg.step.goal_mm
    if goal is None:
        return None
    begins = [begin for begin in (step.begin, step.again) if begin is not None]
    return max((math.dist(begin, goal) for begin in begins), default=None)


def force_text(step: Shown) -> str:
    """The wanted force in words; empty for a step that does not press."""
    if not step.presses:
        return ""
    forces = [newton for _, newton in step.leg.profile]
    low, high = min(forces), max(forces)
    return f"{low:g}" if low == high else f"{low:g} … {high:g}"


def _cells(step: Shown) -> tuple[str, ...]:
    way = way_mm(step)
    return (
        step.number,
        step.word,
        "" if way is None else f"{way:.1f}",
        force_text(step),
        step.leg.step.orientation if step.presses else "",
        f"{step.seconds:.1f}",
        "" if step.passes == 1 else f"{step.passes}",
        ", ".join(_more(step)),
    )


def _more(step: Shown) -> Iterator[str]:
    """Further settings, for which there is no column."""
    own = step.leg.step
    yield from own.describe(step.leg.stroke.parameters)
    if own.name:
        yield f'named "{own.name}"'
    if own.criterion is not None:
        yield f"within ±{own.criterion.within_n:g} N for {own.criterion.for_percent:g} %"
    own_limits = [key for key in own.limits.__slots__ if getattr(own.limits, key) is not None]
    yield from (f"{key} {getattr(own.limits, key):g}" for key in own_limits)
    if step.ends:
        yield f"passes {step.ends}"
