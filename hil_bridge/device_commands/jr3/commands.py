"""Commands for the JR3: `hil-bridge emulate jr3-pci`, `decode jr3-can` and `decode jr3-uart`.

`emulate jr3-pci` serves a real board of this computer to a bridge on this or another computer.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from hil_bridge.console.decode_arguments import print_items, read_bytes, read_frames
from hil_bridge.console.paths import FILE


def _number(context: click.Context, parameter: click.Parameter, text: str) -> int:
    try:
        return int(text, 0)
    except ValueError:
        raise click.BadParameter(f"must be a number such as 0x18000, got {text!r}") from None


@click.command("jr3-pci", short_help="Serve the registers of a real JR3 PCI board.")
@click.option(
    "--pci",
    "address",
    required=True,
    metavar="ADDRESS",
    help="PCI address, such as 0000:03:00.0.",
)
@click.option(
    "--listen",
    metavar="HOST:PORT",
    default="127.0.0.1:1762",
    show_default=True,
    help="Address for clients. There is no password: beyond this computer, use an isolated network.",
)
@click.option(
    "--offset",
    metavar="BYTES",
    default="0x18000",
    show_default=True,
    callback=_number,
    help="Byte at which a channel's words begin; some boards need 0x10000.",
)
@click.option("--channel", type=int, default=0, show_default=True, help="Channel of the board.")
@click.option(
    "--program",
    type=FILE,
    metavar="FILE",
    help="JR3's jr3pci.idm: allows clients to reset the board, which loses its program.",
)
@click.option("--sysfs", type=FILE, metavar="DIR", help="Folder of the PCI devices in sysfs.")
def jr3_pci(
    address: str, listen: str, offset: int, channel: int, program: Path | None, sysfs: Path | None
) -> None:
    """Serve the registers of a real JR3 PCI board until stopped with Ctrl-C.

    The board's program must run: load the kernel's driver jr3_pci once, or give it with --program.
    """
    from hil_bridge.devices.sensors.jr3.registers.pci import SYSFS, open_pci, read_program
    from hil_bridge.devices.sensors.jr3.registers.pci_server import serve_pci

    words = () if program is None else read_program(program)
    serve_pci(open_pci(address, channel, offset, words, sysfs or SYSFS), listen, offset)


@click.command("jr3-can", short_help="Decode frames of the JR3 CAN gateway.")
@click.argument("frames", metavar="ID#DATA…", nargs=-1, required=True)
def jr3_can(frames: tuple[str, ...]) -> None:
    """Decode frames of the JR3 CAN gateway, 201#C80010270000, or lines of candump, each quoted.

    Exits with code 2 if any of them is invalid.
    """
    from hil_bridge.errors import ConfigError
    from protocol.devices.jr3 import describe, parse_frame

    items = []
    for text in read_frames(frames):
        try:
            items.append(describe(parse_frame(text)))
        except ValueError as error:
            raise ConfigError(f"frame {text!r}: {error}") from error
    print_items(items)


@click.command("jr3-uart", short_help="Decode bytes of the JR3 UART gateway.")
@click.argument("hex_bytes", metavar="HEX…", nargs=-1, required=True)
def jr3_uart(hex_bytes: tuple[str, ...]) -> None:
    """Decode bytes of the JR3 UART gateway's line, of either direction or both: "3C 30 36 3E".

    Exits with code 2 if any of them is invalid.
    """
    from protocol.devices.jr3.uart_gateway import describe

    print_items(describe(read_bytes(hex_bytes)))


def monitor(sources: Sequence[str], options: Any) -> None:
    """Print the frames of a CAN bus, as the extension `monitor-jr3` of `hil-bridge monitor`.

    `options` are `hil_bridge.site.monitoring.MonitorOptions`. Raises ConfigError if a source or an option is
    invalid.
    """
    from hil_bridge.devices.kinds import SENSORS
    from hil_bridge.devices.sensors.jr3.monitor import monitor_can
    from hil_bridge.errors import ConfigError

    if len(sources) > 1:
        raise ConfigError("only one CAN bus can be monitored: give one URL")
    monitor_can(SENSORS.split(sources[0])[1], options.raw)
