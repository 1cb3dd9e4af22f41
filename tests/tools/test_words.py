"""Household words in names and texts: each has a technical term, and none may spread.

The counts below are upper limits, for names (each use) and for texts (docstrings, comments, messages, pages).
Lower a limit when a word has become rarer. Raise one only for a use that is listed among the exceptions.
"""

import ast
import io
import re
import subprocess
import tokenize
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
REPLACEMENTS = {
    "told": "reported, sent, configured",
    "tell": "report, send, notify",
    "seen": "observed, received, measured",
    "found": "result, match, detected",
    "wanted": "desired, target, requested",
    "felt": "measured",
    "shown": "displayed, printed",
    "asked": "requested",
    "played": "replayed, executed",
    "heard": "received",
    "taken": "accepted, subtracted",
    "led": "guided",
    "way": "path, direction, distance, motion",
    "look": "check, read",
    "beside": "next to, in addition to",
    "anew": "again",
    "swing": "oscillation",
    "foreign": "plug-in, third-party",
    "whole": "complete, integer",
    "said": "message, output",
}
"""The technical terms for each word, for the message of a failure."""
EXCEPTIONS = (
    "FileNotFoundError",
    "ModuleNotFoundError",
    "PackageNotFoundError",
    "look_ahead",  # of a path or a servo, as in its documentation
    "under_way",
    "LedStep",  # names that authors of plug-ins use
    "make_way",
    "watches_way",
)
NAMES = {
    "told": 75,
    "tell": 91,
    "seen": 127,
    "found": 170,
    "wanted": 64,
    "felt": 2,
    "shown": 51,
    "asked": 65,
    "played": 24,
    "heard": 25,
    "taken": 81,
    "led": 24,
    "way": 324,
    "look": 67,
    "beside": 36,
    "anew": 2,
    "swing": 30,
    "foreign": 69,
    "whole": 86,
    "said": 8,
}
TEXTS = {
    "told": 88,
    "tell": 18,
    "seen": 47,
    "found": 94,
    "wanted": 14,
    "felt": 28,
    "shown": 27,
    "asked": 58,
    "played": 16,
    "heard": 9,
    "taken": 142,
    "led": 34,
    "way": 200,
    "look": 53,
    "beside": 22,
    "anew": 3,
    "swing": 3,
    "foreign": 4,
    "whole": 150,
    "said": 24,
}


def parts(name: str) -> list[str]:
    """Split a name at underscores and capitals, in lower case."""
    return [part.lower() for part in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


@cache
def counts() -> tuple[Counter[str], Counter[str]]:
    """Count the words in the names and in the texts of all tracked files but the change log."""
    listed = subprocess.run(
        ["git", "ls-files", "*.py", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    names, texts = Counter[str](), Counter[str]()
    for path in map(ROOT.__truediv__, listed.stdout.split()):
        if path.name == "CHANGELOG.md" or path == Path(__file__):
            continue
        text = path.read_text()
        if path.suffix == ".md":
            texts.update(re.findall(r"[a-z]+", text.lower()))
            continue
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.NAME and token.string not in EXCEPTIONS:
                names.update(parts(token.string))
            elif token.type in (tokenize.COMMENT, tokenize.STRING):
                texts.update(re.findall(r"[a-z]+", token.string.lower()))
    return names, texts


@pytest.mark.parametrize("word", REPLACEMENTS)
def test_household_word_does_not_spread(word: str) -> None:
    names, texts = counts()
    advice = f"{word!r}: write {REPLACEMENTS[word]}"
    assert names[word] <= NAMES[word], f"{names[word]} uses in names, at most {NAMES[word]}; {advice}"
    assert texts[word] <= TEXTS[word], f"{texts[word]} uses in texts, at most {TEXTS[word]}; {advice}"


def test_test_names_have_at_most_60_letters() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "tests/*.py"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    long = [
        f"{name}: {node.name}"
        for name in listed.stdout.split()
        for node in ast.walk(ast.parse((ROOT / name).read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and re.match(r"test_.{56}", node.name)
    ]
    assert not long
