"""An import contract over folders of devices: each device has one room in each folder, by one name.

A room of one device imports no room of another, and no module outside the devices' rooms imports one, but those that
the contract allows. Imports are direct ones: `import-linter` calls this, `pyproject.toml` has the settings.
"""

from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


def device_of(module: str, folders: list[str]) -> str | None:
    """The name of the device whose room a module stands in; None outside, and for a folder's own modules."""
    for folder in folders:
        if module.startswith(f"{folder}."):
            return module[len(folder) + 1 :].partition(".")[0]
    return None


class DeviceRooms(Contract):
    """`folders` hold a room for each device; `allowed_importers`, with all below them, may import any room."""

    folders = fields.ListField(subfield=fields.StringField())
    allowed_importers = fields.ListField(subfield=fields.StringField(), required=False)

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Every import that the rule forbids."""
        settings: Any = self  # the fields stand for lists of names
        folders, allowed = list(settings.folders), tuple(settings.allowed_importers or ())
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
            and not any(module == each or module.startswith(f"{each}.") for each in allowed)
        ]
        return ContractCheck(kept=not broken, metadata={"broken": broken})

    def _is_room(self, graph: ImportGraph, name: str, folders: list[str]) -> bool:
        """A room is a folder: a shell for all robots is a module beside them."""
        return any(
            f"{folder}.{name}" in graph.modules and graph.find_children(f"{folder}.{name}")
            for folder in folders
        )

    def render_broken_contract(self, check: ContractCheck) -> None:
        """A line for each import."""
        for module, imported in check.metadata["broken"]:
            output.print_error(f"{module} imports {imported}")
