"""The picture of a run: force, motion, stiffness and time above each other, and the figures below."""

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.record import STOP_EVENT
from hil_bridge.record.analysis.stream import stream_force
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.analysis.summary import PhaseSpan, Summary, cycle_times, phases, wanted_force
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord
from hil_bridge.show.picture_files import drawing_library, saved
from hil_bridge.show.report.explanation import LEVELS
from hil_bridge.show.report.figures import Row, merit_rows, run_rows
from hil_bridge.show.report.program_charts import has_program
from hil_bridge.show.report.step_marks import mark_steps

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array: TypeAlias = NDArray[np.float64]

SIZE_PX = (1400, 1600)
_LEVELS_PX = 230
"""Additional height for the levels."""
_DPI = 100

_LEAST_DEPTH_ROOM_MM = 0.25

# Okabe-Ito colours: told apart with every common kind of colour blindness.
_BLUE, _ORANGE, _GREEN, _VERMILION, _SKY, _PURPLE = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#56B4E9",
    "#CC79A7",
)
_PHASE_COLOURS = {
    "connect": "#f4f4f4",
    "tare": "#e4e4ee",
    "approach": "#fff3d6",
    "track": "#e3f3ec",
    "retract": "#e2f0fa",
    "seek": "#fdeaf3",
    "zero": "#e4e4ee",
}
STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.grid": True,
    "grid.color": "#d8d8d8",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.fontsize": 9.0,
    "path.simplify": True,
}


def draw(recording: Recording, summary: Summary, kind: str = "png") -> bytes:
    """The picture as PNG or PDF. The same recording gives the same bytes with the same version of matplotlib.

    Raises ConfigError where matplotlib is not installed.
    """
    matplotlib = drawing_library()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        width, height = size_px(recording)
        figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
        figure.set_layout_engine("constrained", h_pad=0.06, w_pad=0.08)
        FigureCanvasAgg(figure)
        figure.suptitle(_title(summary), fontsize=15, fontweight="bold", parse_math=False)
        levels = [1.6] * has_levels(recording.cycles)
        ratios = (3.2, 2.0, 1.5, *levels, 1.5, 1.6, 2.1)
        grid = figure.add_gridspec(len(ratios), 1, height_ratios=ratios)
        force = figure.add_subplot(grid[0])
        axes = [force, *(figure.add_subplot(grid[row], sharex=force) for row in range(1, len(ratios) - 1))]
        spans = phases(recording)
        cycles = recording.cycles
        zero = min([span.begin for span in spans] + [cycle.started_at for cycle in cycles[:1]])
        time = _column(cycles, "controlled_at") - zero
        _draw_force(force, recording, time, zero)
        _draw_depth(axes[1], cycles, time)
        _draw_correction(axes[2], cycles, time)
        if levels:
            _draw_levels(axes[3], cycles, time)
        _draw_stiffness(axes[-2], cycles, time)
        driven = devices_of(recording).robot.cycle_s is not None
        _draw_cycle_time(axes[-1], time, cycle_times(cycles, driven), summary)
        for ax in axes:
            _shade(ax, spans, zero, named=ax is force and not recording.steps)
            mark_steps(ax, recording.steps, zero, named=ax is force)
            _mark_stops(ax, recording, time, zero, named=ax is force)
            ax.tick_params(labelbottom=ax is axes[-1])
        axes[-1].set_xlabel("time since the run began, s")
        if spans:
            force.set_xlim(0.0, 1.005 * (max(span.end for span in spans) - zero))
        _draw_table(figure.add_subplot(grid[-1]), merit_rows(summary), run_rows(summary))
        return saved(figure, kind)


def size_px(recording: Recording) -> tuple[int, int]:
    """Width and height of the picture."""
    width, height = SIZE_PX
    return width, height + _LEVELS_PX * has_levels(recording.cycles)


def has_levels(cycles: Sequence[CycleRecord]) -> bool:
    """Whether the controller answers in levels."""
    return any(key in cycle.explanation for cycle in cycles for key in LEVELS)


