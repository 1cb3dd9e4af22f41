"""Removal of material by a tool that slides under pressure. The removal lowers the surface for the next pass.

Preston's law: depth per distance = coefficient · pressure. Source: Preston, The theory and design of plate glass
polishing machines, 1927. A contact point removes material from a disc whose area is the point's share of the face's
area. The map of removed depths changes the depth at a point, not the normal there.

The map is updated after each time step, not after each sample. The result therefore depends only on the motion, not
on how the samples are divided into blocks.
"""

import copy
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulators.surface.shapes import Floats
from protocol.marks import Mark, SettingError, above, between, check_settings, setting

CELLS_LIMIT = 1 << 20
"""Maximum number of cells of a map. Chosen: 8 MiB."""
RADIUS_LIMIT_CELLS = 24.0
"""Maximum radius of the disc of a contact point, in cells. Chosen: about 1800 sums of small arrays per step."""
_STEPS_HZ = 100
"""Time steps per second, Hz. Chosen: in one step, a tool at 100 mm/s moves by one cell of the default size."""
_GAP_S = 0.1
"""Longest gap between two samples in which the motion counts as known, s. A longer gap removes no material. Chosen."""
_M_PER_UM_N_CM2_M = 1e-10
"""Conversion factor from µm per N/cm² and m of sliding distance to m per N/m² and m."""


