"""Count the house's lines by room, and name its longest functions and widest parameter lists: `python -m tools.size`.

Lines are those of Python and C files, blank ones and comments included. Functions and parameters are those of the
product and the tools; `self` and `cls` do not count. The exit code is 1 when a function has too many parameters, those
of commands left out. `--tree PATH` counts another checkout.
"""

import argparse
import ast
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
KINDS = {
    "product": ("hil_bridge", "emulators", "protocol"),
    "tests": ("tests",),
    "tools": ("tools",),
}
ENDINGS = {".py", ".c"}
MODULE_LIMIT = 500
"""Lines of a module; a longer one is named. Chosen: the style's own."""
MOST = 10
"""Functions that are named. Chosen."""
PARAMETERS_MOST = 5
"""Of a function. Chosen: the style's own."""
FUNCTION_LIMIT = 60
"""Lines of a function. Chosen: the style's own."""
COMMANDS = frozenset(("cli", "commands", "commands.py"))
"""Folders and modules of commands, whose options are parameters."""


class Function(NamedTuple):
    """A function or method where it is defined."""

    place: str
    lines: int
    parameters: int


def files(tree: Path, folder: str) -> list[Path]:
    """Source files below a folder of the tree."""
    return sorted(path for path in (tree / folder).rglob("*") if path.suffix in ENDINGS)


def line_count(path: Path) -> int:
    """Lines of a file."""
    return len(path.read_text(encoding="utf-8").splitlines())


def room(tree: Path, path: Path) -> str:
    """The folder's first level below its root, or the root for a file that lies directly in it."""
    parts = path.relative_to(tree).parts
    return "/".join(parts[: min(2, len(parts) - 1)])


def functions(tree: Path, path: Path) -> Iterator[Function]:
    """Every function of a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            taken = node.args
            names = [each.arg for each in (*taken.posonlyargs, *taken.args, *taken.kwonlyargs)]
            more = sum(each is not None for each in (taken.vararg, taken.kwarg))
            own = names[:1] in (["self"], ["cls"])
            place = f"{path.relative_to(tree)}:{node.lineno} {node.name}"
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            yield Function(place, length, len(names) + more - own)


def own_functions(tree: Path) -> Iterator[Function]:
    """Functions of product and tools, those of commands left out."""
    folders = (*KINDS["product"], *KINDS["tools"])
    for path in (path for folder in folders for path in files(tree, folder)):
        if path.suffix == ".py" and COMMANDS.isdisjoint(path.relative_to(tree).parts):
            yield from functions(tree, path)


def too_wide(tree: Path) -> list[Function]:
    """Functions with more parameters than the style allows."""
    return [each for each in own_functions(tree) if each.parameters > PARAMETERS_MOST]


def too_long(tree: Path) -> list[Function]:
    """Functions of more lines than the style allows."""
    return [each for each in own_functions(tree) if each.lines > FUNCTION_LIMIT]


def long_modules(tree: Path) -> list[Path]:
    """Modules of product and tools that are longer than the style allows."""
    folders = (*KINDS["product"], *KINDS["tools"])
    return [path for folder in folders for path in files(tree, folder) if line_count(path) > MODULE_LIMIT]


def lines(tree: Path) -> Iterable[str]:
    """The counts, as text."""
    counts = {
        path: line_count(path) for roots in KINDS.values() for each in roots for path in files(tree, each)
    }
    found: list[Function] = []
    for kind, roots in KINDS.items():
        rooms: Counter[str] = Counter()
        for path in (path for each in roots for path in files(tree, each)):
            rooms[room(tree, path)] += counts[path]
            if kind != "tests" and path.suffix == ".py":
                found += functions(tree, path)
        yield f"{kind}: {rooms.total()} lines"
        yield from (f"  {count:6} {name}" for name, count in rooms.most_common())
    yield f"modules above {MODULE_LIMIT} lines"
    longest = sorted(counts, key=lambda path: -counts[path])
    yield from (
        f"  {counts[path]:6} {path.relative_to(tree)}" for path in longest if counts[path] > MODULE_LIMIT
    )
    yield "longest functions, in lines"
    by_length = sorted(found, key=lambda each: (-each.lines, each.place))
    yield from (f"  {each.lines:6} {each.place}" for each in by_length[:MOST])
    yield "widest parameter lists"
    by_width = sorted(found, key=lambda each: (-each.parameters, each.place))
    yield from (f"  {each.parameters:6} {each.place}" for each in by_width[:MOST])


def main() -> int:
    """Print the counts; the exit code is 1 when a function has too many parameters."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tree", type=Path, default=ROOT, help="the checkout to count")
    tree = parser.parse_args().tree.resolve()
    print("\n".join(lines(tree)))
    return int(bool(too_wide(tree)))


if __name__ == "__main__":
    sys.exit(main())
