"""Find code that searches or splits a text made for an operator, for example with `split` and `startswith`.

A cause, an event or a fault is a value with fields. Its text is created where it is displayed. Code that needs a
part of a text should read a field instead. The search covers texts of exceptions, and attributes whose names
indicate text.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("hil_bridge", "emulators", "protocol")
WORDS = frozenset(
    [
        "cause",
        "fact",
        "label",
        "line",
        "meaning",
        "message",
        "problem",
        "reason",
        "remedy",
        "said",
        "text",
        "title",
        "warning",
        "words",
    ]
)
"""Names of attributes that hold text for an operator."""
_ON_TEXT = frozenset(
    [
        "count",
        "endswith",
        "find",
        "index",
        "partition",
        "removeprefix",
        "removesuffix",
        "rfind",
        "rpartition",
        "rsplit",
        "split",
        "startswith",
    ]
)
"""Methods of a string that search or split it."""
_ON_PATTERN = frozenset(["findall", "finditer", "fullmatch", "match", "search", "split", "sub"])
"""Methods of a regular expression, and functions of the module `re`, that search or split a text."""
_SAME = frozenset(["casefold", "lower", "lstrip", "rstrip", "strip", "upper"])
"""Methods whose result is the same text in another form."""


def parsed_texts(root: Path) -> Iterator[tuple[str, str]]:
    """Yield file and expression for each such use of a text in the packages below `root`."""
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            for expression in places(path.read_text(encoding="utf-8")):
                yield str(path.relative_to(root)), expression


def places(source: str) -> Iterator[str]:
    """Yield each such expression in a module, as source code."""
    tree = ast.parse(source)
    errors = {node.name for node in ast.walk(tree) if isinstance(node, ast.ExceptHandler) and node.name} | {
        "error"
    }
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(value=text, attr=method)) if method in _ON_TEXT and _holds_words(
                text, errors
            ):
                yield ast.unparse(node)
            case ast.Call(func=ast.Attribute(attr=method), args=arguments) if method in _ON_PATTERN and any(
                _holds_words(one, errors) for one in arguments
            ):
                yield ast.unparse(node)
            case ast.Compare(ops=[ast.In() | ast.NotIn()], comparators=[text]) if _holds_words(text, errors):
                yield ast.unparse(node)


def _holds_words(node: ast.expr, errors: set[str]) -> bool:
    match node:
        case ast.Call(func=ast.Name(id="str" | "repr"), args=[ast.Name(id=name)]):
            return name in errors or name in WORDS
        case ast.Call(func=ast.Attribute(value=inner, attr=method)) if method in _SAME:
            return _holds_words(inner, errors)
        case ast.Attribute(attr=name):
            return name in WORDS
    return False
