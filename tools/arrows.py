"""Count the rooms of a package and the arrows between them, and name what runs in a circle: `python -m tools.arrows`.

A room is what stands directly below the package: a folder or a module. An arrow leads from one room to another when
any module of the first imports any module of the second. The same is counted for all folders, at any depth.
An upward import is one that must go for the rooms of a folder to have an order, by grimp's choice of the fewest.
`--tree PATH` counts another checkout.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeAlias

import grimp
from grimp import ImportGraph

ROOT = Path(__file__).resolve().parent.parent
Arrows: TypeAlias = Counter[tuple[str, str]]
"""Imports between modules, by the rooms that they lead from and to."""


def room(module: str, package: str) -> str:
    """The child of the package in which a module stands; the package itself for its `__init__`."""
    return ".".join(module.split(".")[: package.count(".") + 2])


def folder(module: str, folders: Iterable[str]) -> str:
    """The folder in which a module stands; a folder's `__init__` stands in it."""
    return module if module in folders else module.rpartition(".")[0]


def arrows(graph: ImportGraph, package: str, room_of: Callable[[str], str]) -> Arrows:
    """The arrows between rooms within a package."""
    inside = {package, *graph.find_descendants(package)}
    found: Arrows = Counter()
    for module in inside:
        for imported in graph.find_modules_directly_imported_by(module) & inside:
            if (source := room_of(module)) != (target := room_of(imported)):
                found[source, target] += 1
    return found


def circles(found: Arrows) -> list[list[str]]:
    """Groups of rooms each of which reaches every other one of its group."""
    next_of: dict[str, set[str]] = {}
    for source, target in found:
        next_of.setdefault(source, set()).add(target)

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        waiting = [start]
        while waiting:
            fresh = next_of.get(waiting.pop(), set()) - seen
            seen |= fresh
            waiting += fresh
        return seen

    reach = {name: reached(name) for name in next_of}
    groups = {
        frozenset(other for other in reach[name] if name in reach.get(other, ()))
        for name in next_of
        if name in reach[name]
    }
    return sorted(sorted(group) for group in groups)


def upward(graph: ImportGraph, package: str) -> list[tuple[str, str]]:
    """The imports, from module to module, that keep the rooms of a package without an order."""
    return sorted(graph.nominate_cycle_breakers(package))


def lines(graph: ImportGraph, package: str) -> Iterable[str]:
    """The counts, as text."""
    inside = {package, *graph.find_descendants(package)}
    folders = {module for module in inside if graph.find_children(module)}
    rooms = arrows(graph, package, lambda module: room(module, package))
    deep = arrows(graph, package, lambda module: folder(module, folders))
    yield f"{package}: {len(graph.find_children(package))} rooms, {len(rooms)} arrows ({rooms.total()} imports)"
    yield f"at any depth: {len(folders)} folders, {len(deep)} arrows ({deep.total()} imports)"
    for group in circles(rooms):
        yield f"circle: {', '.join(group)}"
    for place in sorted(folders):
        for source, target in upward(graph, place):
            yield f"upward, within {place}: {source} → {target}"


def main() -> int:
    """Print the counts; the exit code is 1 when there is a circle among the rooms."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tree", type=Path, default=ROOT, help="the checkout to count")
    parser.add_argument("--package", default="hil_bridge")
    options = parser.parse_args()
    sys.path.insert(0, str(options.tree.resolve()))
    graph = grimp.build_graph(options.package, cache_dir=None)
    print("\n".join(lines(graph, options.package)))
    return int(bool(upward(graph, options.package)))


if __name__ == "__main__":
    sys.exit(main())
