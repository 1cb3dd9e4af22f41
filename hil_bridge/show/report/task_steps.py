"""Readable table of a program's steps. Each step appears once, with its distance, force, time and number of passes."""

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.leg import Leg, Row
from hil_bridge.control.program.legs import seconds
from hil_bridge.control.steps.repeat import Repeat
from hil_bridge.control.steps.seam import Step

HEAD = ("step", "word", "path mm", "force N", "orientation", "time s", "passes", "more")
_RIGHT = {2, 5}
"""Numeric columns, which are aligned to the right."""
_MORE_WIDTH = 56
"""Maximum number of characters per line in the last column. Chosen."""


@dataclass(frozen=True, slots=True)
class ListedStep:
    """Row of a step, with the values of its first pass."""

    number: str
    """Number of the step, from 1; "4.2" for the second step of a repeat."""
    leg: Leg
    begin: Place | None
    """Start position in the work frame, mm; None if it is known only during the run."""
    seconds: float
    """Duration of the longest pass, s."""
    passes: int
    """Largest possible number of passes."""
    ends: str = ""
    """Condition that ends a repeat early, stated at the first step of the repeat."""
    again: Place | None = None
    """Start position in later passes, mm; None if there are no later passes, or if it is unknown."""

    @property
    def word(self) -> str:
        """Keyword of the step."""
        return self.leg.step.do

    @property
    def presses(self) -> bool:
        """Whether the tool presses with the target force during the step."""
        return self.leg.step.controls


def list_steps(steps: Sequence[Step], row: Row) -> list[ListedStep]:
    """Return the steps of a program. Each step of a repeat appears once."""
    times = seconds(row)

    listed, leg = [], 0
    for number, step in enumerate(steps, 1):
        if not isinstance(step, Repeat):
            listed.append(ListedStep(str(number), row.legs[leg], row.places[leg], times[leg], 1))
            leg += 1
            continue
        removed = step.until_removed_mm
        ends = "" if removed is None else f"until {removed:g} mm are removed"
        inner = len(step.step)
        behind = leg + step.times * inner
        listed += [
            ListedStep(
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
    return listed


def table_lines(steps: Sequence[ListedStep]) -> Iterator[str]:
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


def total_line(steps: Sequence[ListedStep], row: Row) -> str:
    """Format the total duration of the program."""
    most = " at most, including all passes" if any(step.passes > 1 for step in steps) else ""
    return f"about {duration(sum(seconds(row)))}{most}"


def duration(seconds: float) -> str:
    """Format a duration."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"


def way_mm(step: ListedStep) -> float | None:
    """Return the length of the step's path perpendicular to the approach, mm.

    The result is None if there is no path, or if it is unknown.
    """
    if step.leg.way is not None:
        return step.leg.way.length * 1e3
    goal = step.leg.step.goal_mm
    if goal is None:
        return None
    begins = [begin for begin in (step.begin, step.again) if begin is not None]
    return max((math.dist(begin, goal) for begin in begins), default=None)


def force_text(step: ListedStep) -> str:
    """Format the target force; return an empty text for a step that does not press."""
    if not step.presses:
        return ""
    forces = [newton for _, newton in step.leg.profile]
    low, high = min(forces), max(forces)
    return f"{low:g}" if low == high else f"{low:g} … {high:g}"


def _cells(step: ListedStep) -> tuple[str, ...]:
    length = way_mm(step)
    return (
        step.number,
        step.word,
        "" if length is None else f"{length:.1f}",
        force_text(step),
        step.leg.step.orientation if step.presses else "",
        f"{step.seconds:.1f}",
        "" if step.passes == 1 else f"{step.passes}",
        ", ".join(_more(step)),
    )


def _more(step: ListedStep) -> Iterator[str]:
    """Format the settings that have no column of their own."""
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
