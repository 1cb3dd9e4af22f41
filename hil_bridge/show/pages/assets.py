"""Scripts and style sheets of pages. The build adds the files of uPlot; see `hatch_build.py`."""

import json
from functools import cache
from importlib.resources import files

from hil_bridge.errors import ConfigError
from hil_bridge.show.pages.svg import PALETTES

UPLOT_LICENSE = "uPlot-LICENSE.txt"
_FROM_BUILD = {"uPlot.iife.js": "vendor/uPlot.iife.js", "uPlot.min.css": "vendor/uPlot.min.css"}


@cache
def asset(name: str) -> str:
    """Return an asset by name: `charts.js`, `pages.css`, `uPlot.iife.js`, `uPlot.min.css`, the licence.

    Raises ConfigError if the installation lacks uPlot.
    """
    path = files("hil_bridge.show.pages").joinpath(_FROM_BUILD.get(name, name))
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(f"{path} is missing: install hil-bridge with pip, which builds it") from None


def chart_script() -> str:
    """Return one script with uPlot, its licence and the charts; it defines `HilCharts`."""
    return "\n".join(
        (
            f"/*\n{asset(UPLOT_LICENSE)}*/",
            asset("uPlot.iife.js"),
            asset("marks.js"),
            asset("pointer.js"),
            asset("charts.js"),
        )
    )


def cell_script() -> str:
    """Return one script that draws the cell in three dimensions; it defines `HilCell`."""
    palettes = f"var HilPalettes = {json.dumps(PALETTES)};"
    return "\n".join((palettes, *map(asset, ("space.js", "cell_parts.js", "orbit.js", "cell.js"))))


def style() -> str:
    """Return the style sheet of every page, including uPlot's."""
    return f"{asset('uPlot.min.css')}\n{asset('pages.css')}"
