"""Panel layouts for programs that open recordings, in the file formats of those programs."""

from importlib import resources

LAYOUTS = ("foxglove.json", "plotjuggler.xml", "ros2-foxglove.json", "ros2-plotjuggler.xml")
"""Names of the layout files in this package."""


def content(name: str) -> bytes:
    """Return the content of a layout file."""
    return resources.files(__package__).joinpath(name).read_bytes()