@dataclass(frozen=True, slots=True)
class RemovalProfile:
    """Amount of material that a sliding tool removes."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    um_per_n_cm2_m: float = setting(
        0.0,
        Mark.ASSUMED,
        "depth removed by a pressure of 1 N/cm² over a sliding distance of 1 m, µm; 0 for a surface without wear",
        between(0.0, 1e6),
    )
    cell_mm: float = setting(1.0, Mark.CHOSEN, "spacing of the map of removed depths", above(0.0), unit="mm")
    length_mm: float = setting(
        400.0, Mark.CHOSEN, "length of that map, centred on path coordinate 0", above(0.0), unit="mm"
    )
    width_mm: float = setting(
        200.0, Mark.CHOSEN, "width of that map across the path, centred on the path", above(0.0), unit="mm"
    )
    point_radius_mm: float = setting(
        5.0,
        Mark.CHOSEN,
        "radius of the disc from which a tool without a face removes material",
        above(0.0),
        unit="mm",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if not self.rows * self.columns <= CELLS_LIMIT:
            raise SettingError(
                "cell_mm",
                f"of {self.cell_mm:g} makes a map of more than {CELLS_LIMIT} cells; "
                "take larger cells, or a shorter or narrower map",
            )

    @property
    def rows(self) -> float:
        """Number of nodes of the map along the path; infinite if the number would be too large."""
        return _nodes(self.length_mm, self.cell_mm)

    @property
    def columns(self) -> float:
        """Number of nodes of the map across the path; infinite if the number would be too large."""
        return _nodes(self.width_mm, self.cell_mm)


def _nodes(length: float, cell: float) -> float:
    cells = length / cell
    return 2 * math.ceil(0.5 * cells) + 1 if cells < CELLS_LIMIT else math.inf


class Removed(NamedTuple):
    """Map of the removed depths."""

    origin: tuple[float, float]
    """Position of `depths[0, 0]` in base x and y, m."""
    direction: tuple[float, float]
    """Unit vector of the path in base x and y. Successive rows follow the path; successive columns lie further to
    the left of it.
    """
    corner: tuple[float, float]
    """Path coordinate of `depths[0, 0]`, and its distance to the left of the path, both in m."""
    spacing: float
    """Distance between adjacent rows or columns, m."""
    depths: Floats
    """Removed depths (rows, columns), m."""


class RemovedVolume(NamedTuple):
    """Volumes removed at n contact points; each array has the shape (n,)."""

    along: Floats
    """Path coordinate, m."""
    across: Floats
    """Distance to the left of the path, m."""
    volume: Floats
    """Removed volume, m³."""


class State(NamedTuple):
    """State of a `Removal` that can be restored."""

    time: float
    step: float
    waiting: tuple[RemovedVolume, ...]
    changes: int


class _Change(NamedTuple):
    """Contents of a part of the map before a change."""

    where: tuple[slice, slice]
    depths: Floats


class Removal:
    """Map of removed depths, and the removal of the current step that is not yet entered in the map."""

    def __init__(self, profile: RemovalProfile, points: int, area: float | None) -> None:
        """`points` is the number of contact points of the tool.

        `area` is the area of its face, m²; None without a face. Raises ValueError for a map that is too fine for
        the tool.
        """
        assert profile.rows < math.inf
        assert profile.columns < math.inf
        self.spacing = profile.cell_mm / 1000.0
        """Spacing of the map, m."""
        self._points = points
        self._area = math.pi * (profile.point_radius_mm / 1000.0) ** 2 if area is None else area
        self._coefficient = profile.um_per_n_cm2_m * _M_PER_UM_N_CM2_M
        radius = math.sqrt(self._area / points / math.pi) / self.spacing
        if radius > RADIUS_LIMIT_CELLS:
            raise ValueError(
                f"surface.removal.cell_mm of {profile.cell_mm:g} is too fine for a contact point of "
                f"{radius * profile.cell_mm:.3g} mm radius; allowed: at least "
                f"{radius / RADIUS_LIMIT_CELLS * profile.cell_mm:.3g}"
            )
        self._disc = _disc(radius)
        self._depths = np.zeros((int(profile.rows), int(profile.columns)))
        self._shared = False
        """Whether another removal shares the map, which must then be copied before a change."""
        self._time = -math.inf
        self._step = -math.inf
        self._waiting: tuple[RemovedVolume, ...] = ()
        """Volumes removed so far in the current step."""
        self._changes: deque[_Change] = deque()
        self._forgotten = 0
        """Number of changes that can no longer be undone."""

    # --- restoring an earlier state

    @property
    def state(self) -> State:
        """Current state, for `restore`."""
        return State(self._time, self._step, self._waiting, self._forgotten + len(self._changes))

    def restore(self, state: State) -> None:
        """Restore a state, which must not be older than the last state passed to `forget`."""
        while self._forgotten + len(self._changes) > state.changes:
            change = self._changes.pop()
            self._copy_shared_map()
            self._depths[change.where] = change.depths
        self._time, self._step, self._waiting, _ = state

    def forget(self, oldest: State) -> None:
        """Drop the data that are needed only to restore states older than this state."""
        while self._forgotten < oldest.changes:
            self._changes.popleft()
            self._forgotten += 1

    def aside(self) -> "Removal":
        """Return a copy for queries. It cannot be restored to earlier states."""
        twin = copy.copy(self)
        twin._changes = deque()
        twin._forgotten = 0
        twin._shared = True
        return twin

    # --- time steps

    @property
    def time(self) -> float:
        """Time of the newest sample, s."""
        return self._time

    def steps(self, times: Floats) -> Iterator[slice]:
        """Yield the slices of ascending `times` (n,) that each lie within one time step.

        Before each slice, the map is updated with all material that was removed in earlier steps.
        """
        # A margin of one millionth prevents rounding from moving a sample into another step.
        numbers = np.floor(times * _STEPS_HZ + 1e-6)
        edges = (np.flatnonzero(np.diff(numbers)) + 1).tolist()
        for begin, end in zip((0, *edges), (*edges, len(times)), strict=True):
            if numbers[begin] != self._step:
                self._update_map()
                self._step = float(numbers[begin])
            yield slice(begin, end)

    def depth(self, along: Floats, across: Floats) -> Floats:
        """Return the removed depth at points (n,), m; 0 outside the map."""
        rows, columns = self._depths.shape
        row, row_share, in_rows = _cell_of(along / self.spacing, rows)
        column, column_share, in_columns = _cell_of(across / self.spacing, columns)
        d = self._depths
        near = d[row, column] * (1.0 - column_share) + d[row, column + 1] * column_share
        far = d[row + 1, column] * (1.0 - column_share) + d[row + 1, column + 1] * column_share
        return np.where(in_rows & in_columns, near * (1.0 - row_share) + far * row_share, 0.0)

    def since(self, times: Floats) -> Floats:
        """Return the time since the previous sample, s, for ascending `times` (n,), and advance to the last time.

        All contact points of a sample have equal times.
        """
        samples = times[:: self._points]
        since = np.diff(samples, prepend=self._time)
        self._time = float(samples[-1])
        return np.repeat(np.where(since > _GAP_S, 0.0, since), self._points)

    def wear(self, along: Floats, across: Floats, work: Floats) -> None:
        """Record the wear of one time step at points (n,), m.

        `work` (n,) is the product of force, sliding speed and time at each point, N·m. Its force is computed as if
        the point carried the entire load.
        """
        wears = work > 0.0
        if wears.any():
            # Pressure is force per area, and a point acts on its share of the area.
            volume = self._coefficient * work[wears] / self._points
            self._waiting += (RemovedVolume(along[wears], across[wears], volume),)

    # --- the map

    def removed(self) -> Floats:
        """Return the removed depths (rows, columns) so far, m."""
        twin = self.aside()
        twin._update_map()
        return twin._depths

    def _copy_shared_map(self) -> None:
        if self._shared:
            self._depths, self._shared = self._depths.copy(), False

    def _update_map(self) -> None:
        """Enter the waiting volumes into the map."""
        if not self._waiting:
            return
        along, across, volume = map(np.concatenate, zip(*self._waiting, strict=True))
        self._waiting = ()
        row, row_share, in_rows = _cell_of(along / self.spacing, self._depths.shape[0])
        column, column_share, in_columns = _cell_of(across / self.spacing, self._depths.shape[1])
        depth = np.where(in_rows & in_columns, volume / self.spacing**2, 0.0)
        first_row, first_column = int(row.min()), int(column.min())
        height, width = int(row.max()) - first_row + 2, int(column.max()) - first_column + 2
        sums = np.zeros(height * width)
        index = (row - first_row) * width + column - first_column
        for down, part in ((0, 1.0 - row_share), (1, row_share)):
            for left, share in ((0, 1.0 - column_share), (1, column_share)):
                sums += np.bincount(index + down * width + left, depth * part * share, height * width)
        self._add(first_row, first_column, _spread(sums.reshape(height, width), self._disc))

    def _add(self, first_row: int, first_column: int, depths: Floats) -> None:
        """Add depths to the map. They start half the width of the disc before these nodes."""
        reach = len(self._disc) // 2
        top, left = first_row - reach, first_column - reach
        here = (slice(max(top, 0), top + depths.shape[0]), slice(max(left, 0), left + depths.shape[1]))
        self._copy_shared_map()
        old = self._depths[here]
        self._changes.append(_Change(here, old.copy()))
        skip_rows, skip_columns = max(-top, 0), max(-left, 0)
        old += depths[skip_rows : skip_rows + old.shape[0], skip_columns : skip_columns + old.shape[1]]


def _cell_of(offset: Floats, nodes: int) -> tuple[NDArray[np.intp], Floats, NDArray[np.bool_]]:
    """Return the cells that contain offsets (n,) from the centre, given in cells.

    The result is the node before each offset, the share of the next node, and whether the point is on the map.
    """
    index = offset + 0.5 * (nodes - 1)
    node = np.floor(index).clip(0.0, nodes - 2.0)
    return node.astype(np.intp), (index - node).clip(0.0, 1.0), (index >= 0.0) & (index <= nodes - 1.0)


def _disc(radius: float) -> Floats:
    """Return the weights (k, k), k odd, of the cells of a disc with a radius in cells. Their sum is 1."""
    reach = math.ceil(max(radius - 0.5, 0.0))
    fine = 16
    """Number of subdivisions of a cell in each direction. Chosen: the area of the disc is then accurate to one
    percent.
    """
    ticks = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
    inside = ticks[:, None] ** 2 + ticks**2 <= max(radius, 0.5) ** 2
    cells: Floats = inside.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).sum(axis=(1, 3)) / inside.sum()
    return cells


def _spread(depths: Floats, disc: Floats) -> Floats:
    """Spread each depth over a disc.

    The result is larger than the input by half the width of the disc on every side.
    """
    k = len(disc)
    out = np.zeros((depths.shape[0] + k - 1, depths.shape[1] + k - 1))
    for row, column in np.argwhere(disc > 0.0).tolist():
        out[row : row + depths.shape[0], column : column + depths.shape[1]] += disc[row, column] * depths
    return out
