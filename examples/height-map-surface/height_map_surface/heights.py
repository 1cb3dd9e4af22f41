"""Read heights on a grid from files of other programs. Errors are ValueErrors in one line: file, problem, remedy.

A grid has a row for each position along the path and a column for each position across it, from right to left, in m.
"""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from emulators.seams import Floats

CELLS_LIMIT = 1 << 18
"""Maximum number of heights in a grid. Chosen: 512 by 512, as for hil-bridge's own height maps."""
TRIANGLES_LIMIT = 200_000
"""Maximum number of triangles in an STL file. Chosen: takes some seconds to read."""
FILE_LIMIT_BYTES = 1 << 26
"""Maximum file size. Chosen: an ASCII file with that many triangles."""
GREYS = {"L": 255.0, "I;16": 65535.0}
"""Value of white by Pillow's name of the mode: 8 and 16 bits."""


def from_image(name: str, white_mm: float) -> Floats:
    """Return the heights of a greyscale image: black is 0, white is `white_mm`. The path runs right; up is left."""
    _check_size(name)
    try:
        with Image.open(name, formats=("PNG",)) as image:
            if image.mode not in GREYS:
                raise ValueError(f"{name} is an image of mode {image.mode}; save it as greyscale")
            _check_cells(name, *image.size)
            pixels = np.asarray(image, dtype=np.float64) / GREYS[image.mode]
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{name} cannot be read as a PNG: {_first_line(error)}") from error
    return pixels[::-1].T * (white_mm / 1000.0)


def from_stl(name: str, section_mm: tuple[float, ...], spacing_mm: float) -> Floats:
    """Return the heights of a part seen from above, on a grid over the section x0 y0 x1 y1 of it, mm.

    Without a section the grid covers the entire part. The path runs in the part's direction x. Where there is no part
    below, the height is that of its lowest point.
    """
    _check_size(name)
    try:
        mesh = trimesh.load_mesh(name, file_type="stl", process=False)
        triangles = np.asarray(mesh.triangles, dtype=np.float64)
    except Exception as error:  # the library has no class for its errors
        raise ValueError(f"{name} cannot be read as an STL file: {_first_line(error)}") from error
    if not len(triangles) or not np.isfinite(triangles).all():
        raise ValueError(f"{name} contains no triangles with finite corners; export the part again")
    if len(triangles) > TRIANGLES_LIMIT:
        raise ValueError(f"{name} has {len(triangles)} triangles; reduce it to {TRIANGLES_LIMIT}")
    corners = triangles.reshape(-1, 3)
    x0, y0, x1, y1 = section_mm or (*corners[:, :2].min(axis=0), *corners[:, :2].max(axis=0))
    _check_cells(name, (x1 - x0) / spacing_mm + 1, (y1 - y0) / spacing_mm + 1)
    along = np.arange(x0, x1 + 0.5 * spacing_mm, spacing_mm)
    across = np.arange(y0, y1 + 0.5 * spacing_mm, spacing_mm)
    return _seen_from_above(triangles, along, across) / 1000.0


def _seen_from_above(triangles: Floats, along: Floats, across: Floats) -> Floats:
    """Return the greatest height of any triangle above each grid point, in the triangles' unit."""
    heights = np.full((len(along), len(across)), triangles[:, :, 2].min())
    for a, b, c in triangles:
        span = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if span == 0.0:
            continue  # it stands upright
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        rows = slice(np.searchsorted(along, low[0] - 1e-9), np.searchsorted(along, high[0] + 1e-9))
        columns = slice(np.searchsorted(across, low[1] - 1e-9), np.searchsorted(across, high[1] + 1e-9))
        x, y = along[rows, None] - a[0], across[None, columns] - a[1]
        u = (x * (c[1] - a[1]) - y * (c[0] - a[0])) / span
        v = (y * (b[0] - a[0]) - x * (b[1] - a[1])) / span
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9)
        height = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])
        part = heights[rows, columns]
        np.maximum(part, height, out=part, where=inside)
    return heights


def _check_size(name: str) -> None:
    try:
        size = Path(name).stat().st_size
    except (OSError, ValueError) as error:
        raise ValueError(f"{name} cannot be read: {_first_line(error)}") from error
    if size > FILE_LIMIT_BYTES:
        raise ValueError(f"{name} is longer than {FILE_LIMIT_BYTES} bytes; give a smaller one")


def _check_cells(name: str, rows: float, columns: float) -> None:
    if not (rows >= 2 and columns >= 2 and rows * columns <= CELLS_LIMIT):
        raise ValueError(
            f"{name} makes a grid of {rows:.0f} by {columns:.0f} heights; choose one of 2 by 2 to {CELLS_LIMIT} in all"
        )


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
