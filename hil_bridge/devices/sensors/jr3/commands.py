"""`hil-bridge serve-jr3`: a real board of this computer, for a bridge on this or another one."""

from pathlib import Path

import click

from hil_bridge.console.paths import FILE


def _number(context: click.Context, parameter: click.Parameter, text: str) -> int:
    try:
        return int(text, 0)
    except ValueError:
        raise click.BadParameter(f"a number like 0x18000, got {text!r}") from None


@click.command("serve-jr3", short_help="Serve the registers of a real JR3 PCI board.")
@click.option("--pci", "address", required=True, metavar="ADDRESS", help="The board, like 0000:03:00.0.")
@click.option(
    "--listen",
    metavar="HOST:PORT",
    default="127.0.0.1:1762",
    show_default=True,
    help="Where clients connect. There is no password: beyond this computer, use a network of your own.",
)
@click.option(
    "--offset",
    metavar="BYTES",
    default="0x18000",
    show_default=True,
    callback=_number,
    help="Where a channel's words begin; some boards want 0x10000.",
)
@click.option("--channel", type=int, default=0, show_default=True, help="Which of the board's sensors.")
@click.option(
    "--program",
    type=FILE,
    metavar="FILE",
    help="JR3's jr3pci.idm: allows clients to reset the board, which loses its program.",
)
@click.option("--sysfs", type=FILE, metavar="DIR", help="Where the PCI devices are shown.")
def serve_jr3(
    address: str, listen: str, offset: int, channel: int, program: Path | None, sysfs: Path | None
) -> None:
    """Serve the registers of a real JR3 PCI board until stopped with Ctrl-C.

    The board's program must run: load the kernel's driver jr3_pci once, or give it with --program.
    """
    from hil_bridge.devices.sensors.jr3.registers.pci import SYSFS, open_pci, read_program
    from hil_bridge.devices.sensors.jr3.registers.serving import serve_pci

    words = () if program is None else read_program(program)
    serve_pci(open_pci(address, channel, offset, words, sysfs or SYSFS), listen, offset)
