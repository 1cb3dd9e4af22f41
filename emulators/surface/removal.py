"""Removal of material by a tool that slides under pressure: what is gone lowers the surface for the next pass.

Preston's law: depth per way = coefficient · pressure. Source: Preston, The theory and design of plate glass polishing
machines, 1927. The material that a contact point removes goes from a disc of its share of the face's area. The map of
what is gone changes the depth of a place, not the normal there.

The map is brought up to date after each step of time, not after each sample. So the result depends on the motion alone,
not on how the samples were cut into blocks.
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
"""Most cells of a map. Chosen: 8 MiB."""
RADIUS_LIMIT_CELLS = 24.0
"""A contact point covers a disc of at most so many cells as radius. Chosen: some 1800 sums of small arrays a step."""
_STEPS_HZ = 100
"""Steps of time a second. Chosen: a tool at 100 mm/s continues by a cell of the usual size."""
_GAP_S = 0.1
"""Chosen: after a longer gap between two samples the way between them is not known, and removes nothing."""
_M_PER_UM_N_CM2_M = 1e-10
"""A µm for a N/cm² and a m of way, as m for a N/m² and a m."""


@dataclass(frozen=True, slots=True)
class RemovalProfile:
    """How much a sliding tool removes."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    um_per_n_cm2_m: float = setting(
        0.0,
        Mark.ASSUMED,
        "depth removed by a pressure of 1 N/cm² over 1 m of way, µm; 0 for a surface that does not wear",
        between(0.0, 1e6),
    )
    cell_mm: float = setting(1.0, Mark.CHOSEN, "spacing of the map of what is removed", above(0.0), unit="mm")
    length_mm: float = setting(
        400.0, Mark.CHOSEN, "length of that map, its middle at path coordinate 0", above(0.0), unit="mm"
    )
    width_mm: float = setting(
        200.0, Mark.CHOSEN, "width of that map across the path, about the middle", above(0.0), unit="mm"
    )
    point_radius_mm: float = setting(
        5.0,
        Mark.CHOSEN,
        "radius of the disc on which a tool without a face works",
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
        """Nodes of the map along the path; infinite where there would be too many to count."""
        return _nodes(self.length_mm, self.cell_mm)

    @property
    def columns(self) -> float:
        """Nodes of the map across the path, as `rows`."""
        return _nodes(self.width_mm, self.cell_mm)


def _nodes(length: float, cell: float) -> float:
    cells = length / cell
    return 2 * math.ceil(0.5 * cells) + 1 if cells < CELLS_LIMIT else math.inf


class Removed(NamedTuple):
    """A map of what has been removed."""

    origin: tuple[float, float]
    """Base x and y of `depths[0, 0]`, m."""
    direction: tuple[float, float]
    """Unit vector of the path in base x and y: rows follow each other along it, columns to its left."""
    corner: tuple[float, float]
    """Path coordinate of `depths[0, 0]`, and how far to the left of the path it lies, m."""
    spacing: float
    """From one row or column to the next, m."""
    depths: Floats
    """(rows, columns), m."""


class Worn(NamedTuple):
    """Forces and ways at some contact points, each array (n,)."""

    along: Floats
    """m"""
    across: Floats
    """m"""
    volume: Floats
    """m³"""


class State(NamedTuple):
    """Where a removal stood, to go back to."""

    time: float
    step: float
    waiting: tuple[Worn, ...]
    changes: int


class _Change(NamedTuple):
    """A part of the map as it was."""

    where: tuple[slice, slice]
    depths: Floats


class Removal:
    """The map, and what waits to come into it."""

    def __init__(self, profile: RemovalProfile, points: int, area: float | None) -> None:
        """Create a map for a tool with this many contact points on a face of this area, m²; None without a face.

        Raises ValueError for a map that is too fine for the tool.
        """
        assert profile.rows < math.inf
        assert profile.columns < math.inf
        self.spacing = profile.cell_mm / 1000.0
        """Of the map, m."""
        self._points = points
        self._area = math.pi * (profile.point_radius_mm / 1000.0) ** 2 if area is None else area
        self._coefficient = profile.um_per_n_cm2_m * _M_PER_UM_N_CM2_M
        radius = math.sqrt(self._area / points / math.pi) / self.spacing
        if radius > RADIUS_LIMIT_CELLS:
            raise ValueError(
                f"surface.removal.cell_mm of {profile.cell_mm:g} is too fine for a contact point of "
                f"{radius * profile.cell_mm:.3g} mm radius; take at least "
                f"{radius / RADIUS_LIMIT_CELLS * profile.cell_mm:.3g}"
            )
        self._disc = _disc(radius)
        self._depths = np.zeros((int(profile.rows), int(profile.columns)))
        self._shared = False
        """Another removal has the same map: it must be copied before it changes."""
        self._time = -math.inf
        self._step = -math.inf
        self._waiting: tuple[Worn, ...] = ()
        """Depths that the present step has removed so far."""
        self._changes: deque[_Change] = deque()
        self._forgotten = 0
        """Changes that were made and cannot be undone any more."""

    # --- going back

    @property
    def state(self) -> State:
        """For `restore`."""
        return State(self._time, self._step, self._waiting, self._forgotten + len(self._changes))

    def restore(self, state: State) -> None:
        """Be as at the time of that state, which is not older than the one of `forget`."""
        while self._forgotten + len(self._changes) > state.changes:
            change = self._changes.pop()
            self._own()
            self._depths[change.where] = change.depths
        self._time, self._step, self._waiting, _ = state

    def forget(self, oldest: State) -> None:
        """Nothing older than this state will be restored."""
        while self._forgotten < oldest.changes:
            self._changes.popleft()
            self._forgotten += 1

    def aside(self) -> "Removal":
        """Return a copy for questions, which cannot go back."""
        twin = copy.copy(self)
        twin._changes = deque()
        twin._forgotten = 0
        twin._shared = True
        return twin

    # --- the course of time

    @property
    def time(self) -> float:
        """Of the newest sample, s."""
        return self._time

    def steps(self, times: Floats) -> Iterator[slice]:
        """Return the parts of ascending `times` (n,) that lie in one step each.

        Before it returns a part, it enters into the map everything that was removed in earlier steps.
        """
        # Samples are numbered; a millionth keeps rounding from moving one into another step.
        numbers = np.floor(times * _STEPS_HZ + 1e-6)
        edges = (np.flatnonzero(np.diff(numbers)) + 1).tolist()
        for begin, end in zip((0, *edges), (*edges, len(times)), strict=True):
            if numbers[begin] != self._step:
                self._work_in()
                self._step = float(numbers[begin])
            yield slice(begin, end)

    def depth(self, along: Floats, across: Floats) -> Floats:
        """Return the removed depth at places (n,), m; nothing beyond the map."""
        rows, columns = self._depths.shape
        row, row_share, in_rows = _cell_of(along / self.spacing, rows)
        column, column_share, in_columns = _cell_of(across / self.spacing, columns)
        d = self._depths
        near = d[row, column] * (1.0 - column_share) + d[row, column + 1] * column_share
        far = d[row + 1, column] * (1.0 - column_share) + d[row + 1, column + 1] * column_share
        return np.where(in_rows & in_columns, near * (1.0 - row_share) + far * row_share, 0.0)

    def since(self, times: Floats) -> Floats:
        """Time since the sample before, s, of each of ascending `times` (n,), where all points of a sample have one
        time. They are passed then.
        """
        samples = times[:: self._points]
        since = np.diff(samples, prepend=self._time)
        self._time = float(samples[-1])
        return np.repeat(np.where(since > _GAP_S, 0.0, since), self._points)

    def wear(self, along: Floats, across: Floats, work: Floats) -> None:
        """Places (n,) of one step, m, and the product of force, sliding speed and time there, N·m, each force as if its
        contact point bore all.
        """
        worn = work > 0.0
        if worn.any():
            # Pressure is force over area, and a point works on its share of that area.
            volume = self._coefficient * work[worn] / self._points
            self._waiting += (Worn(along[worn], across[worn], volume),)

    # --- the map

    def removed(self) -> Floats:
        """Depths (rows, columns), m, of all that is gone by now."""
        twin = self.aside()
        twin._work_in()
        return twin._depths

    def _own(self) -> None:
        if self._shared:
            self._depths, self._shared = self._depths.copy(), False

    def _work_in(self) -> None:
        """Bring what waits into the map."""
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
        place = (row - first_row) * width + column - first_column
        for down, part in ((0, 1.0 - row_share), (1, row_share)):
            for left, share in ((0, 1.0 - column_share), (1, column_share)):
                sums += np.bincount(place + down * width + left, depth * part * share, height * width)
        self._add(first_row, first_column, _spread(sums.reshape(height, width), self._disc))

    def _add(self, first_row: int, first_column: int, depths: Floats) -> None:
        """Lower the map by depths that begin before these nodes, by half the width of the disc."""
        reach = len(self._disc) // 2
        top, left = first_row - reach, first_column - reach
        here = (slice(max(top, 0), top + depths.shape[0]), slice(max(left, 0), left + depths.shape[1]))
        self._own()
        old = self._depths[here]
        self._changes.append(_Change(here, old.copy()))
        skip_rows, skip_columns = max(-top, 0), max(-left, 0)
        old += depths[skip_rows : skip_rows + old.shape[0], skip_columns : skip_columns + old.shape[1]]


def _cell_of(place: Floats, nodes: int) -> tuple[NDArray[np.intp], Floats, NDArray[np.bool_]]:
    """For places (n,) in steps from the middle: the node before each, the share of the next one, and whether the map
    reaches so far.
    """
    place = place + 0.5 * (nodes - 1)
    node = np.floor(place).clip(0.0, nodes - 2.0)
    return node.astype(np.intp), (place - node).clip(0.0, 1.0), (place >= 0.0) & (place <= nodes - 1.0)


def _disc(radius: float) -> Floats:
    """Weights (k, k), k odd, of the cells of a disc of a radius in cells; their sum is 1."""
    reach = math.ceil(max(radius - 0.5, 0.0))
    fine = 16
    """Places a cell each way. Chosen: the disc's area is then right within a percent."""
    ticks = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
    inside = ticks[:, None] ** 2 + ticks**2 <= max(radius, 0.5) ** 2
    cells: Floats = inside.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).sum(axis=(1, 3)) / inside.sum()
    return cells


def _spread(depths: Floats, disc: Floats) -> Floats:
    """Each depth spread over a disc: larger by half the disc's width on every side."""
    k = len(disc)
    out = np.zeros((depths.shape[0] + k - 1, depths.shape[1] + k - 1))
    for row, column in np.argwhere(disc > 0.0).tolist():
        out[row : row + depths.shape[0], column : column + depths.shape[1]] += disc[row, column] * depths
    return out
