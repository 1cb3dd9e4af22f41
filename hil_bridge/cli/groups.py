"""Groups of commands from entry points: `config`, `emulate`, `identify`, `list`."""

import click

from hil_bridge.cli.entry_points import COMMANDS, EntryPointGroup


def _group(name: str, summary: str) -> click.Group:
    """Return the group that provides the commands in the entry point group `hil_bridge.commands.NAME`."""
    return EntryPointGroup(name, entry_points=f"{COMMANDS}.{name}", help=summary, no_args_is_help=False)


config = _group("config", "Write and explain configuration files; check programs.")
emulate = _group("emulate", "Serve emulated devices to any client.")
identify = _group("identify", "Identify tool, work frame, cell and emulator fidelity.")
lists = _group("list", "List runs, controllers, plug-ins, faults and facts.")
