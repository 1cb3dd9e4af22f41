"""Update docs/explanation/safety-tests.json from the page on safety: its sentences, and the tests of each.

A new sentence is entered as not tested, a removed one is dropped, and the others keep their tests.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "explanation" / "safety.md"
DOCUMENT = ROOT / "docs" / "explanation" / "safety-tests.json"
NOT_TESTED = "not tested"
NO_PROMISE = "no promise"
"""Mark of a sentence that explains, requests something, or describes how figures were made."""
_END = re.compile(r"(?<=[.!?])\s+(?=[A-Z*`\[(])")
_CELLS = re.compile(r"(?<!\\)\|")

Held = Mapping[str, Mapping[str, str | Sequence[str]]]
"""Tests of each sentence by heading and sentence, or `NOT_TESTED` or `NO_PROMISE`."""


def sentences(text: str) -> Iterator[tuple[str, str]]:
    """Yield heading and sentence, in the order of a page.

    A row of a hand-written table also counts as a sentence. Generated tables, pictures and examples are left out.
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


def kept() -> Held:
    """Return the content of the file."""
    entries: Held = json.loads(DOCUMENT.read_text(encoding="utf-8"))
    return entries


def sentences_text() -> str:
    """Return the text of the file: each sentence of the page, with the tests that the file lists for it."""
    tests = {sentence: entries for rows in kept().values() for sentence, entries in rows.items()}
    rows = dict[str, dict[str, str | Sequence[str]]]()
    for heading, sentence in sentences(PAGE.read_text(encoding="utf-8")):
        rows.setdefault(heading, {})[sentence] = tests.get(sentence, NOT_TESTED)
    return json.dumps(rows, ensure_ascii=False, indent=1) + "\n"


def missing_tests(entries: Held) -> list[str]:
    """Return the names of tests that the file lists but that do not exist."""
    names: dict[str, set[str]] = {}
    for rows in entries.values():
        for tests in rows.values():
            for path, _, test in (name.partition("::") for name in tests if not isinstance(tests, str)):
                names.setdefault(path, set()).add(test)
    absent = []
    for path, tests_of_file in names.items():
        file = ROOT / path
        text = file.read_text(encoding="utf-8") if file.is_file() else ""
        defined = set(re.findall(r"^ *(?:async )?def (\w+)", text, re.M))
        absent += [f"{path}::{test}" for test in sorted(tests_of_file - defined)]
    return absent


FILES = {"explanation/safety-tests.json": sentences_text}
