"""Field docstrings of a class, for readers of a file who do not have the source code."""

import ast
import inspect
import sys
from functools import cache


def field_docstrings(cls: type) -> dict[str, str]:
    """Return the docstring under each field of a class as one line, by field; empty if the source is unavailable."""
    docstrings: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        docstrings |= _by_class(base.__module__).get(base.__name__, {})
    return docstrings


@cache
def _by_class(module: str) -> dict[str, dict[str, str]]:
    """Return the docstrings of all classes of a module.

    The source is read on the first call because most commands do not need it.
    """
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    return {node.name: _texts(node) for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def _texts(body: ast.ClassDef) -> dict[str, str]:
    texts = {}
    for statement, following in zip(body.body, body.body[1:], strict=False):
        match statement, following:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(text))),
            ):
                texts[name] = " ".join(text.split())
    return texts
