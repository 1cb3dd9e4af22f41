"""Places where a text that was made for people is searched or taken apart, as `split` and `startswith` do.

A cause, an event or a fault is a value with fields; its text is made at the edge. Code that reads a part
of a text wants a field. Looked at are the texts of exceptions, and attributes that hold words by their name.
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
"""Names of attributes that hold words for people."""
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
"""Methods of a text that look into it."""
_ON_PATTERN = frozenset(["findall", "finditer", "fullmatch", "match", "search", "split", "sub"])
"""Methods of a regular expression, and functions of its module."""
_SAME = frozenset(["casefold", "lower", "lstrip", "rstrip", "strip", "upper"])
"""Methods whose answer is still the text."""


def taken_apart(root: Path) -> Iterator[tuple[str, str]]:
    """File and expression of each such place in the packages below `root`."""
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            for expression in places(path.read_text(encoding="utf-8")):
                yield str(path.relative_to(root)), expression


def places(source: str) -> Iterator[str]:
    """Each such expression of a module, as Python writes it."""
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
