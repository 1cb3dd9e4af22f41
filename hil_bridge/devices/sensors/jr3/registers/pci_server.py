"""Server of a real board, which runs until it is stopped."""

import asyncio
import signal
from contextlib import suppress

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.sensors.jr3.registers.pci import PciRegisters
from hil_bridge.devices.sensors.jr3.registers.server import ListenerProfile
from hil_bridge.devices.sensors.jr3.registers.wires import Watcher, serve_board


def serve_pci(board: PciRegisters, listen: str, offset: int) -> None:
    """Serve a board's channel on HOST:PORT and print its URL. Close the board on SIGINT or SIGTERM.

    `offset` is the byte offset at which the channel's words begin. Raises BridgeError if the board cannot be
    served.
    """
    try:
        run_real(lambda: _serve(board, f"tcp-listen://{listen}", offset))
    finally:
        board.close()


async def _serve(board: PciRegisters, url: str, offset: int) -> None:
    loop, clock = asyncio.get_running_loop(), Clock.running()
    stopped = asyncio.Event()
    with suppress(NotImplementedError):  # no signal handlers in loops of other platforms
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stopped.set)
    try:
        watcher = Watcher(_log, lambda cause: None)
        served = await serve_board(url, board, ListenerProfile(), clock, watcher)
        try:
            if text := board.text:
                click.echo(f"board: {text}")
            else:
                _log(
                    f"{board.name}: no text at byte {offset:#x}: check that its program runs and that --offset is right"
                )
            click.echo(f"sensor: jr3-board+{served.address}\nStop with Ctrl-C.")
            await stopped.wait()
        finally:
            await served.aclose()
    finally:
        clock.close()


def _log(text: str) -> None:
    click.echo(text, err=True)
