"""Readable table of a program's steps: each one once, with its distance, force, time and passes."""

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
"""Numeric columns."""
_MORE_WIDTH = 56
"""Most characters of the last column in a line. Chosen."""


@dataclass(frozen=True, slots=True)
class Shown:
    """Step in its first pass."""

    number: str
    """Number from 1; "4.2" for the second step of a repeat."""
    leg: Leg
    begin: Place | None
    """Start in the work frame, mm; None if known only in the run."""
    seconds: float
    """Time of the longest pass, s."""
    passes: int
    """Most passes."""
    ends: str = ""
    """Condition that ends a repeat early, at its first step."""
    again: Place | None = None
    """Start in later passes, mm; None if there are none, or if it is unknown."""

    @property
    def word(self) -> str:
        """Keyword of the step."""
        return self.leg.step.do

    @property
    def presses(self) -> bool:
        """Return whether the tool presses with the target force in the step."""
        return self.leg.step.controls


def list_steps(steps: Sequence[Step], row: Row) -> list[Shown]:
    """Return the steps of a program, those of a repeat once."""
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
    """Format the table of the steps as text lines; a long last column wraps."""
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
    """Format the total time of the program."""
    most = " at most, with all passes" if any(step.passes > 1 for step in steps) else ""
    return f"about {duration(sum(seconds(row)))}{most}"


def duration(seconds: float) -> str:
    """Format a time."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"


def way_mm(step: Shown) -> float | None:
    """Return the length of the step's path across the approach, mm; None if it has none, or if it is unknown."""
    if step.leg.way is not None:
        return step.leg.way.length * 1e3
    goal = step.leg.step.goal_mm
    if goal is None:
        return None
    begins = [begin for begin in (step.begin, step.again) if begin is not None]
    return max((math.dist(begin, goal) for begin in begins), default=None)


def force_text(step: Shown) -> str:
    """Format the target force; empty for a step that does not press."""
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
    """Format the settings that have no column."""
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
