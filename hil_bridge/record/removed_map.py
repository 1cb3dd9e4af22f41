"""Map of the material removed from an emulated surface, as a JSON attachment of a recording."""

import math
from typing import TypeAlias

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

REMOVED_NAME = "removed.json"
"""Name of the attachment."""
MEDIA_TYPE = "application/json"
CELLS_LIMIT = 1 << 16
"""Most cells; a larger map is made coarser. Chosen: more than a picture shows, about 0.5 MB of text."""
BYTES_LIMIT = 1 << 21
"""Longest text that is read. Chosen: twice the longest that is written."""
DEPTH_LIMIT_UM = 1e9
"""A depth lies below this, µm. Chosen: a kilometre."""
_DIGITS = 3
"""Decimal places of a depth in µm. Chosen: a nanometre."""


class RemovedMap(Struct, frozen=True):
    """Depths on a grid."""

    origin_m: tuple[float, float]
    """x and y of `depths_um[0][0]` in the robot base frame."""
    direction: tuple[float, float]
    """Unit vector of the path in base x and y: rows follow each other along it, the numbers of a row to its left."""
    corner_m: tuple[float, float]
    """Path coordinate of `depths_um[0][0]`, and its distance to the left of the path."""
    spacing_m: float
    """From one row or number to the next."""
    depths_um: tuple[tuple[float, ...], ...]
    """Removed depths, µm."""

    def as_json(self) -> bytes:
        """For an attachment."""
        return msgspec.json.encode(self)

    @property
    def depths(self) -> Array:
        """(rows, columns), µm."""
        return np.array(self.depths_um)


def pack_map(
    origin: tuple[float, float],
    direction: tuple[float, float],
    corner: tuple[float, float],
    spacing: float,
    depths: Array,
) -> RemovedMap:
    """Pack a map from m, cut to the part where something is gone, with a cell about it. It is halved until it is small
    enough. Something must be gone.
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
    shown = np.round((part * 1e6).clip(max=0.5 * DEPTH_LIMIT_UM), _DIGITS).tolist()
    return RemovedMap(
        (x + along * dx - across * dy, y + along * dy + across * dx),
        direction,
        (corner[0] + along, corner[1] + across),
        spacing,
        tuple(map(tuple, shown)),
    )


def from_json(data: bytes) -> RemovedMap:
    """Read the map of an attachment. Raises ValueError with the reason for an invalid one."""
    if len(data) > BYTES_LIMIT:
        raise ValueError(f"longer than {BYTES_LIMIT} bytes")
    try:
        found = msgspec.json.decode(data, type=RemovedMap)
    except RecursionError as error:
        raise ValueError("brackets within brackets without end") from error
    lengths = {len(row) for row in found.depths_um}
    if len(lengths) != 1 or lengths == {0} or len(found.depths_um) * max(lengths) > 4 * CELLS_LIMIT:
        raise ValueError("its rows are no grid, or too many")
    places = (*found.origin_m, *found.direction, *found.corner_m, found.spacing_m)
    if not all(map(math.isfinite, places)) or not 0.0 < found.spacing_m < 1e3:
        raise ValueError("its place is no place")
    depths = found.depths
    if not ((depths >= 0.0) & (depths < DEPTH_LIMIT_UM)).all():
        raise ValueError("a depth is negative or too large")
    return found
