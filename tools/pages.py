"""Parts of the tools that write tables into a document: a table, its place between two marks, and the command."""

import argparse
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def placed(text: str, contents: Mapping[str, str]) -> str:
    """The document with each content between the marks of its name; the prose around them stays.

    Raises ValueError for a content without its place.
    """
    for name, content in contents.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, has_begin, behind = text.partition(begin)
        _, has_end, after = behind.partition(end)
        if not (has_begin and has_end):
            raise ValueError(f"the document has no place for {name!r}: {begin} … {end}")
        text = f"{before}{begin}\n{content}\n{end}{after}"
    return text


def parser(text: str) -> argparse.ArgumentParser:
    """The options of a tool that says this of itself."""
    found = argparse.ArgumentParser(description=text.splitlines()[0])
    found.add_argument("--check", action="store_true", help="write nothing, say whether it is up to date")
    return found


def write(document: Path, renewed: Callable[[str], str], check: bool) -> int:
    """Write the document, or only check it; the exit code."""
    before = document.read_text(encoding="utf-8")
    after = renewed(before)
    if check:
        return int(after != before)
    document.write_text(after, encoding="utf-8")
    return 0


def document_of_figures(
    text: str,
    document: Path,
    figures: Path,
    measure: Callable[[], object],
    renewed: Callable[[str, Any], str],
) -> int:
    """The command of a tool that says this of itself: measure if that is asked for, then write or check; the exit code.

    `figures` is the JSON file between `measure` and `renewed`.
    """
    options = parser(text)
    options.add_argument("--measure", action="store_true", help="make the runs first")
    chosen = options.parse_args()
    if chosen.measure:
        figures.write_text(json.dumps(measure(), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    found = json.loads(figures.read_text(encoding="utf-8"))
    return write(document, lambda before: renewed(before, found), chosen.check)
