"""Tuned configuration as a TOML file that `run` accepts unchanged."""

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

from hil_bridge.errors.text_files import toml_pair
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.overrides import lay_over
from hil_bridge.settings.places import FILE_KEYS


def tuned_values(
    values: Mapping[str, Any], config: Config, parameters: Mapping[str, float | int]
) -> dict[str, Any]:
    """Return the values of the original file with the tuned `[controller]`, and with the pace for which it was
    tuned.
    """
    result = deepcopy(dict(values))
    combined = config.controller.parameters | dict(parameters)
    lay_over(result, {"controller.name": config.controller.name, "controller.parameters": combined})
    lay_over(result, {"controller.sample_ms": config.controller.sample_ms})
    if config.run.period_ms:
        lay_over(result, {"run.period_ms": config.run.period_ms})
    return result


def toml(values: Mapping[str, Any], comment: Sequence[str]) -> str:
    """Format nested tables as TOML, with comment lines at the beginning."""
    lines = [*(f"# {line}" for line in comment), "", *_table(values, ())]
    return "\n".join(lines).rstrip() + "\n"


def _table(values: Mapping[str, Any], where: tuple[str, ...]) -> Iterator[str]:
    plain = {key: value for key, value in values.items() if not isinstance(value, dict)}
    tables = {key: value for key, value in values.items() if isinstance(value, dict)}
    if where and (plain or not tables):
        yield f"[{'.'.join(where)}]"
    yield from (toml_pair(key, value) for key, value in plain.items() if value is not None)
    if plain:
        yield ""
    for key, value in tables.items():
        yield from _table(value, (*where, key))


def absolute_files(values: dict[str, Any]) -> None:
    """Make file paths absolute, because the new file may be in another folder."""
    for key in FILE_KEYS:
        *sections, name = key.split(".")
        table: Any = values
        for section in sections:
            table = table.get(section) if isinstance(table, dict) else None
        if isinstance(table, dict) and isinstance(table.get(name), str) and table[name]:
            table[name] = str(Path(table[name]).resolve())
