"""The emulated devices alone, served until a person stops them."""

import asyncio
import json
import math
import signal
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.clock.realtime import real_time_thread
from hil_bridge.errors import BridgeError, DeviceError
from hil_bridge.runs.beside import going_on
from hil_bridge.runs.compose import ServedCell, emulated_cell, follow_unmodelled
from hil_bridge.runs.lateness import Lateness
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.devices import Robot
from protocol.unmodelled import NotModelled, relied_on


def serve(setup: Setup, as_json: bool) -> None:
    """Serve the emulated devices of a setup and print where, until SIGINT or SIGTERM."""
    realtime = setup.config.realtime
    with real_time_thread(realtime) as executor:
        run_real(lambda: _serve(setup, as_json, executor), realtime.busy_poll_ms * 1e-3)


async def _serve(setup: Setup, as_json: bool, executor: ThreadPoolExecutor | None) -> None:
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
        async with emulated_cell(setup, clock, failed, _log) as served:
            follow_unmodelled(served.cell, tell)
            where = _where(served)
            if served.sensor is not None:
                where["tool-mass-kg"] = f"{setup.config.cell.tool.mass_kg:g}"
            if as_json:
                click.echo(json.dumps(where))
            else:
                for device, url in where.items():
                    click.echo(f"{device}: {url}")
                can_probe = served.robot is not None and served.robot.kind.name == "s3"
                click.echo(f"Connect with: {client_of(where, can_probe)}\nStop with Ctrl-C.")
            lateness = Lateness(_cycle_of(served.robot), _log)
            async with going_on(lateness.watch(clock), "lateness"):
                await stopped.wait()
            if lateness.describe():
                _log(lateness.describe())
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


def _cycle_of(robot: Robot | None) -> float:
    """Cycle of an emulated robot, s: 0 without a robot, infinite for one that has none."""
    if robot is None:
        return 0.0
    return robot.kind.facts(robot.url, robot.settings).cycle_s or math.inf


def _where(served: ServedCell) -> dict[str, str]:
    """URLs of what is served, by its name."""
    devices = {"robot": served.robot, "sensor": served.sensor}
    where = {name: device.named_url for name, device in devices.items() if device is not None}
    return where if served.panel is None else {**where, "panel": served.panel}


def client_of(where: Mapping[str, str], can_probe: bool) -> str:
    """A command that talks to the devices that are served; no run takes a robot without a sensor."""
    match where:
        case {"robot": robot, "sensor": sensor, "tool-mass-kg": mass}:
            return f"hil-bridge run --robot '{robot}' --sensor '{sensor}' --tool-mass-kg {mass}"
        case {"robot": robot} if not can_probe:
            return f"hil-bridge run --robot '{robot}' --sensor URL, with a sensor that feels what the robot touches"
        case {"robot": robot}:
            return f"hil-bridge probe robot '{robot}'"
        case _:
            return f"hil-bridge run --sensor '{where['sensor']}' --tool-mass-kg {where['tool-mass-kg']}"
