"""Build step: puts uPlot, which draws the charts of every page, beside `hil_bridge/show/pages`.

uPlot is not kept in this repository. The package uplot-python carries its released script and style sheet, so that pip
alone can build this project. Nothing else of that package is taken: no module of it is imported or copied.
"""

import hashlib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCE = "uplot-python==1.1.1"
"""Carries uPlot 1.6.16, MIT."""
FILES = {
    "uPlot.iife.js": "655bc8aa33781e8721c5af6b59f1699c03c9bda951aa74a6ab518ac20cc4326d",
    "uPlot.min.css": "3f121cd4a997b634e07a887658850018e475c26f0bddd874109a8d382c19de87",
}
"""SHA-256 of each file that is taken."""


class UPlot(BuildHookInterface):  # type: ignore[type-arg]
    """Runs before a wheel, a source distribution and an editable installation are made."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """The packages that the build needs: none where the files are there already, as in a source distribution."""
        return [] if all(self._there(name) for name in FILES) else [SOURCE]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Copy what is missing. Raises RuntimeError for a file that cannot be found or has changed."""
        for name in FILES:
            if not self._there(name):
                self._copy(name)

    def _vendor(self) -> Path:
        return Path(self.root) / "hil_bridge" / "show" / "pages" / "vendor"

    def _there(self, name: str) -> bool:
        path = self._vendor() / name
        return path.is_file() and _digest(path.read_bytes()) == FILES[name]

    def _copy(self, name: str) -> None:
        try:
            package = distribution(SOURCE.partition("==")[0])
        except PackageNotFoundError:
            raise RuntimeError(
                f"the build needs {SOURCE}, which carries uPlot: install it, or build with isolation"
            ) from None
        path = Path(str(package.locate_file(f"uplot/static/{name}")))
        content = path.read_bytes() if path.is_file() else b""
        if _digest(content) != FILES[name]:
            raise RuntimeError(f"{path} is not the {name} of {SOURCE}: install that version")
        self._vendor().mkdir(parents=True, exist_ok=True)
        (self._vendor() / name).write_bytes(content)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
