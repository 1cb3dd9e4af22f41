"""Import contract over folders of devices: each device has one package of the same name in each folder.

A package of one device must not import a package of another device, and no module outside these packages may import
one. Only direct imports count. `import-linter` calls this module; `pyproject.toml` has the settings.
"""

from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


def device_of(module: str, folders: list[str]) -> str | None:
    """Return the name of the device whose package contains a module; None if no device's package contains it."""
    for folder in folders:
        if module.startswith(f"{folder}."):
            return module[len(folder) + 1 :].partition(".")[0]
    return None


class DeviceRooms(Contract):
    """Import contract of devices; `folders` are the folders that contain a package for each device."""

    folders = fields.ListField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Find the imports that the contract forbids."""
        settings: Any = self  # at run time the fields are lists of names
        folders = list(settings.folders)
        rooms = {
            module: name
            for module in graph.modules
            if (name := device_of(module, folders)) is not None and self._is_room(graph, name, folders)
        }
        broken = [
            (module, imported)
            for imported, name in sorted(rooms.items())
            for module in sorted(graph.find_modules_that_directly_import(imported))
            if rooms.get(module) != name
        ]
        return ContractCheck(kept=not broken, metadata={"broken": broken})

    def _is_room(self, graph: ImportGraph, name: str, folders: list[str]) -> bool:
        """Return whether a name is a folder with modules. A single file next to the packages serves all devices."""
        return any(
            f"{folder}.{name}" in graph.modules and graph.find_children(f"{folder}.{name}")
            for folder in folders
        )

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print a line for each forbidden import."""
        for module, imported in check.metadata["broken"]:
            output.print_error(f"{module} imports {imported}")
