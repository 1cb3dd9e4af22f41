"""`hil-bridge monitor`: decoded traffic of a link, from a file or live. It only receives."""

import asyncio
import itertools
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack, ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import click
from pydantic import TypeAdapter

from hil_bridge.clock import Clock, run_real
from hil_bridge.console.printing import Printer, end, stop_on_signals
from hil_bridge.device_commands.s3.capture import Piece, Sender, link_pieces, parse_capture
from hil_bridge.device_commands.s3.link_monitor import Counts, LinkMonitor
from hil_bridge.device_commands.s3.printing import counts_text, print_lines
from hil_bridge.devices.kinds import ROBOTS, SENSORS, Registry, robot_of
from hil_bridge.devices.robots.s3.orders_file import read_orders
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.devices.robots.s3.room import robot_wire
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import open_ordinary, parse_json, read_text
from hil_bridge.record import read_link
from hil_bridge.settings.kinds import settings_of
from hil_bridge.site.monitoring import MonitorOptions
from hil_bridge.transports import connect_bytes
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.arap import KNOWN, OrderBook

MCAP_MAGIC = b"\x89MCAP0\r\n"
_TICK_S = 0.25
"""Interval at which a live link is checked for time-outs, s. Chosen."""


def monitor_file(path: Path, link: LinkProfile | None, orders: OrderBook, raw: bool) -> None:
    """Print the decoded link traffic of a recording or a text capture, and its totals.

    `link` contains the settings of the line; None selects the settings of the recorded run. Raises ConfigError if
    the file is invalid.
    """
    pieces, recorded = _pieces(path)
    if not pieces:
        raise ConfigError(f"{path} contains no traffic of a computer link")
    monitor = LinkMonitor(link or recorded, orders)
    show = Printer(raw, pieces[0].at)
    for piece in pieces:
        monitor.take(piece)
        print_lines(show, monitor)
    monitor.finish()
    print_lines(show, monitor)
    click.echo(counts_text(monitor.counts, pieces[-1].at - pieces[0].at))


def monitor_link(
    urls: Sequence[str], link: LinkProfile, orders: OrderBook, raw: bool, save: Path | None
) -> None:
    """Monitor a link until Ctrl-C, on one wire for both directions, or on two wires, one for the PC and one for the
    robot.

    `save` is a new file for a text capture. Raises ConfigError for an invalid URL or file, TransportError if a wire
    cannot be opened or ends.
    """
    with ExitStack() as stack:
        keep: Callable[[Piece], object] = _drop
        if save is not None:
            try:
                file = stack.enter_context(save.open("x", encoding="utf-8", buffering=1))
            except FileExistsError as error:
                raise ConfigError(f"{save} already exists; choose another file or remove it") from error
            except OSError as error:
                raise ConfigError(f"cannot write {save}: {error.strerror}") from error
            print("# seconds, who sent it, bytes", file=file)
            keep = partial(print, file=file)
        monitor = run_real(lambda: listen(urls, link, orders, Printer(raw), keep))
    click.echo(counts_text(*monitor))


def _drop(piece: Piece) -> None:
    """Do nothing, because no file was requested."""


async def listen(
    urls: Sequence[str],
    link: LinkProfile,
    orders: OrderBook,
    show: Printer,
    keep: Callable[[Piece], object],
) -> tuple[Counts, float]:
    """Monitor the wires until a signal arrives or one of the wires ends. Return the totals and the duration of the
    traffic, s.

    `keep` receives every piece. Errors as for `monitor_link`.
    """
    clock = Clock.running()
    senders = (Sender.UNKNOWN,) if len(urls) == 1 else (Sender.PC, Sender.ROBOT)
    begun = newest = 0.0
    monitor: LinkMonitor | None = None

    def arrived(sender: Sender, data: bytes) -> None:
        nonlocal begun, newest
        assert monitor is not None
        begun, newest = begun or clock.now(), clock.now()
        piece = Piece(newest - begun, sender, data)
        keep(piece)
        monitor.take(piece)
        print_lines(show, monitor)

    try:
        async with AsyncExitStack() as stack:
            ended: asyncio.Future[None] = clock.loop.create_future()
            wires = []
            for url, sender in zip(urls, senders, strict=True):
                wire_url, link = robot_wire(url, link)
                wire = await connect_bytes(wire_url, clock)
                stack.push_async_callback(wire.aclose)
                wires.append((wire, sender))
            monitor = LinkMonitor(link, orders)
            for wire, sender in wires:
                wire.start(partial(arrived, sender), partial(end, ended))
            stop_on_signals(clock, ended)
            while not ended.done():
                await asyncio.wait([ended], timeout=_TICK_S)
                if begun:
                    monitor.idle(clock.now() - begun)
                    print_lines(show, monitor)
            monitor.finish()
            print_lines(show, monitor)
            ended.result()
            return monitor.counts, newest - begun
    finally:
        clock.close()


def _pieces(path: Path) -> tuple[list[Piece], LinkProfile]:
    """Return the pieces in a file, and the link settings of the file."""
    with open_ordinary(path) as file:
        head = file.read(len(MCAP_MAGIC))
    if head == MCAP_MAGIC:
        records, metadata = read_link(path)
        return list(link_pieces(records, str(path))), _read_link_settings(metadata.get("config", ""))
    return list(parse_capture(read_text(path), str(path))), LinkProfile()


def _read_link_settings(config: str) -> LinkProfile:
    """Return the settings of the robot's link in a recorded configuration, or the defaults if it contains none."""
    try:
        robot = parse_json(config)["robot"]
        link = TypeAdapter(LinkProfile).validate_python(robot["link"])
        return robot_wire(robot["url"], link)[1] if robot["url"] else link
    except (ValueError, TypeError, KeyError, ConfigError):
        return LinkProfile()


def monitor(sources: Sequence[str], options: MonitorOptions) -> None:
    """Print a file, or the links at one or two URLs, as the extension `monitor-s3`. Raises ConfigError if a source
    is invalid.
    """
    first = sources[0]
    settings = settings_of(options.config, S3).client
    link, file = settings.link, settings.orders_file
    named = options.orders_file or (Path(file) if file else None)
    orders = read_orders(named, link.max_telegram) if named else KNOWN
    if len(sources) == 1 and (Path(first).exists() or Path(first).suffix == ".mcap"):
        monitor_file(Path(first), link if options.is_configured else None, orders, options.raw)
        return
    if len(sources) > 2:
        raise ConfigError("at most two URLs: one for the PC and one for the robot")
    registries: tuple[Registry[Any], ...] = (ROBOTS, SENSORS)
    for source, registry in itertools.product(sources, registries):
        other = registry.split(source)[0]
        if other not in ("", S3.name):
            raise ConfigError(
                f"only the link of an s3 can be monitored, not that of {other}; record a run, and give the recording: "
                f"hil-bridge monitor RECORDING --device {registry.thing}"
            )
    wires = tuple(robot_of(source)[1] for source in sources)
    monitor_link(wires, link, orders, options.raw, options.save)
