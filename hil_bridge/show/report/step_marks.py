"""The borders of a program's steps in a picture over time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hil_bridge.record.records import StepRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_NAMED_SHARE = 0.035
"""Chosen: a step that is shorter than this share of the run gets no more than its number in a picture."""
_LETTER_INCH = 0.085
"""Chosen: width that a letter of a name takes in a picture, and a gap between two names."""
_MARKED = 200
"""Chosen: with more steps than this their borders would cover the curves."""


def mark_steps(ax: "Axes", steps: Sequence[StepRecord], zero: float, named: bool) -> None:
    """A line at each border of steps, and between them the steps' names where they fit. `zero` is the start of the
    times, s on the run's clock.
    """
    if len(steps) > _MARKED or not steps:
        return
    whole = max(steps[-1].at - zero, 1e-9)
    figure = ax.get_figure()
    letter = _LETTER_INCH / float(figure.get_figure(root=True).get_size_inches()[0]) if figure else 0.0
    for step in steps:
        begin, end = step.began_at - zero, step.at - zero
        ax.axvline(begin, color="#909090", lw=0.7, ls=":", zorder=1.2)
        share = (end - begin) / whole
        number, word = step.label.split(" ", 1)
        word = word.strip("()").split(",")[0]
        name = f"{number} {word}"
        if share < max((len(name) + 1) * letter, _NAMED_SHARE):
            name = number
        if named and share >= (len(name) + 1) * letter:
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
