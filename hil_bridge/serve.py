"""The emulated devices alone, served until a person stops them."""

import asyncio
import json
import signal
from contextlib import suppress

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.compose import Ports, emulated_cell
from hil_bridge.config import Config
from hil_bridge.errors import BridgeError, DeviceError


def serve(config: Config, ports: Ports, as_json: bool) -> None:
    """Serve on these ports and print where, until SIGINT or SIGTERM. Raises BridgeError when a port fails."""
    run_real(lambda: _serve(config, ports, as_json))


async def _serve(config: Config, ports: Ports, as_json: bool) -> None:
    loop, clock = asyncio.get_running_loop(), Clock.running()
    stopped: asyncio.Future[None] = loop.create_future()

    def end(cause: BaseException | None = None) -> None:
        if stopped.done():
            return
        if cause is None:
            stopped.set_result(None)
        elif isinstance(cause, BridgeError):
            stopped.set_exception(cause)
        else:
            stopped.set_exception(DeviceError(f"an emulated device failed: {cause!r}"))

    with suppress(NotImplementedError):  # no signal handlers in loops of other platforms
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, end)
    try:
        async with emulated_cell(config.cell, config.run.seed, clock, ports, end) as served:
            where = {"robot": served.robot, "sensor": served.sensor}
            where = {device: url for device, url in where.items() if url is not None}
            if as_json:
                click.echo(json.dumps(where))
            else:
                for device, url in where.items():
                    click.echo(f"{device}: {url}")
                options = " ".join(f"--{device} '{url}'" for device, url in where.items())
                click.echo(f"Connect with: hil-bridge run {options}\nStop with Ctrl-C.")
            await stopped
    finally:
        clock.close()
