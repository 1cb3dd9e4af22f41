"""The emulated devices alone, served until a person stops them."""

import asyncio
import json
import signal
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.clock.realtime import real_time_thread
from hil_bridge.errors import BridgeError, DeviceError
from hil_bridge.runs.compose import Ports, emulated_cell, follow_unmodelled
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from protocol.unmodelled import NotModelled, relied_on


def serve(config: Config, ports: Ports, as_json: bool) -> None:
    """Serve on these ports and print where, until SIGINT or SIGTERM. Raises BridgeError when a port fails."""
    with real_time_thread(config.realtime) as executor:
        run_real(lambda: _serve(config, ports, as_json, executor), config.realtime.busy_poll_ms * 1e-3)


async def _serve(config: Config, ports: Ports, as_json: bool, executor: ThreadPoolExecutor | None) -> None:
    loop, clock = asyncio.get_running_loop(), Clock.running()
    if executor is not None:
        loop.set_default_executor(executor)
    stopped = asyncio.Event()
    causes: list[BaseException] = []
    things: list[NotModelled] = []

    def tell(thing: NotModelled) -> None:
        things.append(thing)
        _log(str(thing))

    def failed(cause: BaseException) -> None:
        causes.append(cause)
        stopped.set()

    with suppress(NotImplementedError):  # no signal handlers in loops of other platforms
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stopped.set)
    try:
        async with emulated_cell(Setup(config), clock, ports, failed, _log) as served:
            follow_unmodelled(served.cell, tell)
            devices = {"robot": served.robot, "sensor": served.sensor, "panel": served.panel}
            where = {device: url for device, url in devices.items() if url is not None}
            if served.sensor is not None:
                where["tool-mass-kg"] = f"{config.cell.tool.mass_kg:g}"
            if as_json:
                click.echo(json.dumps(where))
            else:
                for device, url in where.items():
                    click.echo(f"{device}: {url}")
                click.echo(f"Connect with: {client_of(where)}\nStop with Ctrl-C.")
            await stopped.wait()
            if causes:
                if isinstance(causes[0], BridgeError):
                    raise causes[0]
                raise DeviceError(f"an emulated device failed: {causes[0]!r}") from causes[0]
    finally:
        clock.close()
        if things:
            _log(relied_on(things))


def _log(text: str) -> None:
    click.echo(text, err=True)


def client_of(where: Mapping[str, str]) -> str:
    """A command that talks to what is served; no run takes a robot without a sensor."""
    match where:
        case {"robot": robot, "sensor": sensor, "tool-mass-kg": mass}:
            return f"hil-bridge run --robot '{robot}' --sensor '{sensor}' --tool-mass-kg {mass}"
        case {"robot": robot} if not robot.startswith("s3+"):
            return f"hil-bridge run --robot '{robot}' --sensor URL, with a sensor that feels what the robot touches"
        case {"robot": robot}:
            return f"hil-bridge probe robot '{robot}'"
        case _:
            return f"hil-bridge run --sensor '{where['sensor']}' --tool-mass-kg {where['tool-mass-kg']}"
