"""`hil-bridge decode`: convert pasted bytes and frames to JSON."""

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from hil_bridge.cli.entry_points import EntryPointGroup
from hil_bridge.console.decode_arguments import print_items, read_bytes, read_frames

if TYPE_CHECKING:
    from hil_bridge.devices.kinds import Registry


class _Kinds(EntryPointGroup):
    """Commands from entry points, and one command for each kind of device."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command with this name. Raises ConfigError if the kind has no decoder or its package is broken."""
        return super().get_command(ctx, cmd_name) or _kind_command(cmd_name, self.list_commands(ctx))

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Add the kinds of device with a decoder to the help."""
        from hil_bridge.devices.kinds import ROBOTS, SENSORS

        super().format_help_text(ctx, formatter)
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(
                "Every other kind with a decoder is a command too: `decode KIND HEX…`, on CAN `decode KIND ID#DATA…`. "
                f"Robots: {', '.join(_decoded_kinds(ROBOTS))}. Sensors: {', '.join(_decoded_kinds(SENSORS))}."
            )


def _decoded_kinds(registry: "Registry[Any]") -> list[str]:
    """Return the names of the kinds with a decoder. A kind that cannot be loaded is omitted."""
    from hil_bridge.errors import ConfigError

    names = []
    for name in registry.names:
        with suppress(ConfigError):
            names += [name] * (registry.kind(name).describe is not None)
    return names


def _kind_command(name: str, others: Sequence[str]) -> click.Command | None:
    """Return the command for a kind of device. Raises ConfigError that lists the known kinds if the kind is unknown."""
    from hil_bridge.devices.kinds import ROBOTS, SENSORS, describer_of
    from hil_bridge.errors import ConfigError

    kinds = [registry.kind(name) for registry in (ROBOTS, SENSORS) if name in registry.names]
    if not kinds:
        known = dict.fromkeys((*others, *_decoded_kinds(ROBOTS), *_decoded_kinds(SENSORS)))
        raise ConfigError(f"unknown kind {name!r}; choose one of {', '.join(known)}")
    kind = next((kind for kind in kinds if kind.describe is not None), kinds[0])
    describe = describer_of(kind)
    if describe is None:
        raise ConfigError(f"{name}: {kind.summary!r} has no decoder for its bytes")
    frames = getattr(kind, "bus", None) is not None

    def run(texts: tuple[str, ...]) -> None:
        pasted = (
            [text.encode(errors="replace") for text in read_frames(texts)] if frames else [read_bytes(texts)]
        )
        print_items([item for raw in pasted for item in describe(raw)])

    argument = click.Argument(["texts"], metavar="ID#DATA…" if frames else "HEX…", nargs=-1, required=True)
    pasted_as = (
        "frames such as 201#C800, or lines of candump, each quoted"
        if frames
        else "the bytes of one datagram or one line"
    )
    about = f"{kind.summary}: {pasted_as}.\n\nThe exit code is 2 when anything in it is invalid."
    return click.Command(name, callback=run, params=[argument], help=about)


@click.group(
    cls=_Kinds,
    entry_points="hil_bridge.commands.decode",
    no_args_is_help=False,
    short_help="Decode pasted bytes or frames to JSON.",
)
def decode() -> None:
    """Decode pasted bytes or frames to JSON: fields, units, and the place of every error."""
