"""Types of files and folders on the command line."""

from pathlib import Path
from typing import Any

import click


class _File(click.Path):
    """Path type of click that also refuses paths which click would pass to the operating system."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if "\0" in str(value):
            self.fail("a path must not contain a NUL character", param, ctx)
        return super().convert(value, param, ctx)


FILE = _File(path_type=Path)
"""Type of a file or folder, existing or not."""
