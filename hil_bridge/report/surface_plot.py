"""The emulated surface in pictures: what the tool removed, and how far its axis stood from the normal."""

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.recording.records import TruthRecord
from hil_bridge.recording.removed_map import RemovedMap
from hil_bridge.report.plots import STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array: TypeAlias = NDArray[np.float64]

WIDTH_PX = 1000
_ERROR_PX = 300
_MAP_PX = (220, 560)
"""Least and most height of the map."""
_BESIDE_MAP_PX = 190
"""Width that the labels and the scale of the map take."""
_BELOW_MAP_PX = 90
"""Height that its labels take."""
_DPI = 100
_BLUE, _GREY, _PATH = "#0072B2", "#b8b8b8", "#ffffff"
TOUCH_N = 0.05
"""Force from which the tool touches. Chosen: far below any force that a sensor of the house resolves under noise."""
_LEAST_SHOWN_DEG = 1.0


class Orientation(NamedTuple):
    """How far the tool's axis stood from the inward normal."""

    at: Array
    """(n,), s on the run's clock."""
    error_deg: Array
    """(n,), NaN where the surface tells no normal."""
    touching: NDArray[np.bool_]
    """(n,)"""

    @property
    def touched_deg(self) -> Array:
        """Errors while the tool touched a surface whose normal is known."""
        return self.error_deg[self.touching & np.isfinite(self.error_deg)]


def orientation_of(truths: Sequence[TruthRecord]) -> Orientation | None:
    """None where no truth tells a normal."""
    if not truths:
        return None
    quaternions, normals, forces = (
        np.array([getattr(truth, name) for truth in truths], dtype=np.float64)
        for name in ("quaternion", "normal", "force")
    )
    if not (np.isfinite(normals).all(axis=1) & np.isfinite(quaternions).all(axis=1)).any():
        return None
    w, x, y, z = quaternions.T
    axis = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
    # The sine and the cosine: the cosine alone says little of a small angle.
    angle = np.arctan2(
        np.linalg.norm(np.cross(axis, -normals), axis=1), np.einsum("ij,ij->i", axis, -normals)
    )
    touching = np.linalg.norm(forces, axis=1) > TOUCH_N
    return Orientation(np.array([truth.at for truth in truths]), np.degrees(angle), touching)


def draw_surface(
    orientation: Orientation | None, removed: RemovedMap | None, truths: Sequence[TruthRecord], zero: float
) -> tuple[bytes, tuple[int, int]]:
    """The pictures that there are, one above the other, as PNG, and their width and height. `zero` is the start of the
    times, s on the run's clock.
    """
    import matplotlib  # late, as for the picture
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    heights = ([] if removed is None else [_map_height(removed)]) + [_ERROR_PX] * (orientation is not None)
    size = WIDTH_PX, sum(heights)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI)
        figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
        canvas = FigureCanvasAgg(figure)
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        if removed is not None:
            _draw_map(figure.add_subplot(grid[0]), removed, truths)
        if orientation is not None:
            _draw_error(figure.add_subplot(grid[-1]), orientation, zero)
        buffer = io.BytesIO()
        canvas.print_png(buffer, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue(), size


def _map_height(removed: RemovedMap) -> int:
    """Height that shows the map with equal scales, within bounds."""
    rows, columns = removed.depths.shape
    least, most = _MAP_PX
    wanted = round((WIDTH_PX - _BESIDE_MAP_PX) * columns / rows) + _BELOW_MAP_PX
    return int(min(max(wanted, least), most))


def _draw_map(ax: "Axes", removed: RemovedMap, truths: Sequence[TruthRecord]) -> None:
    depths, step = removed.depths, removed.spacing_m * 1e3
    rows, columns = depths.shape
    along, across = (1e3 * place for place in removed.corner_m)
    edges = (
        along - step / 2,
        along + (rows - 0.5) * step,
        across - step / 2,
        across + (columns - 0.5) * step,
    )
    image = ax.imshow(depths.T, origin="lower", extent=edges, cmap="viridis", vmin=0.0, aspect="equal")
    touches = np.array([math.hypot(*truth.force) > TOUCH_N for truth in truths])
    if touches.any():
        places = _on_map(np.array([truth.position for truth in truths]), removed) * 1e3
        places[:, ~touches] = math.nan  # what lies between two strokes is not drawn
        places = places[:, int(touches.argmax()) :]
        ax.plot(*places, color=_PATH, lw=1.0, alpha=0.85, label="path of the tool while it touched")
        ax.plot(*places[:, :1], color=_PATH, marker="o", ms=4, ls="none")
        ax.legend(
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            frameon=False,
            labelcolor="#404040",
            handlelength=1.5,
        ).get_lines()[0].set_color("#808080")
    ax.set_xlim(edges[:2])
    ax.set_ylim(edges[2:])
    ax.grid(False)
    ax.set_xlabel("path coordinate, mm")
    ax.set_ylabel("left of the path, mm")
    ax.set_title("removed depth", loc="left", fontsize=10)
    figure = ax.get_figure()
    assert figure is not None
    figure.colorbar(image, ax=ax, label="µm", pad=0.015, fraction=0.05, aspect=14)


def _on_map(positions: Array, removed: RemovedMap) -> Array:
    """Path coordinate and distance to the left (2, n), m, of positions (n, 3) in the base frame, m."""
    from_corner = positions[:, :2] - np.array(removed.origin_m)
    dx, dy = removed.direction
    along, across = removed.corner_m
    return np.stack((along + from_corner @ np.array([dx, dy]), across + from_corner @ np.array([-dy, dx])))


def _draw_error(ax: "Axes", orientation: Orientation, zero: float) -> None:
    at, error = orientation.at - zero, orientation.error_deg
    ax.plot(at, error, color=_GREY, lw=1.1, label="in free space")
    ax.plot(at, np.where(orientation.touching, error, np.nan), color=_BLUE, lw=1.6, label="while it touched")
    most = float(np.nanmax(error))
    ax.set_ylim(0.0, max(1.12 * most, _LEAST_SHOWN_DEG))
    ax.set_xlim(0.0, 1.005 * float(at[-1]) if at[-1] > 0.0 else 1.0)
    ax.set_ylabel("angle, °")
    ax.set_xlabel("time since the run began, s")
    ax.set_title("tool axis against the inward normal of the surface", loc="left", fontsize=10)
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
