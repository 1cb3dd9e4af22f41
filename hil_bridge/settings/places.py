"""Files that a configuration names, looked for beside it."""

from pathlib import Path
from typing import Any

FILE_KEYS = (
    "cell.s3.robot.program_folder",
    "cell.surface.height_map_file",
    "controller.parameters.file",
    "controller.parameters.rules_file",
    "task.file",
)
"""Keys that name a file; one that is not absolute is looked for beside the configuration that names it."""
_WITH_KINDS = ("robot", "sensor", "cell")
"""Sections with a table for each kind; a kind names its files and folders by keys that end so:"""
_ENDINGS = ("_file", "_folder")


def resolve_files(values: dict[str, Any], folder: Path) -> None:
    """Make the files that a configuration names relative to its own place; it has not been checked yet."""
    named: dict[str, None] = dict.fromkeys(FILE_KEYS)
    for section in _WITH_KINDS:
        for kind in _table(values, section):
            inner = _table(values, section, kind)
            named.update((f"{section}.{kind}.{name}", None) for name in inner if name.endswith(_ENDINGS))
    for key in named:
        *sections, name = key.split(".")
        table = _table(values, *sections)
        if isinstance(table.get(name), str) and table[name]:
            table[name] = str(folder / table[name])


def _table(values: Any, *sections: str) -> dict[str, Any]:
    """The table itself; an empty one where there is none."""
    for section in sections:
        values = values.get(section) if isinstance(values, dict) else None
    return values if isinstance(values, dict) else {}
