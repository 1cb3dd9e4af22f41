"""Keep docs/explanation/safety-tests.md in step with docs/explanation/safety.md: its sentences, and what holds each.

A sentence that is new is entered as not tested, one that is gone is dropped, and the others keep what people wrote
beside them.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from tools.pages import table

ROOT = Path(__file__).resolve().parent.parent
DOCUMENT = ROOT / "docs" / "explanation" / "safety-tests.md"
NOT_TESTED = "not tested"
NO_PROMISE = "no promise"
"""Of a sentence that explains, asks for something, or tells how figures were made."""
_HELD = re.compile(r"`([a-z_0-9/]+\.py)::(test_[a-z_0-9]+)`")
_END = re.compile(r"(?<=[.!?])\s+(?=[A-Z*`\[(])")
_CELLS = re.compile(r"(?<!\\)\|")
_ROW = re.compile(r"^\| (.*) \| (.*) \|$")


def sentences(text: str) -> Iterator[tuple[str, str]]:
    """Heading and sentence, in the order of a page. A row of a table that a person wrote is a sentence too. Generated
    tables, pictures and examples are left out.
    """
    text = re.sub(r"```.*?```|<!-- (\w+): begin -->.*?<!-- \1: end -->|<!--.*?-->", "", text, flags=re.S)
    heading = ""
    for block in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|[0-9]+\.) )|(?<=\|)\n(?=[^|])", text):
        block = block.strip()
        if block.startswith("#"):
            heading, _, block = block.lstrip("# ").partition("\n")
        if not block or block.startswith("!["):
            continue
        if block.startswith("|"):
            for line in block.splitlines()[2:]:
                yield (
                    heading,
                    " · ".join(cell.strip().replace("\\|", "|") for cell in _CELLS.split(line.strip(" |"))),
                )
            continue
        block = re.sub(r"^(?:[-*]|[0-9]+\.) ", "", " ".join(block.replace("**", "").split()))
        for sentence in _END.split(block):
            yield heading, sentence.strip()


def kept(text: str) -> dict[str, str]:
    """The words beside each sentence in the document."""
    rows = (_ROW.match(line) for line in text.splitlines())
    return {row[1].replace("\\|", "|"): row[2] for row in rows if row is not None}


def sentences_table(page: str) -> str:
    """A table for each heading of the page: its sentences, each with the words that the document has for it."""
    beside, parts = kept(DOCUMENT.read_text(encoding="utf-8")), []
    rows = dict[str, list[tuple[str, str]]]()
    for heading, sentence in sentences(page):
        rows.setdefault(heading, []).append((sentence, beside.get(sentence, NOT_TESTED)))
    for heading, pairs in rows.items():
        parts += [f"## {heading}", table(("sentence", "held by"), pairs)]
    return "\n\n".join(parts)


def missing_tests(text: str) -> list[str]:
    """Tests that the document names and that are not there."""
    names: dict[str, set[str]] = {}
    for path, test in _HELD.findall(text):
        names.setdefault(path, set()).add(test)
    absent = []
    for path, tests in names.items():
        file = ROOT / path
        there = (
            set(re.findall(r"^ *(?:async )?def (\w+)", file.read_text(encoding="utf-8"), re.M))
            if file.is_file()
            else set()
        )
        absent += [f"{path}::{test}" for test in sorted(tests - there)]
    return absent


TABLES = {"sentences": sentences_table}