def _title(summary: Summary) -> str:
    target, what = wanted_force(summary), summary.controller or "run"
    if target:
        what += f" at {target}"
    return _short(f"{what} – {summary.outcome}" + (f": {summary.text}" if summary.text else ""))


def _short(text: str) -> str:
    return textwrap.shorten(text, 110, placeholder=" …")


def _column(cycles: Sequence[CycleRecord], name: str) -> Array:
    """One column of the cycle records; None becomes NaN."""
    return np.array([getattr(cycle, name) for cycle in cycles], dtype=np.float64)


def _draw_force(ax: "Axes", recording: Recording, time: Array, zero: float) -> None:
    cycles = recording.cycles
    if (stream := stream_force(recording)) is not None:
        at, low, high = stream
        ax.fill_between(
            at - zero,
            low,
            high,
            color=_SKY,
            alpha=0.55,
            linewidth=0.4,
            label="sensor, whole stream",
            zorder=1.5,
        )
    reference = _column(cycles, "force_reference")
    if has_program(cycles):  # a step that does not press wants no force
        reference[[cycle.phase != TRACK for cycle in cycles]] = np.nan
    ax.step(time, reference, where="post", color="black", lw=1.2, ls="--", label="target", zorder=2.5)
    ax.plot(
        time, _column(cycles, "force"), color=_BLUE, lw=1.3, marker=".", ms=5, label="force, cycle samples"
    )
    clamped = [k for k, cycle in enumerate(cycles) if cycle.verdict == "clamp"]
    if clamped:
        ax.plot(
            time[clamped],
            _column(cycles, "force")[clamped],
            ls="none",
            marker="v",
            ms=7,
            mfc="none",
            mec=_VERMILION,
            label=f"clamped by the supervisor ({len(clamped)})",
        )
    ax.set_ylabel("force, N")
    ax.margins(y=0.12)
    _legend(ax)


def _legend(ax: "Axes") -> None:
    """Above the axes, where it hides nothing."""
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.985), borderaxespad=0.0, ncols=4, frameon=False)


def _draw_depth(ax: "Axes", cycles: Sequence[CycleRecord], time: Array) -> None:
    commanded, reported = _column(cycles, "depth_commanded") * 1e3, _column(cycles, "depth") * 1e3
    ax.step(time, commanded, where="post", color=_ORANGE, lw=1.4, label="commanded")
    ax.plot(time, reported, color=_BLUE, lw=1.2, marker=".", ms=3, label="reported")
    ax.set_ylabel("depth, mm")
    in_track = [k for k, cycle in enumerate(cycles) if cycle.phase == TRACK]
    if in_track:  # approach and retract are long; what matters is how the contact is held
        values = np.concatenate((commanded[in_track], reported[in_track]))
        low, high = np.nanmin(values), np.nanmax(values)
        room = max(0.25 * (high - low), _LEAST_DEPTH_ROOM_MM)
        ax.set_ylim(low - room, high + room)
    _legend(ax)


def _draw_correction(ax: "Axes", cycles: Sequence[CycleRecord], time: Array) -> None:
    ax.axhline(0.0, color="#808080", lw=0.8)
    correction = _column(cycles, "correction") * 1e3
    ax.vlines(time, 0.0, correction, color=_PURPLE, lw=1.4)
    held = [k for k, cycle in enumerate(cycles) if cycle.held]
    if held:
        ax.plot(time[held], np.zeros(len(held)), ls="none", marker="|", ms=6, color=_GREEN, label="held")
        _legend(ax)
    ax.set_ylabel("correction\nper cycle, mm")


def _draw_levels(ax: "Axes", cycles: Sequence[CycleRecord], time: Array) -> None:
    ax.axhline(0.0, color="#808080", lw=0.8)
    looks: tuple[dict[str, Any], ...] = (
        {"color": _BLUE, "lw": 2.6, "alpha": 0.45},
        {"color": _ORANGE, "lw": 1.3, "ls": "--"},
        {"color": _PURPLE, "lw": 1.3},
    )
    for (key, name), look in zip(LEVELS.items(), looks, strict=True):
        told = [cycle.explanation.get(key, math.nan) for cycle in cycles]
        ax.step(time, np.array(told, dtype=np.float64), where="post", label=name, **look)
    ax.margins(y=0.15)
    ax.set_ylabel("level")
    _legend(ax)


