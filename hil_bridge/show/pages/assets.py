"""The scripts and style sheets that a page is made of. uPlot's come from the build, see `hatch_build.py`."""

from functools import cache
from importlib.resources import files

from hil_bridge.errors import ConfigError

UPLOT_LICENSE = "uPlot-LICENSE.txt"
_FROM_BUILD = {"uPlot.iife.js": "vendor/uPlot.iife.js", "uPlot.min.css": "vendor/uPlot.min.css"}


@cache
def asset(name: str) -> str:
    """A file of this room by its name: `charts.js`, `pages.css`, `uPlot.iife.js`, `uPlot.min.css`, the licence.

    Raises ConfigError where the installation lacks uPlot.
    """
    path = files("hil_bridge.show.pages").joinpath(_FROM_BUILD.get(name, name))
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(
            f"{path} is missing: install hil-bridge by pip, whose build puts it there"
        ) from None


def chart_script() -> str:
    """uPlot with its licence, and our charts on it: one script, which defines `HilCharts`."""
    return "\n".join(
        (
            f"/*\n{asset(UPLOT_LICENSE)}*/",
            asset("uPlot.iife.js"),
            asset("marks.js"),
            asset("pointer.js"),
            asset("charts.js"),
        )
    )


def style() -> str:
    """The style sheet of every page, uPlot's included."""
    return f"{asset('uPlot.min.css')}\n{asset('pages.css')}"
