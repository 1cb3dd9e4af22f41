"""Picture of an episode: side view of tool, surface and force, and the contact force over time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hil_bridge.gym.episode import Decision, EpisodeEnd
from hil_bridge.settings.configuration import Config
from hil_bridge.show.picture_files import drawing_library

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE = (4.8, 2.4)
"""Width and height, in hundreds of pixels."""
_VIEW_MM = 8.0
"""Half width of the side view, mm. Chosen: about twice the travel of a second."""
_ARROW_MM = 4.0
"""Length of the arrow of the target force, mm."""
_TOOL_MM = np.array([(0.0, 0.0), (-0.8, 2.5), (-0.8, 9.0), (0.8, 9.0), (0.8, 2.5)])
"""Outline of the drawn tool, from its tip, mm."""


class Picture:
    """Side view in the plane of travel and approach. The surface is drawn where the tool has touched it."""

    def __init__(self) -> None:
        """Create a picture. Raises ConfigError if matplotlib is not installed."""
        drawing_library()
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=_SIZE, dpi=100)
        figure.subplots_adjust(left=0.1, bottom=0.19, right=0.98, top=0.92, wspace=0.28)
        self._canvas = FigureCanvasAgg(figure)
        self._axes: tuple[Axes, Axes] = tuple(figure.subplots(1, 2))
        self._points: list[tuple[float, float, float, float]] = []
        """Time, s; travel and height, mm; contact force along the approach direction, N; of each decision."""
        self._plane = np.eye(2, 3)
        self._target = 0.0
        self._title = ""

    @property
    def has_begun(self) -> bool:
        """Whether there is an episode to draw."""
        return bool(self._points)

    def begin(self, config: Config, decision: Decision) -> None:
        """Begin the picture of another episode."""
        frame = config.frame
        self._plane = np.array([frame.travel, [-share for share in frame.approach]])
        self._target = config.task.force_n
        self._points, self._title = [], ""
        self.extend(decision)

    def extend(self, event: Decision | EpisodeEnd) -> None:
        """Add the state at a decision, or the reason of the end."""
        if isinstance(event, EpisodeEnd):
            self._title = event.text or "completed"
            return
        assert event.truth is not None, "a picture needs the true state"
        travel, height = (self._plane @ event.truth.position * 1e3).tolist()
        self._points.append((event.at, travel, height, float(self._plane[1] @ event.truth.force)))

    def draw(self) -> NDArray[np.uint8]:
        """Return the picture, shape (height, width, 3)."""
        times, travels, heights, forces = np.array(self._points).T
        side, over_time = self._axes
        side.clear()
        touching = np.where(forces > 0.0, heights, np.nan)
        side.plot(travels, touching, color="#8C6D31", lw=3.0)
        tip = travels[-1], heights[-1]
        side.fill(*(_TOOL_MM + tip).T, facecolor="#BBBBBB", edgecolor="black", lw=0.8)
        length = forces[-1] / self._target * _ARROW_MM
        side.annotate(
            "", (tip[0], tip[1] + length), tip, arrowprops={"color": "#D55E00", "width": 1.5, "headwidth": 6}
        )
        _label(side, "travel, mm", "height, mm", (tip[0] - _VIEW_MM, tip[0] + _VIEW_MM))
        side.set_ylim(heights[0] - _VIEW_MM / 2.0, heights[0] + 1.5 * _VIEW_MM)
        over_time.clear()
        over_time.plot(times - times[0], forces, color="#0072B2", lw=1.0)
        over_time.axhline(self._target, color="black", lw=0.8, ls="--")
        _label(over_time, "time, s", "force, N", (0.0, max(1.0, times[-1] - times[0])))
        over_time.set_title(self._title[:40], fontsize=7)
        canvas: Any = self._canvas
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _label(axes: "Axes", x: str, y: str, limits: Sequence[Any]) -> None:
    axes.set_xlabel(x, fontsize=7)
    axes.set_ylabel(y, fontsize=7)
    axes.set_xlim(*limits)
    axes.tick_params(labelsize=6)
