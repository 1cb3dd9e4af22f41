"""The docstrings under the fields of a class, for people that read a file and not the source."""

import ast
import inspect
import sys
from functools import cache


def field_docstrings(cls: type) -> dict[str, str]:
    """Return the text right under each field of a class as one line, by field; empty if Python has no source of it."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        found |= _by_class(base.__module__).get(base.__name__, {})
    return found


@cache
def _by_class(module: str) -> dict[str, dict[str, str]]:
    """Texts of all classes of a module. Its source is read at the first call, since most starts do not need it."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    return {node.name: _texts(node) for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def _texts(body: ast.ClassDef) -> dict[str, str]:
    found = {}
    for statement, following in zip(body.body, body.body[1:], strict=False):
        match statement, following:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(text))),
            ):
                found[name] = " ".join(text.split())
    return found
