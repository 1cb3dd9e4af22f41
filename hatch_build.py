"""Build step: puts uPlot, which draws the charts of every page, beside `hil_bridge/show/pages`, and lists it.

The list of parts is a CycloneDX file in the wheel, where PEP 770 looks for it. It tells what the wheel carries beside
our own code; what pip installs with it stands in the metadata. A build of the same sources gives the same bytes.

uPlot is not kept in this repository. The package uplot-python carries its released script and style sheet, so that pip
alone can build this project. Nothing else of that package is taken: no module of it is imported or copied.
"""

import hashlib
import json
import tempfile
import uuid
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCE = "uplot-python==1.1.1"
UPLOT = "1.6.16"
"""Version that SOURCE carries; its licence is MIT."""
FILES = {
    "uPlot.iife.js": "655bc8aa33781e8721c5af6b59f1699c03c9bda951aa74a6ab518ac20cc4326d",
    "uPlot.min.css": "3f121cd4a997b634e07a887658850018e475c26f0bddd874109a8d382c19de87",
}
"""SHA-256 of each file that is taken."""


class UPlot(BuildHookInterface):  # type: ignore[type-arg]
    """Runs before a wheel, a source distribution and an editable installation are made."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return the packages that the build needs: none if the files exist already, as in a source distribution."""
        return [] if all(self._there(name) for name in FILES) else [SOURCE]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Copy what is missing. Raises RuntimeError for a file that cannot be found or has changed."""
        for name in FILES:
            if not self._there(name):
                self._copy(name)
        if self.target_name == "wheel" and version == "standard":
            self._folder = tempfile.TemporaryDirectory()
            parts = Path(self._folder.name) / f"{self.metadata.name}.cdx.json"
            parts.write_text(parts_list(self.metadata.name, self.metadata.version), encoding="utf-8")
            build_data["sbom_files"].append(str(parts))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the list of parts, which is in the wheel now."""
        if folder := getattr(self, "_folder", None):
            folder.cleanup()

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


def parts_list(name: str, version: str) -> str:
    """Return the parts of a wheel as CycloneDX 1.6: our own, and uPlot with the hash of each of its files."""
    own, uplot = f"pkg:pypi/{name}@{version}", f"pkg:npm/uplot@{UPLOT}"
    files = [
        {"type": "file", "name": file, "hashes": [{"alg": "SHA-256", "content": digest}]}
        for file, digest in FILES.items()
    ]
    told = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, own)}",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": own,
                "name": name,
                "version": version,
                "purl": own,
                "licenses": [{"license": {"id": "Apache-2.0"}}],
            }
        },
        "components": [
            {
                "type": "library",
                "bom-ref": uplot,
                "name": "uplot",
                "version": UPLOT,
                "purl": uplot,
                "licenses": [{"license": {"id": "MIT"}}],
                "components": files,
            }
        ],
        "dependencies": [{"ref": own, "dependsOn": [uplot]}, {"ref": uplot}],
    }
    return json.dumps(told, indent=2) + "\n"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
