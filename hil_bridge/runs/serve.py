"""Emulated devices without a run, served until an operator stops them."""

import asyncio
import json
import math
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.clock.realtime import gc_frozen, real_time_thread
from hil_bridge.devices.panel import panel_address
from hil_bridge.errors import BridgeError, DeviceError
from hil_bridge.runs.background_tasks import background_task
from hil_bridge.runs.compose import ServedCell, check_controls, emulated_cell, follow_unmodelled
from hil_bridge.runs.lateness import Lateness
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.devices import Robot
from hil_bridge.show.terminal import REFRESH_SECONDS
from hil_bridge.show.web.feed import PANEL_PAGE, Feed, WebOptions
from protocol.unmodelled import NotModelled, describe_unmodelled

_CHECK_S = 0.05
"""Interval between two checks whether the robot may move, s. Chosen."""
_FREE_S = 1.0
"""Time for which a robot must have been able to move before the same reason is logged again, s. Chosen."""


def serve(setup: Setup, as_json: bool, web_port: int | None = None) -> None:
    """Serve the emulated devices of a setup and print their URLs, until SIGINT or SIGTERM.

    `web_port` is the port of a page with the robot's panel, 0 for a free port, or None for no page. Raises
    ConfigError.
    """
    realtime, panel_url = setup.config.realtime, setup.listen.panel
    if panel_url:
        check_controls(setup.cell_robot.kind, "run.panel_url (--panel)")
        panel_address(panel_url)
    if web_port is not None:
        check_controls(setup.cell_robot.kind, "--web")
    with real_time_thread(realtime) as executor, _open_page(web_port) as feed:
        run_real(lambda: _serve(setup, as_json, executor, feed), realtime.busy_poll_ms * 1e-3)


@contextmanager
def _open_page(port: int | None) -> Iterator[Feed | None]:
    """Open the feed of a page with the robot's panel, if requested. Raises ConfigError."""
    if port is None:
        yield None
        return
    feed = Feed(WebOptions(port, page=PANEL_PAGE))
    try:
        yield feed
    finally:
        feed.close()


async def _serve(setup: Setup, as_json: bool, executor: ThreadPoolExecutor | None, feed: Feed | None) -> None:
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

    with suppress(NotImplementedError):  # other platforms do not support signal handlers in loops
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stopped.set)
    try:
        async with emulated_cell(setup, clock, failed, _log) as served:
            follow_unmodelled(served.cell, tell)
            where = _where(served)
            if feed is not None and served.operated is not None:
                feed.listen(lambda: None, lambda text: _log(f"{text}; the devices are served on"))
                feed.offer(served.operated)
                where["page"] = feed.url
            if served.sensor is not None:
                where["tool-mass-kg"] = f"{setup.config.cell.tool.mass_kg:g}"
            if as_json:
                click.echo(json.dumps(where))
            else:
                for device, url in where.items():
                    click.echo(f"{device}: {url}")
                can_probe = served.robot is not None and served.robot.kind.probe is not None
                click.echo(f"Connect with: {client_of(where, can_probe)}")
                if "panel" in where:
                    click.echo(f"Operate it with: hil-bridge panel {where['panel']}")
                click.echo("Stop with Ctrl-C.")
            lateness = Lateness(_cycle_of(served.robot), _log)
            with gc_frozen():
                async with (
                    background_task(lateness.watch(clock), "lateness"),
                    background_task(_show_panel(feed), "page"),
                    background_task(report_hindrances(served, clock, _log), "hindrances"),
                ):
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
            _log(describe_unmodelled(things))


async def _show_panel(feed: Feed | None) -> None:
    """Send the state of the panel to the page periodically."""
    while feed is not None:
        feed.show_panel()
        await asyncio.sleep(REFRESH_SECONDS)


async def report_hindrances(served: ServedCell, clock: Clock, log: Callable[[str], object]) -> None:
    """Log each reason that keeps the emulated robot from moving. A reason is repeated only after the robot could
    move for a while.

    A controller without a client starts and times out periodically.
    """
    # a polled robot reports to its client what stops it
    if not 0.0 < _cycle_of(served.robot) < math.inf:
        return
    logged, free_s = set[str](), 0.0
    while True:
        await asyncio.sleep(_CHECK_S)
        hindrance = served.cell.robot.hindrance(clock.now())
        if hindrance is None:
            free_s += _CHECK_S
            continue
        if free_s > _FREE_S:
            logged.clear()
        if hindrance.words not in logged:
            logged.add(hindrance.words)
            log(f"robot: {hindrance.words}")
        free_s = 0.0


def _log(text: str) -> None:
    click.echo(text, err=True)


def _cycle_of(robot: Robot | None) -> float:
    """Return the cycle time of an emulated robot, s: 0 without a robot, infinite for a robot without a cycle."""
    if robot is None:
        return 0.0
    return robot.kind.facts(robot.url, robot.settings).cycle_s or math.inf


def _where(served: ServedCell) -> dict[str, str]:
    """Return the URLs of the served devices, by name."""
    devices = {"robot": served.robot, "sensor": served.sensor}
    where = {name: device.named_url for name, device in devices.items() if device is not None}
    return where if served.panel is None else {**where, "panel": served.panel}


def client_of(where: Mapping[str, str], can_probe: bool) -> str:
    """Return a command that connects to the served devices. No run accepts a robot without a sensor, so the command
    for a robot alone probes it or asks for a sensor.
    """
    match where:
        case {"robot": robot, "sensor": sensor, "tool-mass-kg": mass}:
            return f"hil-bridge run --robot '{robot}' --sensor '{sensor}' --tool-mass-kg {mass}"
        case {"robot": robot} if not can_probe:
            return f"hil-bridge run --robot '{robot}' --sensor URL, with a sensor that feels what the robot touches"
        case {"robot": robot}:
            return f"hil-bridge probe robot '{robot}'"
        case _:
            return f"hil-bridge run --sensor '{where['sensor']}' --tool-mass-kg {where['tool-mass-kg']}"
