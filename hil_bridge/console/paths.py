"""Files on the command line."""

from pathlib import Path
from typing import Any

import click


class _File(click.Path):
    """As click has it, but that a path that cannot be is refused where click lets the system's error through."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if "\0" in str(value):
            self.fail("a path must not hold a NUL character", param, ctx)
        return super().convert(value, param, ctx)


FILE = _File(path_type=Path)
"""A file or a folder, there or not."""
