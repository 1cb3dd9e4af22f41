"""Overrides of a configuration by dotted key."""

from collections.abc import Mapping
from typing import Any

from hil_bridge.errors import ConfigError


def lay_over(values: dict[str, Any], overrides: Mapping[str, object]) -> set[str]:
    """Put overrides into nested tables, by dotted key. Overrides that are None are ignored. Return the keys that
    have a table.
    """
    given = set()
    for key, value in overrides.items():
        if value is None:
            continue
        *sections, name = key.split(".")
        table: Any = values
        for section in sections:
            if isinstance(table, list):
                table = _numbered(table, section, key)
            else:
                table = table.setdefault(section, {}) if isinstance(table, dict) else None
        if isinstance(table, dict):
            table[name] = value
            given.add(key)
    return given


def _numbered(tables: list[Any], number: str, key: str) -> object:
    """Return the table with the given number, counted from 1 as in messages."""
    if number.isdecimal() and 0 < int(number) <= len(tables):
        return tables[int(number) - 1]
    raise ConfigError(
        f"--set {key}: there is no {number!r}; give a number from 1 to {len(tables)} in its place"
    )
