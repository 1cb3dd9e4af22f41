"""The borders of a program's steps in a picture over time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hil_bridge.recording.records import CycleRecord, StepRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_NAMED_SHARE = 0.035
"""Chosen: a step that is shorter than this share of the run gets no name in a picture."""
_LETTER_SHARE = 0.0062
"""Chosen: share of the width of a picture that a letter of a name takes."""
_MARKED = 200
"""Chosen: with more steps than this their borders would cover the curves."""


def has_program(cycles: Sequence[CycleRecord]) -> bool:
    """Whether a run had steps."""
    return any(cycle.step for cycle in cycles)


def mark_steps(ax: "Axes", steps: Sequence[StepRecord], zero: float, named: bool) -> None:
    """A line at each border of steps, and between them the steps' names where they fit. `zero` is the start of the
    times, s on the run's clock.
    """
    if len(steps) > _MARKED or not steps:
        return
    whole = max(steps[-1].at - zero, 1e-9)
    for step in steps:
        begin, end = step.began_at - zero, step.at - zero
        ax.axvline(begin, color="#909090", lw=0.7, ls=":", zorder=1.2)
        share = (end - begin) / whole
        number, word = step.label.split(" ", 1)
        word = word.strip("()").split(",")[0]
        name = f"{number} {word}"
        if share < len(name) * _LETTER_SHARE:
            name = number
        if named and share >= max(_NAMED_SHARE if name != number else 0.0, len(name) * _LETTER_SHARE):
            ax.text(
                (begin + end) / 2,
                0.985,
                name,
                transform=ax.get_xaxis_transform(),
                ha="center",
                va="top",
                color="#606060" if step.passed else "#D55E00",
                fontweight="normal" if step.passed else "bold",
                parse_math=False,
            )
