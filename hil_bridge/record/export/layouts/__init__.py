"""Layouts of panels for programs that open recordings, as files of those programs."""

from importlib import resources
from pathlib import Path

from hil_bridge.record.files import check_place, write_whole

LAYOUTS = {
    name: f"hil-bridge.{name}"
    for name in ("foxglove.json", "plotjuggler.xml", "ros2-foxglove.json", "ros2-plotjuggler.xml")
}
"""Files of this package, and the names under which they are written."""


def content(name: str) -> bytes:
    """A layout by the name of its file here."""
    return resources.files(__package__).joinpath(name).read_bytes()


def write(folder: Path, overwrite: bool) -> list[Path]:
    """Put all layouts into a folder. Raises ConfigError where one is there already or cannot be written."""
    places = {name: folder / written for name, written in LAYOUTS.items()}
    for place in places.values():
        check_place(place, overwrite)
    for name, place in places.items():
        write_whole(place, content(name), overwrite)
    return [*places.values()]
