"""Heights of a surface, read from a text file that the operator supplies."""

import math
import os
import stat

import numpy as np

from emulators.surface.shapes import Floats

FILE_LIMIT_BYTES = 1 << 22
"""Maximum size of the file, bytes. Chosen: the largest grid with 16 characters per number."""
HEIGHTS_LIMIT = 1 << 18
"""Maximum number of heights in the file. Chosen: 512 by 512."""
HEIGHT_LIMIT_MM = 10_000.0
"""Maximum absolute height, mm. Chosen: more than the height of a cell."""


def read_height_map(name: str) -> Floats:
    """Return the heights (rows, columns), m, read from a file of heights in mm.

    Each line of the file is a row of numbers separated by spaces, tabs or commas. Empty lines and everything after a
    `#` are ignored. Raises ValueError, in one line, for a file that cannot be read or does not contain a grid.
    """
    rows: list[list[float]] = []
    count = 0
    for number, line in enumerate(_text(name).splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        rows.append([_height(word, name, number) for word in words])
        count += len(words)
        if len(words) != len(rows[0]):
            raise ValueError(
                f"height_map_file {name}, line {number}: {len(words)} heights, but {len(rows[0])} in the first row; "
                "give each row the same number"
            )
        if count > HEIGHTS_LIMIT:
            raise ValueError(
                f"height_map_file {name}: more than {HEIGHTS_LIMIT} heights; give a coarser grid"
            )
    if not rows:
        raise ValueError(f"height_map_file {name}: no heights; give a row of numbers in mm a line")
    return np.array(rows) / 1000.0


def _text(name: str) -> str:
    try:
        # opening a pipe without a writer must not block
        with os.fdopen(os.open(name, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # for a folder, reading raises an OSError
                raise ValueError("a pipe or a device; name an ordinary file")
            data = file.read(FILE_LIMIT_BYTES + 1)
        if len(data) > FILE_LIMIT_BYTES:
            raise ValueError(f"longer than {FILE_LIMIT_BYTES} bytes")
        return data.decode()
    except OSError as error:
        raise ValueError(f"height_map_file: cannot read {name}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"height_map_file {name} is not a UTF-8 text file") from error
    except ValueError as error:  # too long, not an ordinary file, or a NUL in the name
        raise ValueError(f"height_map_file: cannot read {name!r}: {error}") from error


def _height(word: str, name: str, number: int) -> float:
    try:
        height = float(word)
    except ValueError:
        height = math.nan
    if not abs(height) <= HEIGHT_LIMIT_MM:
        raise ValueError(
            f"height_map_file {name}, line {number}: {word[:40]!r} is not a height in mm; allowed: numbers within "
            f"±{HEIGHT_LIMIT_MM:g} mm"
        )
    return height
