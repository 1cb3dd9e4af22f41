"""Print the number of lines by package, and everything that exceeds the limits of the style: `python -m
tools.size`.

Python and C files count, including blank lines and comments. The limits apply to the product and the tools. `self`
and `cls` do not count as parameters. Commands may have more parameters, because their options are parameters. The
exit code is 1 if a limit is exceeded.
"""

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("hil_bridge", "emulators", "protocol", "packages", "tests", "tools")
ENDINGS = {".py", ".c"}
MODULE_LINES, FUNCTION_LINES, PARAMETERS = 500, 60, 5
"""Maximum number of lines in a module, lines in a function, and parameters."""
COMMANDS = frozenset(("cli", "commands", "commands.py"))
"""Folders and modules that contain commands."""


def files(tree: Path, folder: str) -> list[Path]:
    """Return the source files below a folder of the tree."""
    return sorted(path for path in (tree / folder).rglob("*") if path.suffix in ENDINGS)


def lines_by_room(tree: Path) -> Counter[str]:
    """Return the number of lines of each package: a folder directly below its root, or the root itself."""
    rooms: Counter[str] = Counter()
    for path in (path for folder in FOLDERS for path in files(tree, folder)):
        parts = path.relative_to(tree).parts
        room = "/".join(parts[: min(2, len(parts) - 1)])
        rooms[room] += len(path.read_text(encoding="utf-8").splitlines())
    return rooms


def exceeded(tree: Path) -> Iterator[str]:
    """Yield each module, function and parameter list that exceeds its limit, with the actual number."""
    for path in (path for folder in FOLDERS for path in files(tree, folder)):
        text, place = path.read_text(encoding="utf-8"), path.relative_to(tree)
        if "tests" in place.parts:
            continue
        if (lines := len(text.splitlines())) > MODULE_LINES:
            yield f"{place}: {lines} lines"
        if path.suffix == ".py" and COMMANDS.isdisjoint(place.parts):
            yield from (f"{place}:{excess}" for excess in exceeded_functions(text))


def exceeded_functions(text: str) -> Iterator[str]:
    """Yield each function and parameter list of a module that exceeds its limit, with its line and the actual
    number.
    """
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        lines = (node.end_lineno or node.lineno) - node.lineno + 1
        if lines > FUNCTION_LINES:
            yield f"{node.lineno} {node.name}: {lines} lines"
        given = node.args
        names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
        own = names[:1] in (["self"], ["cls"])
        count = len(names) - own + sum(each is not None for each in (given.vararg, given.kwarg))
        if count > PARAMETERS:
            yield f"{node.lineno} {node.name}: {count} parameters"


def main() -> int:
    """Print the counts and the violations."""
    rooms = lines_by_room(ROOT)
    for folder in FOLDERS:
        own = {room: count for room, count in rooms.most_common() if room.split("/")[0] == folder}
        print(
            f"{folder}: {sum(own.values())} lines",
            *(f"  {count:6} {room}" for room, count in own.items()),
            sep="\n",
        )
    excesses = list(exceeded(ROOT))
    print(*excesses, sep="\n")
    return int(bool(excesses))


if __name__ == "__main__":
    sys.exit(main())
