"""Write the generated parts of documents, which follow from the code and from runs, or check them.

    python -m tools.documents                          # all of them
    python -m tools.documents faults tasks --check     # write nothing; the exit code is 1 if a document is outdated
    python -m tools.documents faults --measure egm     # first make the runs of one; without a name all its runs

The text around them is kept. A module of `DOCUMENTS` has `TABLES`: functions that return the text between two marks of
the page, by the name of the marks; they receive the figures if the document has some. `PICTURES` has functions that
draw files of docs/pictures, by file name, and `FILES` functions that write other files of docs. `measure(names,
figures)` makes the runs, all of them without names.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from tools.pages import placed

DOCS = Path(__file__).resolve().parent.parent / "docs"


class Document(NamedTuple):
    """Module of tools that writes parts of documents."""

    module: str
    page: str = ""
    """Page with the module's tables; empty for a module that only draws."""
    figures: str = ""
    """JSON file or page with the module's figures; empty if it has none."""


DOCUMENTS: Mapping[str, Document] = {
    "benchmark": Document("benchmark_doc", "reference/benchmark.md", "reference/benchmark.json"),
    "bound": Document("bound_doc", "explanation/safety.md", "explanation/bound.json"),
    "computer-link": Document("computer_link_doc", "reference/computer-link.md"),
    "faults": Document("faults_doc", "reference/faults.md", "reference/faults.json"),
    "identified-cells": Document(
        "identified_cells", "reference/identify-cell.md", "reference/identified-cells.json"
    ),
    "link-diagrams": Document("link_diagrams", "reference/computer-link.md"),
    "observation": Document("observation_doc", "reference/gym.md"),
    "performance": Document("bench.page", "explanation/performance.md", "explanation/performance.json"),
    "probe": Document("probe_doc", "reference/probe.md"),
    "rooms": Document("room_pictures"),
    "safety": Document("safety_doc", "explanation/safety.md", "explanation/safety.json"),
    "safety-tests": Document("safety_sentences"),
    "sensor-errors": Document(
        "sensor_errors_doc", "explanation/fidelity.md", "explanation/sensor-errors.json"
    ),
    "streaming": Document("streaming_doc", "explanation/streaming.md", "explanation/streaming.json"),
    "tasks": Document("tasks_doc", "reference/tasks.md"),
    "terminal": Document("terminal_pictures"),
    "urscript": Document("urscript_doc", "reference/urscript.md"),
}


def as_json(figures: Any, depth: int, indent: int = 1) -> str:
    """Return figures as JSON. Items are on separate lines down to this depth, so that diffs are readable."""
    if not depth:
        return json.dumps(figures, ensure_ascii=False)
    pad = " " * indent
    lines = (
        f"{pad}{json.dumps(key, ensure_ascii=False)}: {as_json(one, depth - 1, indent + 1)}"
        for key, one in figures.items()
    )
    return "{\n" + ",\n".join(lines) + f"\n{' ' * (indent - 1)}}}"


def measure(name: str, names: list[str]) -> None:
    """Make the runs of a document, and store their figures."""
    document = DOCUMENTS[name]
    module: Any = import_module(f"tools.{document.module}")
    figures = module.measure(names, *figures_of(document))
    if document.figures:
        depth = getattr(module, "JSON_DEPTH", None)
        text = json.dumps(figures, indent=1, allow_nan=False) if depth is None else as_json(figures, depth)
        (DOCS / document.figures).write_text(text + "\n", encoding="utf-8")


def figures_of(document: Document) -> list[Any]:
    """Return the figures in a list of one item; an empty list for a document without figures."""
    if not document.figures:
        return []
    text = (DOCS / document.figures).read_text(encoding="utf-8")
    return [json.loads(text) if document.figures.endswith(".json") else text]


def contents(name: str) -> Iterator[tuple[Path, str]]:
    """Yield each file of a document with the text that it should have."""
    document = DOCUMENTS[name]
    module: Any = import_module(f"tools.{document.module}")
    if document.page:
        page, figures = DOCS / document.page, figures_of(document)
        tables = {mark: make(*figures) for mark, make in module.TABLES.items()}
        yield page, placed(page.read_text(encoding="utf-8"), tables)
    for file, draw in getattr(module, "PICTURES", {}).items():
        yield DOCS / "pictures" / file, draw()
    for file, write in getattr(module, "FILES", {}).items():
        yield DOCS / file, write()


def main() -> int:
    """Make the runs if requested. Then write or check the documents."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("names", nargs="*", metavar="DOCUMENT", help=f"all, or of {', '.join(DOCUMENTS)}")
    options.add_argument("--check", action="store_true", help="write nothing, say whether it is up to date")
    options.add_argument("--measure", nargs="*", metavar="NAME", help="make the runs first, all or these")
    chosen = options.parse_args()
    if unknown := [name for name in chosen.names if name not in DOCUMENTS]:
        options.error(f"no document {unknown[0]!r}; known: {', '.join(DOCUMENTS)}")
    if chosen.measure is not None:
        if len(chosen.names) != 1:
            options.error("name one document with --measure")
        measure(chosen.names[0], chosen.measure)
    stale = False
    for name in chosen.names or DOCUMENTS:
        for place, text in contents(name):
            if place.exists() and place.read_text(encoding="utf-8") == text:
                continue
            stale = True
            print(f"{place}: {'not up to date' if chosen.check else 'written'}")
            if not chosen.check:
                place.write_text(text, encoding="utf-8")
    return int(stale and chosen.check)


if __name__ == "__main__":
    sys.exit(main())
