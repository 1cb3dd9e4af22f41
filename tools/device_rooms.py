"""An import contract over folders of devices: each device has one room in each folder, by one name.

A room of one device imports no room of another, and no module outside the devices' rooms imports one. Only direct
imports count. `import-linter` calls this; `pyproject.toml` has the settings.
"""

from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


def device_of(module: str, folders: list[str]) -> str | None:
    """Return the name of the device whose room holds a module; None outside, and for a folder's own modules."""
    for folder in folders:
        if module.startswith(f"{folder}."):
            return module[len(folder) + 1 :].partition(".")[0]
    return None


class DeviceRooms(Contract):
    """`folders` are the folders that hold a room for each device."""

    folders = fields.ListField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Find the imports that the rule forbids."""
        settings: Any = self  # the fields stand for lists of names
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
        """Return whether a name is a folder with modules; a file beside the rooms serves all devices."""
        return any(
            f"{folder}.{name}" in graph.modules and graph.find_children(f"{folder}.{name}")
            for folder in folders
        )

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print a line for each import."""
        for module, imported in check.metadata["broken"]:
            output.print_error(f"{module} imports {imported}")
