"""Map of the material removed from an emulated surface, as a JSON attachment of a recording."""

import math
from typing import TypeAlias

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

REMOVED_NAME = "removed.json"
"""Name of the attachment that holds the map."""
MEDIA_TYPE = "application/json"
CELLS_LIMIT = 1 << 16
"""Maximum number of cells; a larger map is coarsened. Chosen: more than a picture shows, about 0.5 MB of text."""
BYTES_LIMIT = 1 << 21
"""Maximum number of bytes that are read. Chosen: twice the length of the longest text that is written."""
DEPTH_LIMIT_UM = 1e9
"""Upper bound of a depth, µm. Chosen: 1 km."""
_SAME_DIRECTION = 1e-6
"""Largest distance between two unit vectors of the same direction. Chosen: far below a cell of any map."""
_DIGITS = 3
"""Decimal places of a depth in µm. Chosen: 1 nm."""


class RemovedMap(Struct, frozen=True):
    """Depths of removed material on a grid."""

    origin_m: tuple[float, float]
    """Position of `depths_um[0][0]` in base x and y, m."""
    direction: tuple[float, float]
    """Unit vector of the path in base x and y. Successive rows follow the path; successive numbers in a row lie
    further to the left of it.
    """
    corner_m: tuple[float, float]
    """Path coordinate of `depths_um[0][0]`, m, and its distance to the left of the path, m."""
    spacing_m: float
    """Distance between neighbouring rows or numbers, m."""
    depths_um: tuple[tuple[float, ...], ...]
    """Depths of removed material, µm."""

    def as_json(self) -> bytes:
        """Encode as JSON, for an attachment."""
        return msgspec.json.encode(self)

    @property
    def depths(self) -> Array:
        """Depths as an array (rows, columns), µm."""
        return np.array(self.depths_um)

    def turned_to(self, direction: tuple[float, float], start: tuple[float, float]) -> "RemovedMap | None":
        """Return the map with this direction, in base x and y, and coordinates from a start point in base x and y, m.
        Return None if the directions differ by other than quarter turns, because the cells would not match.
        """
        (dx, dy), (ex, ey) = self.direction, direction
        turns = round(math.atan2(dx * ey - dy * ex, dx * ex + dy * ey) / (math.pi / 2))
        c, s = round(math.cos(turns * math.pi / 2)), round(math.sin(turns * math.pi / 2))
        if math.dist(direction, (c * dx - s * dy, s * dx + c * dy)) > _SAME_DIRECTION:
            return None
        last_row, last_column = (self.spacing_m * (length - 1) for length in self.depths.shape)
        ends = [(along, across) for along in (0.0, last_row) for across in (0.0, last_column)]
        x, y = self.origin_m
        corners = [(x + along * dx - across * dy, y + along * dy + across * dx) for along, across in ends]

        def place(corner: tuple[float, float]) -> tuple[float, float]:
            east, north = corner[0] - start[0], corner[1] - start[1]
            return east * ex + north * ey, north * ex - east * ey

        first = min(corners, key=lambda corner: sum(place(corner)))
        depths = np.rot90(self.depths, -turns).tolist()
        return RemovedMap(first, direction, place(first), self.spacing_m, tuple(map(tuple, depths)))


def pack_map(
    origin: tuple[float, float],
    direction: tuple[float, float],
    corner: tuple[float, float],
    spacing: float,
    depths: Array,
) -> RemovedMap:
    """Pack a map, given in m, into a `RemovedMap`.

    The map is cropped to the removed part with a margin of one cell, and coarsened to the size limit. Some material
    must have been removed.
    """
    rows, columns = (np.flatnonzero(depths.any(axis=axis)) for axis in (1, 0))
    top, left = max(int(rows[0]) - 1, 0), max(int(columns[0]) - 1, 0)
    part = depths[top : int(rows[-1]) + 2, left : int(columns[-1]) + 2]
    along, across = top * spacing, left * spacing
    while part.size > CELLS_LIMIT:
        part = np.pad(part, [(0, side % 2) for side in part.shape], mode="edge")
        part = 0.25 * (part[::2, ::2] + part[1::2, ::2] + part[::2, 1::2] + part[1::2, 1::2])
        along, across, spacing = along + 0.5 * spacing, across + 0.5 * spacing, 2.0 * spacing
    (x, y), (dx, dy) = origin, direction
    depths_um = np.round((part * 1e6).clip(max=0.5 * DEPTH_LIMIT_UM), _DIGITS).tolist()
    return RemovedMap(
        (x + along * dx - across * dy, y + along * dy + across * dx),
        direction,
        (corner[0] + along, corner[1] + across),
        spacing,
        tuple(map(tuple, depths_um)),
    )


def from_json(data: bytes) -> RemovedMap:
    """Read the map of an attachment. Raises ValueError with the reason if the attachment is invalid."""
    if len(data) > BYTES_LIMIT:
        raise ValueError(f"longer than {BYTES_LIMIT} bytes")
    try:
        removed = msgspec.json.decode(data, type=RemovedMap)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    lengths = {len(row) for row in removed.depths_um}
    if len(lengths) != 1 or lengths == {0} or len(removed.depths_um) * max(lengths) > 4 * CELLS_LIMIT:
        raise ValueError("its rows differ in length, or are too many")
    places = (*removed.origin_m, *removed.direction, *removed.corner_m, removed.spacing_m)
    if not all(map(math.isfinite, places)) or not 0.0 < removed.spacing_m < 1e3:
        raise ValueError("its origin or direction is invalid")
    depths = removed.depths
    if not ((depths >= 0.0) & (depths < DEPTH_LIMIT_UM)).all():
        raise ValueError("a depth is out of range")
    return removed
