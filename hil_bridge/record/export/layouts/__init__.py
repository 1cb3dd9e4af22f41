"""Layouts of panels for programs that open recordings, as files of those programs."""

from importlib import resources

LAYOUTS = ("foxglove.json", "plotjuggler.xml", "ros2-foxglove.json", "ros2-plotjuggler.xml")
"""Files of this package."""


def content(name: str) -> bytes:
    """Return the content of a layout's file."""
    return resources.files(__package__).joinpath(name).read_bytes()
