"""Write the figures of docs/explanation/architecture.md: the house as it was counted before, and as it is now.

What changes with every commit is told roughly: a number of lines stays on the page as long as it is nearly right.
"""

import re
import tomllib
from collections.abc import Iterator, Sequence

import grimp

from tools.arrows import ROOT, arrows, circles, room
from tools.pages import placed, table
from tools.size import KINDS, PARAMETERS_MOST, files, line_count, long_modules, too_wide

FIRST, BEFORE = "first count, `9b8b894`", "before the rooms, `fbbafb2`"
HISTORY = {
    "hil_bridge": ("29, 117", "48, 213"),
    "emulators": ("7, 6", "10, 17"),
    "protocol": ("12, 26", "13, 21"),
    "circles": ("0", "0"),
    "contracts": ("6", "8"),
    "wide": ("27", "28"),
    "long": ("1", "1"),
    "lines": ("38 000", "46 000"),
}
"""Counts of two earlier commits, by these tools. They stay."""
LINES_OFF = 2000
"""Lines by which the page may be off. Chosen: some weeks of work."""
_LINES = "lines of the product, roughly"


def rooms(package: str) -> tuple[str, int]:
    """Number of rooms and arrows of a package, and of the circles among them."""
    graph = grimp.build_graph(package, cache_dir=None)
    counted = arrows(graph, package, lambda module: room(module, package))
    return f"{len(graph.find_children(package))}, {len(counted)}", len(circles(counted))


def contracts() -> int:
    """Number of import contracts."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return len(settings["tool"]["importlinter"]["contracts"])


def lines_told(page: str) -> str:
    """Lines of the product in thousands: the number of the page where that is nearly right."""
    counted = sum(line_count(path) for folder in KINDS["product"] for path in files(ROOT, folder))
    before = re.search(rf"\| {_LINES} \|.*\| ([\d ]+) \|", page)
    if before and abs(int(before[1].replace(" ", "")) - counted) <= LINES_OFF:
        return before[1]
    return f"{round(counted, -3):,}".replace(",", " ")


def rows(page: str) -> Iterator[Sequence[object]]:
    """Each figure: earlier, and now."""
    found = 0
    for package in KINDS["product"]:
        now, more = rooms(package)
        found += more
        yield f"`{package}`: rooms, arrows", *HISTORY[package], now
    yield "circles among rooms", *HISTORY["circles"], found
    yield "import contracts", *HISTORY["contracts"], contracts()
    wide = f"functions with more than {PARAMETERS_MOST} parameters, commands left out"
    yield wide, *HISTORY["wide"], len(too_wide(ROOT))
    yield "modules above 500 lines, tests left out", *HISTORY["long"], len(long_modules(ROOT))
    yield _LINES, *HISTORY["lines"], lines_told(page)


def renewed(page: str) -> str:
    """The page with its figures as they are now. Raises ValueError for one without their place."""
    return placed(page, {"figures": table(["", FIRST, BEFORE, "now"], rows(page))})
