"""Paths in a configuration, relative to the folder of the configuration."""

from pathlib import Path
from typing import Any

FILE_KEYS = (
    "cell.s3.robot.program_folder",
    "cell.surface.height_map_file",
    "controller.parameters.file",
    "controller.parameters.rules_file",
    "task.file",
)
"""Keys of file names. A relative path begins at the folder of the configuration."""
_WITH_KINDS = ("robot", "sensor", "cell")
"""Sections with a table for each kind. Keys of a kind's files and folders have the endings in `_ENDINGS`."""
_ENDINGS = ("_file", "_folder")


def resolve_files(values: dict[str, Any], folder: Path) -> None:
    """Resolve paths in a configuration against its folder, in place. The values are not validated yet."""
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
    """Return the table itself, or an empty table."""
    for section in sections:
        values = values.get(section) if isinstance(values, dict) else None
    return values if isinstance(values, dict) else {}
