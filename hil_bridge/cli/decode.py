"""`hil-bridge decode`: pasted bytes and frames, as JSON."""

from collections.abc import Sequence

import click

from hil_bridge.cli.entry_points import EntryPointGroup
from hil_bridge.console.decode_arguments import print_items, read_bytes, read_frames


class _Kinds(EntryPointGroup):
    """The commands by entry point, and one for each kind of device."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name. Raises ConfigError for a kind without words, and for a broken package."""
        return super().get_command(ctx, cmd_name) or _kind_command(cmd_name, self.list_commands(ctx))

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Name the kinds of device, too; none is imported."""
        from hil_bridge.devices.kinds import ROBOTS, SENSORS

        super().format_help_text(ctx, formatter)
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(
                "Every other kind that has words is a command too: `decode KIND HEX…`, on CAN `decode KIND ID#DATA…`. "
                f"Robots: {', '.join(ROBOTS.names)}. Sensors: {', '.join(SENSORS.names)}."
            )


def _kind_command(name: str, others: Sequence[str]) -> click.Command | None:
    """The command of a kind of device. Raises ConfigError if there is none, naming the kinds and the other commands."""
    from hil_bridge.devices.kinds import ROBOTS, SENSORS, describer_of
    from hil_bridge.errors import ConfigError

    found = [registry.kind(name) for registry in (ROBOTS, SENSORS) if name in registry.names]
    if not found:
        known = dict.fromkeys((*others, *ROBOTS.names, *SENSORS.names))
        raise ConfigError(f"there is no kind {name!r} to decode; choose one of {', '.join(known)}")
    kind = next((kind for kind in found if kind.describe is not None), found[0])
    describe = describer_of(kind)
    if describe is None:
        raise ConfigError(f"{name}: there are no words for the bytes of {kind.summary!r}; nothing is decoded")
    frames = getattr(kind, "bus", None) is not None

    def run(texts: tuple[str, ...]) -> None:
        pasted = (
            [text.encode(errors="replace") for text in read_frames(texts)] if frames else [read_bytes(texts)]
        )
        print_items([item for raw in pasted for item in describe(raw)])

    argument = click.Argument(["texts"], metavar="ID#DATA…" if frames else "HEX…", nargs=-1, required=True)
    pasted_as = (
        "frames, 201#C800, or lines of candump, each quoted"
        if frames
        else "bytes, of one datagram or of a line"
    )
    about = f"{kind.summary}: {pasted_as}.\n\nEnds with exit code 2 when anything in it is wrong."
    return click.Command(name, callback=run, params=[argument], help=about)


@click.group(
    cls=_Kinds,
    entry_points="hil_bridge.commands.decode",
    no_args_is_help=False,
    short_help="Decode pasted bytes or frames to JSON.",
)
def decode() -> None:
    """Decode pasted bytes or frames to JSON: fields, units, and what is wrong and where."""
