"""`hil-bridge decode`: pasted bytes and frames, as JSON."""

import json
import sys
from pathlib import Path

import click

from hil_bridge.console.options import tell
from hil_bridge.console.paths import FILE


class _Kinds(click.Group):
    """The commands of our own, and one for each kind of device."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name. Raises ConfigError for a kind without words, and for a broken package."""
        return super().get_command(ctx, cmd_name) or _kind_command(cmd_name)

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


def _kind_command(name: str) -> click.Command | None:
    """The command of a kind of device; None where there is no such kind. Raises ConfigError."""
    from hil_bridge.devices.kinds import ROBOTS, SENSORS, words_of
    from hil_bridge.errors import ConfigError

    found = [registry.kind(name) for registry in (ROBOTS, SENSORS) if name in registry.names]
    if not found:
        known = dict.fromkeys((*decode.commands, *ROBOTS.names, *SENSORS.names))
        raise ConfigError(f"there is no kind {name!r} to decode; choose one of {', '.join(known)}")
    kind = next((kind for kind in found if kind.describe is not None), found[0])
    describe = words_of(kind)
    if describe is None:
        raise ConfigError(f"{name}: there are no words for the bytes of {kind.summary!r}; nothing is decoded")
    frames = getattr(kind, "bus", None) is not None

    def run(texts: tuple[str, ...]) -> None:
        pasted = [text.encode(errors="replace") for text in _frames(texts)] if frames else [_bytes(texts)]
        _print([item for raw in pasted for item in describe(raw)])

    argument = click.Argument(["texts"], metavar="ID#DATA…" if frames else "HEX…", nargs=-1, required=True)
    pasted_as = (
        "frames, 201#C800, or lines of candump, each quoted"
        if frames
        else "bytes, of one datagram or of a line"
    )
    about = f"{kind.summary}: {pasted_as}.\n\nEnds with exit code 2 when anything in it is wrong."
    return click.Command(name, callback=run, params=[argument], help=about)


@click.group(cls=_Kinds, no_args_is_help=False, short_help="Decode pasted bytes or frames to JSON.")
def decode() -> None:
    """Decode pasted bytes or frames to JSON: fields, units, and what is wrong and where."""


def _print(items: list[dict[str, object]]) -> None:
    tell([json.dumps(items, indent=1, ensure_ascii=False)])
    if any(item.get("problem") or item.get("problems") or item.get("kind") == "noise" for item in items):
        sys.exit(2)


def _bytes(hex_bytes: tuple[str, ...]) -> bytes:
    """The pasted bytes. Raises ConfigError naming the digit that is none."""
    from hil_bridge.errors import ConfigError

    text = "".join(hex_bytes).replace(":", "").replace(",", "")
    text = "".join(text.split())
    if not text:
        raise ConfigError("HEX: nothing to decode; give byte pairs like 10 02")
    for position, character in enumerate(text):
        if character not in "0123456789abcdefABCDEF":
            raise ConfigError(
                f"HEX: {character!r} at digit {position + 1} is no hexadecimal digit; give byte pairs like 10 02"
            )
    if len(text) % 2:
        raise ConfigError(f"HEX: {len(text)} digits are no whole bytes; one digit is missing or too many")
    return bytes.fromhex(text)


def _frames(texts: tuple[str, ...]) -> tuple[str, ...]:
    """The pasted frames as `ID#DATA`, of lines of candump those in them. Raises ConfigError naming a line."""
    from hil_bridge.errors import ConfigError
    from protocol.can.text import parse_candump

    if any(
        text.startswith("(") or len(text.split()) > 1 for text in texts
    ):  # quoted, or a line that the shell split
        quoted = all(len(text.split()) > 1 for text in texts)
        lines = "\n".join(texts).splitlines() if quoted else [" ".join(texts)]
    elif len(texts) > 1 and not all("#" in text for text in texts):
        lines = [" ".join(texts)]
    else:
        return texts
    frames = []
    for line in filter(str.strip, lines):
        try:
            frames.append(str(parse_candump(line).frame))
        except ValueError as error:
            raise ConfigError(f"{line.strip()[:80]!r}: {error}; quote each line of candump") from error
    return tuple(frames)


@decode.command("computer-link", short_help="Decode bytes of the S3 computer link.")
@click.argument("hex_bytes", metavar="HEX…", nargs=-1, required=True)
@click.option(
    "--orders",
    "orders_file",
    type=FILE,
    metavar="FILE",
    help="TOML file of orders that the site knows beside the usual ones.",
)
def computer_link(hex_bytes: tuple[str, ...], orders_file: Path | None) -> None:
    """Decode bytes of the S3 computer link, control bytes and blocks mixed.

    HEX may be spaced as you like: "10 02 00 08 01 00 13 01 00 00 10 03 18" or 100200…
    Ends with exit code 2 when anything in it is wrong.
    """
    from protocol.devices.s3.adlp import LinkProfile
    from protocol.devices.s3.arap import KNOWN, describe

    raw = _bytes(hex_bytes)
    longest, orders = LinkProfile().max_telegram, KNOWN
    if orders_file is not None:
        from hil_bridge.devices.robots.s3.orders_file import read_orders

        orders = read_orders(orders_file, longest)
    _print(describe(raw, max_telegram=longest, orders=orders))


@decode.command("jr3-can", short_help="Decode frames of the JR3 CAN gateway.")
@click.argument("frames", metavar="ID#DATA…", nargs=-1, required=True)
def jr3_can(frames: tuple[str, ...]) -> None:
    """Decode frames of the JR3 CAN gateway, 201#C80010270000, or lines of candump, each quoted.

    Ends with exit code 2 when anything in it is wrong.
    """
    from hil_bridge.errors import ConfigError
    from protocol.devices.jr3 import describe, parse_frame

    items = []
    for text in _frames(frames):
        try:
            items.append(describe(parse_frame(text)))
        except ValueError as error:
            raise ConfigError(f"frame {text!r}: {error}") from error
    _print(items)


@decode.command("jr3-uart", short_help="Decode bytes of the JR3 UART gateway.")
@click.argument("hex_bytes", metavar="HEX…", nargs=-1, required=True)
def jr3_uart(hex_bytes: tuple[str, ...]) -> None:
    """Decode bytes of the JR3 UART gateway's line, of either direction or both: "3C 30 36 3E".

    Ends with exit code 2 when anything in it is wrong.
    """
    from protocol.devices.jr3.uart_gateway import describe

    _print(describe(_bytes(hex_bytes)))