def _draw_stiffness(ax: "Axes", cycles: Sequence[CycleRecord], time: Array) -> None:
    stiffness = _column(cycles, "stiffness")
    stiffness[~(stiffness > 0.0)] = np.nan  # a logarithmic axis takes nothing else
    ax.set_ylabel("stiffness\nestimate, N/m")
    if not np.isfinite(stiffness).any():
        ax.text(0.5, 0.5, "no estimate", transform=ax.transAxes, ha="center", va="center", color="#707070")
        ax.set_yticks([])
        return
    ax.plot(time, stiffness, color=_GREEN, lw=1.4, marker=".", ms=3)
    ax.set_yscale("log")
    low, high = np.nanmin(stiffness), np.nanmax(stiffness)
    ax.set_ylim(10 ** math.floor(math.log10(low)), 10 ** math.ceil(math.log10(high * 1.01)))


def _draw_cycle_time(ax: "Axes", time: Array, seconds: Sequence[float], summary: Summary) -> None:
    ax.plot(
        time[: len(seconds)], np.array(seconds) * 1e3, color=_BLUE, lw=0.8, marker=".", ms=4, label="cycle"
    )
    if summary.line_floor_s is not None:
        floor = summary.line_floor_s * 1e3
        ax.axhline(floor, color=_VERMILION, lw=1.3, ls="--", label=f"line floor {floor:.0f} ms")
    ax.margins(y=0.15)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("cycle time, ms")
    _legend(ax)


def _shade(ax: "Axes", spans: Sequence[PhaseSpan], zero: float, named: bool) -> None:
    whole = max((span.end for span in spans), default=zero) - zero
    for span in spans:
        ax.axvspan(
            span.begin - zero, span.end - zero, color=_PHASE_COLOURS.get(span.name, "#eeeeee"), lw=0, zorder=0
        )
        if named and span.end - span.begin > 0.045 * whole:
            middle = (span.begin + span.end) / 2 - zero
            ax.text(
                middle,
                0.985,
                span.name,
                transform=ax.get_xaxis_transform(),
                ha="center",
                va="top",
                color="#606060",
            )


def _mark_stops(ax: "Axes", recording: Recording, time: Array, zero: float, named: bool) -> None:
    stops = [(event.at - zero, event.text) for event in recording.events if event.kind == STOP_EVENT]
    if not stops:
        stops = [
            (time[k], ", ".join(c.reasons)) for k, c in enumerate(recording.cycles) if c.verdict == "stop"
        ]
    for at, _ in stops:
        ax.axvline(at, color=_VERMILION, lw=1.6)
    if named and stops:
        at, cause = stops[-1]
        late = at > float(np.nanmean(time))
        ax.annotate(
            _short(f"stop: {cause}"),
            (at, 0.5),
            xycoords=ax.get_xaxis_transform(),
            xytext=(-6 if late else 6, 0),
            textcoords="offset points",
            ha="right" if late else "left",
            va="top",
            color=_VERMILION,
            fontweight="bold",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85},
            parse_math=False,
        )


def _draw_table(ax: "Axes", left: Sequence[Row], right: Sequence[Row]) -> None:
    ax.axis("off")
    lines = max(len(left), len(right)) + 1
    for at, title, rows in ((0.0, "figures of merit", left), (0.51, "run", right)):
        ax.text(at, 1.0, title, transform=ax.transAxes, va="top", fontweight="bold", parse_math=False)
        for number, row in enumerate(rows, start=1):
            y = 1.0 - number / lines
            ax.text(at, y, row.label, transform=ax.transAxes, va="top")
            ax.text(
                at + 0.262,
                y,
                row.value,
                transform=ax.transAxes,
                va="top",
                ha="right",
                fontweight="bold",
                parse_math=False,
            )
            ax.text(
                at + 0.272, y, row.explanation, transform=ax.transAxes, va="top", color="#606060", size=7.5
            )
