"""Sections of a configuration as names and values, and the settings that differ from their defaults."""

import dataclasses
from collections.abc import Iterator
from html import escape
from typing import Any

from pydantic import BaseModel


def is_section(value: object) -> bool:
    """Return whether an object is a section, not a value."""
    return isinstance(value, BaseModel) or dataclasses.is_dataclass(value)


def items_of(section: object) -> list[tuple[str, Any]]:
    """Return the names and values of a section, in order."""
    if isinstance(section, BaseModel):
        return [(name, getattr(section, name)) for name in type(section).model_fields]
    return [(field.name, getattr(section, field.name)) for field in dataclasses.fields(section)]  # type: ignore[arg-type]


def changed(section: object, default: object, before: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield the dotted key, value and default of each setting that differs from the default section."""
    defaults = dict(items_of(default)) if type(default) is type(section) else {}
    for name, value in items_of(section):
        usual, key = defaults.get(name), f"{before}{name}"
        if is_section(value):
            yield from changed(value, usual, f"{key}.")
        elif name not in defaults or value != usual:
            yield key, value, usual


def changed_html(section: BaseModel) -> str:
    """Return the changed settings as an HTML table for notebooks."""
    rows = [
        f"<tr>{''.join(f'<td>{escape(str(part))}</td>' for part in row)}</tr>"
        for row in changed(section, type(section)())
    ]
    if not rows:
        return "<p>every setting has its default</p>"
    head = "<tr><th>setting</th><th>value</th><th>default</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"
