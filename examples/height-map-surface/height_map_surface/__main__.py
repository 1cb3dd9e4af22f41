"""Write files to try the surface with: `python -m height_map_surface FOLDER`."""

import sys
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

AMPLITUDE_MM, PERIOD_MM, RADIUS_MM = 1.5, 60.0, 150.0


def write_waves(path: Path) -> None:
    """Write a 16-bit greyscale image, 241 by 41 pixels of 1 mm: waves along the path, from 0 to twice the amplitude."""
    along = np.arange(-120, 121)
    heights = AMPLITUDE_MM * (1.0 + np.sin(2.0 * np.pi * along / PERIOD_MM))
    row = np.round(heights / (2.0 * AMPLITUDE_MM) * 65535.0).astype(np.uint16)
    Image.fromarray(np.tile(row, (41, 1))).save(path, format="PNG")


def write_dome(path: Path, ascii_text: bool = False) -> None:
    """Write an STL file of a dome of 240 by 80 mm: a section of a sphere, its crest at 0, in triangles of 4 mm."""
    x, y = np.meshgrid(np.arange(-120.0, 121.0, 4.0), np.arange(-40.0, 41.0, 4.0), indexing="ij")
    z = np.sqrt(RADIUS_MM**2 - x**2 - y**2) - RADIUS_MM
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
    mesh = trimesh.Trimesh(np.stack((x, y, z), axis=-1).reshape(-1, 3), faces, process=False)
    mesh.export(path, file_type="stl_ascii" if ascii_text else "stl")


SITE = """\
[run]
duration_s = 1.5
[robot]
emulated = "egm"
[task]
approach_depth_limit_mm = 25  # the side of the dome lies 17.5 mm below the start
[cell]
surface_kind = "height-map"
start_position_mm = [900, -60, 595]
[cell.height_map]
{shape}
"""


def write_all(folder: Path) -> None:
    """Write both files, with a configuration each."""
    folder.mkdir(parents=True, exist_ok=True)
    write_waves(folder / "waves.png")
    write_dome(folder / "dome.stl")
    waves = f'image_file = "waves.png"\nwhite_mm = {2.0 * AMPLITUDE_MM}'
    (folder / "waves.toml").write_text(SITE.format(shape=waves), encoding="utf-8")
    dome = 'stl_file = "dome.stl"\nsection_mm = [-100, -20, 100, 20]\nspacing_mm = 2.0'
    (folder / "dome.toml").write_text(SITE.format(shape=dome), encoding="utf-8")


if __name__ == "__main__":
    write_all(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
