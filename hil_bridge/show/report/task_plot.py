"""Picture of a program: its paths in the work frame from above, and below them the target force over time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from hil_bridge.control.geometry.ways import Place
from hil_bridge.show.charts.painter import STYLE
from hil_bridge.show.picture_files import drawing_library, save_figure
from hil_bridge.show.report.task_steps import ListedStep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_PX = 1000
_DPI = 100
_PLAN_PX = (240, 620)
"""Smallest and largest height of the path plot, px."""
_FORCE_PX, _DECORATION_PX = 230, 220
"""Height of the force plot, and height of titles and axes, px."""
_ROOM = 0.08
"""Margin around the paths, as a share of their larger side."""
_LEAST_ROOM_MM = 4.0
_LONG_PIECE, _ARROWS = 0.6, 24
"""Smallest length of a segment with an arrow, as a share of the longest segment, and maximum number of arrows.

With more long segments than that, only the longest segment has an arrow.
"""
_LETTER = 0.0095
"""Width of a letter above the force plot, as a share of the axis."""

_PRESS = "#009E73"


@dataclass(frozen=True, slots=True)
class _Line:
    """Step of the program on the plan."""

    step: ListedStep
    places: tuple[Place, ...]
    """Points of the step from its start to its end, mm."""
    known: bool
    """Whether the position of the step is known before the run."""


def draw_task(steps: Sequence[ListedStep], title: str) -> bytes:
    """Render the picture as PNG. Equal programs give equal bytes with the same matplotlib version.

    Raises ConfigError if matplotlib is not installed.
    """
    matplotlib = drawing_library()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    lines = _lines(steps)
    box = _box(lines)
    (left, right), (low, high) = box
    plan_px = min(max(_PLAN_PX[0], WIDTH_PX * 0.9 * (high - low) / (right - left)), _PLAN_PX[1])
    height = plan_px + _FORCE_PX + _DECORATION_PX
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_PX / _DPI, height / _DPI), dpi=_DPI)
        figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
        FigureCanvasAgg(figure)
        figure.suptitle(title, fontsize=13, fontweight="bold", parse_math=False)
        plan, force = figure.subplots(2, 1, height_ratios=(plan_px, _FORCE_PX))
        _draw_plan(plan, lines, box)
        _draw_force(force, steps)
        return save_figure(figure, "png")


def _lines(steps: Sequence[ListedStep]) -> list[_Line]:
    """Return all steps on the plan.

    A position that is known only during the run is drawn at its farthest possible point.
    """
    lines: list[_Line] = []
    guess: Place | None = None
    for step in steps:
        known = step.begin is not None
        begin = step.begin or guess
        places: tuple[Place, ...] = () if begin is None else (begin,)
        goal = step.leg.step.goal_mm
        if goal is not None:
            places = (*places, goal)
        elif (path := step.leg.way) is not None:
            x, y = begin or (0.0, 0.0)
            places = tuple((x + u * 1e3, y + v * 1e3) for u, v in path.points)
        elif sketch := step.leg.step.sketch_mm:
            x, y = begin or (0.0, 0.0)
            places = (*places, *((x + u, y + v) for u, v in sketch))
        lines.append(_Line(step, places, known))
        guess = places[-1] if places else None
    return lines


def _box(lines: Sequence[_Line]) -> tuple[Place, Place]:
    """Return the x and y ranges of the plan with margins, mm."""
    everywhere = [place for line in lines for place in line.places] or [(0.0, 0.0)]
    sides = [(min(values), max(values)) for values in zip(*everywhere, strict=True)]
    room = max(_ROOM * max(high - low for low, high in sides), _LEAST_ROOM_MM)
    (left, right), (low, high) = sides
    return (left - room, right + room), (low - room, high + room)


def _draw_plan(ax: "Axes", lines: Sequence[_Line], box: tuple[Place, Place]) -> None:
    for line in lines:
        _draw_line(ax, line)
    _number(ax, lines)
    _name(ax, lines)
    ax.plot(*box, ls="none")
    ax.margins(0.0)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x, mm (the travel direction)")
    ax.set_ylabel("y, mm")
    ax.set_title("paths from above, in the work frame", loc="left", fontsize=10.5)
    handles, labels = ax.get_legend_handles_labels()
    by_label = dict(zip(labels, handles, strict=True))
    ax.legend(
        by_label.values(),
        by_label.keys(),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.2,
        ncols=4,
        frameon=False,
    )


def _draw_line(ax: "Axes", line: _Line) -> None:
    """Draw one step on the plan."""
    own, places = line.step.leg.step, line.places
    drawing = own.drawing
    if not places or drawing is None:
        return
    if not drawing.style:
        x, y = places[0]
        ax.plot(
            [x],
            [y],
            ls="none",
            marker="s",
            ms=9,
            mfc=drawing.colour,
            mec="white",
            label=drawing.label,
            zorder=4,
        )
        return
    paths = [places]
    if own.goal_mm is not None:
        begins = {places[0], line.step.again or places[0]} - {places[-1]}
        paths = [(begin, places[-1]) for begin in begins]
    style, label = drawing.style, drawing.label
    if own.controls and not line.known:
        style, label = (0, (6, 1.5)), f"{label}, position set by the run"
    for path in paths:
        ax.plot(
            *zip(*path, strict=True), color=drawing.colour, lw=drawing.width, ls=style, label=label, zorder=3
        )
        _arrow(ax, path, drawing.colour)


def _arrow(ax: "Axes", places: Sequence[Place], colour: str) -> None:
    """Draw arrowheads in the direction of motion in the middle of each long segment.

    If there are many long segments, only the longest gets an arrowhead.
    """
    pieces = [(math.dist(*pair), pair) for pair in pairwise(places)]
    longest = max((length for length, _ in pieces), default=0.0)
    if longest < 1e-6:
        return
    long = [pair for length, pair in pieces if length > _LONG_PIECE * longest]
    if len(long) > _ARROWS:
        long = [next(pair for length, pair in reversed(pieces) if length > 0.99 * longest)]
    for (x, y), (u, v) in long:
        length = math.dist((x, y), (u, v))
        reach = min(0.02, 0.1 / length)
        ax.annotate(
            "",
            ((x + u) / 2 + reach * (u - x), (y + v) / 2 + reach * (v - y)),
            xytext=((x + u) / 2 - reach * (u - x), (y + v) / 2 - reach * (v - y)),
            arrowprops={
                "arrowstyle": "-|>",
                "color": colour,
                "mutation_scale": 14,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            zorder=4,
        )


def _number(ax: "Axes", lines: Sequence[_Line]) -> None:
    """Draw the numbers of the steps, once at each point where steps begin."""
    here: dict[Place, list[str]] = {}
    for line in lines:
        if line.places:
            x, y = line.places[0]
            here.setdefault((round(x, 1) + 0.0, round(y, 1) + 0.0), []).append(line.step.number)
    order = [line.step.number for line in lines]
    ax.plot(*zip(*here, strict=True), ls="none", marker="o", ms=5, color="black", zorder=5)
    for place, numbers in here.items():
        ax.annotate(
            _join_numbers(numbers, order),
            place,
            xytext=(6, 6),
            textcoords="offset points",
            fontsize=9.5,
            fontweight="bold",
            zorder=6,
            bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "#b0b0b0", "alpha": 0.9},
        )


def _join_numbers(numbers: Sequence[str], order: Sequence[str]) -> str:
    """Format step numbers, with consecutive numbers joined: "1–3, 7"."""
    runs: list[list[str]] = []
    for number in numbers:
        if runs and order.index(number) == order.index(runs[-1][-1]) + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    joined = (f"{run[0]}–{run[-1]}" if len(run) > 2 else ", ".join(run) for run in runs)
    return ", ".join(joined)


def _name(ax: "Axes", lines: Sequence[_Line]) -> None:
    """Draw the legend."""
    here: dict[Place, list[str]] = {}
    for line in lines:
        if (name := line.step.leg.step.name) and line.places:
            here.setdefault(line.places[-1], []).append(name)
    for place, names in here.items():
        ax.annotate(
            "\n".join(names),
            place,
            xytext=(7, -5),
            textcoords="offset points",
            va="top",
            fontsize=9,
            fontstyle="italic",
            color="#404040",
            parse_math=False,
            zorder=6,
        )


def _draw_force(ax: "Axes", steps: Sequence[ListedStep]) -> None:
    """Draw the target force over time, with a band for each step."""
    from matplotlib.patches import Patch

    total_s = sum(step.seconds for step in steps) or 1.0
    highest = max((newton for step in steps if step.presses for _, newton in step.leg.profile), default=1.0)
    at, raised = 0.0, False
    for step in steps:
        end = at + step.seconds
        ax.axvspan(at, end, color=step.leg.step.band, lw=0, zorder=0)
        ax.axvline(end, color="#b8b8b8", lw=0.7, zorder=1)
        room = step.seconds / total_s
        times = f" × {step.passes}" if step.passes > 1 else ""
        texts = (f"{step.number} {step.word}{times}", f"{step.number} {step.word}", step.number)
        text = next((text for text in texts if len(text) * _LETTER < room), step.number)
        raised = len(text) * _LETTER >= room and not raised
        ax.annotate(
            text,
            ((at + end) / 2, 1.0),
            xycoords=ax.get_xaxis_transform(),
            xytext=(0, 15 if raised else 3),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=9,
        )
        if step.presses:
            xs, ys = _target_force(step, at)
            ax.plot(xs, ys, color=_PRESS, lw=2.0, zorder=3, solid_capstyle="butt")
            ax.fill_between(xs, ys, color=_PRESS, alpha=0.15, lw=0, zorder=2)
        at = end
    bands = {step.word: step.leg.step.band for step in steps}
    patches = [Patch(facecolor=band, edgecolor="#b8b8b8", lw=0.7, label=word) for word, band in bands.items()]
    ax.legend(
        handles=patches, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=len(bands), frameon=False
    )
    ax.set_xlim(0.0, max(at, 1e-3))
    ax.set_ylim(0.0, 1.12 * highest)
    ax.locator_params(axis="y", steps=[1, 2, 5, 10], nbins=6)
    ax.set_xlabel("approximate time, s; the passes of a repeat are drawn once")
    ax.set_ylabel("target force, N")


def _target_force(step: ListedStep, begin: float) -> tuple[list[float], list[float]]:
    """Return the times and target forces of a step."""
    end = begin + step.seconds
    path, profile = step.leg.way, step.leg.profile
    if path is None or len(profile) == 1:
        return [begin, end], [profile[0][1]] * 2
    speed = step.leg.stroke.parameters.speed_mm_s * 1e-3
    longest = step.seconds * speed
    inside = [(place, newton) for place, newton in profile if place < longest]
    places = [*inside, (longest, step.leg.reference(longest))]
    return [begin + place / speed for place, _ in places], [newton for _, newton in places]
