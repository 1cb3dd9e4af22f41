"""Turnaround: a sensor sample and the end of a status answer in, the next order out, through the whole bridge.

The bridge is a process of its own as a person would start it, its recorder on and its view off. This process plays
both devices. The baselines say the same messages over the same wires to the same devices, and decide nothing.
"""

import os
import pty
import signal
import socket
import subprocess
import sys
import tempfile
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from hil_bridge.clock.realtime import RealTime, real_time_thread
from hil_bridge.errors import ConfigError
from protocol.devices.s3.adlp import BLOCK_OVERHEAD, HEADER_SIZE, encode_block
from protocol.devices.s3.arap import STATUS, Move, MoveKind, read_status
from tools.bench import machine
from tools.bench.devices import (
    PATIENCE_S,
    PERIOD_MS,
    START,
    CanSensor,
    Cell,
    PeerSilent,
    SensorPeer,
    Turn,
    UartSensor,
)
from tools.bench.figures import Figure, Report, Spread, Target

HERE = Path(__file__).parent
CYCLES = 2500
WARM_UP = 500
"""The first turnarounds, which are thrown away: caches, and the approach."""
INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended."""
MICRO = 1e6
TIMED = (("first byte", "bid"), ("whole order", "order"))
"""Timed ways, and the member of a Turn for each."""
BUSY_POLL_MS = 100.0
"""Longer than any wait of a cycle, so that the bridge never sleeps."""
AWAKE = ", processors kept awake"
STOLEN = "processor time that the host kept for itself while the bridge ran"
P50, P99 = Target("ratio", 2.0, aim=1.5), Target("ratio", 3.0, aim=2.0)
CONFIG = f"""\
[run]
duration_s = 600.0
[task]
speed_mm_s = 0.0
approach_speed_mm_s = 40.0
retract_mm = 1.0
[limits]
correction_mm_s = 50.0
[robot.s3.link]
baudrate = 1000000
[sensor.jr3.uart]
cutoff_hz = 0.0
period_ms = {PERIOD_MS}
pause_s = 0.02
settle_s = 0.02
[sensor.jr3.gateway]
cutoff_hz = 0.0
period_ms = {PERIOD_MS}
[realtime]
busy_poll_ms = %g
"""
"""The tool stays over one place, since a thousand cycles a second would soon be out of reach. Neither the line nor the
sensor's filter delays anything, and the controller, which allows for both, has to be told. A thousand cycles a second
pass while a pseudo-terminal is held up by the machine for a moment. That is to be measured, not to end the run.
"""


@dataclass(frozen=True, slots=True)
class Wires:
    """Two open wires and how the other side finds them."""

    robot: int
    sensor: SensorPeer
    plain: tuple[str, str]
    """URLs for the baselines."""
    urls: tuple[str, str]
    """URLs for the bridge."""
    accept: Callable[["Wires"], "Wires"]
    """The wires once the other side has come."""


@contextmanager
def tcp() -> Iterator[Wires]:
    """Loopback, without Nagle's delay."""
    with ExitStack() as stack:
        servers = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(2)]
        ports = [server.getsockname()[1] for server in servers]

        def accept(wires: Wires) -> Wires:
            fds = []
            for server in servers:
                server.settimeout(20.0)
                connection = stack.enter_context(server.accept()[0])
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                connection.setblocking(True)
                fds.append(connection.fileno())
            return Wires(fds[0], UartSensor(fds[1]), wires.plain, wires.urls, accept)

        at = [f"127.0.0.1:{port}" for port in ports]
        urls = (f"s3+tcp://{at[0]}", f"jr3-uart+tcp://{at[1]}")
        yield Wires(-1, UartSensor(-1), (f"tcp:{at[0]}", f"tcp:{at[1]}"), urls, accept)


@contextmanager
def pseudo_terminals() -> Iterator[Wires]:
    """Two pseudo-terminals, raw."""
    with ExitStack() as stack:
        masters, names = [], []
        for _ in range(2):
            master, slave = pty.openpty()
            tty.setraw(slave)
            names.append(os.ttyname(slave))
            masters.append(master)
            stack.callback(os.close, master)
            # kept open here too, or the master would read an end before the other side has come
            stack.callback(os.close, slave)
        urls = (f"s3+serial://{names[0]}", f"jr3-uart+serial://{names[1]}")
        plain = (f"pty:{names[0]}", f"pty:{names[1]}")
        yield Wires(masters[0], UartSensor(masters[1]), plain, urls, lambda wires: wires)


@contextmanager
def vcan() -> Iterator[Wires]:
    """The robot on a pseudo-terminal, the sensor on a virtual CAN interface. Raises OSError where there is none."""
    name = f"bench{os.getpid()}"[:15]
    added = subprocess.run(
        ["ip", "link", "add", "dev", name, "type", "vcan"], capture_output=True, text=True, check=False
    )
    if added.returncode:
        raise OSError("this kernel gives no vcan interface (as root: `modprobe vcan`)")
    try:
        subprocess.run(["ip", "link", "set", name, "up"], check=True)
        with pseudo_terminals() as wires:
            sensor = CanSensor.on(name)
            with sensor.wire:
                yield Wires(
                    wires.robot,
                    sensor,
                    (wires.plain[0], f"can:{name}"),
                    (wires.urls[0], f"jr3+can+socketcan://{name}"),
                    wires.accept,
                )
    finally:
        subprocess.run(["ip", "link", "delete", name], check=False)


WIRES = {"TCP": tcp, "pseudo-terminals": pseudo_terminals, "vcan": vcan}


def plain_arguments(wires: Wires) -> list[str]:
    """Arguments of the baselines: wires, blocks, and the number of bytes in the answers."""
    status = encode_block(read_status().encode())
    move = encode_block(Move(MoveKind.POINT, START, (0.0, 1.0, 0.0, 0.0), 0.05).to_telegram().encode())
    sizes = (HEADER_SIZE + STATUS.size + BLOCK_OVERHEAD, HEADER_SIZE + BLOCK_OVERHEAD)
    return [*wires.plain, status.hex(), move.hex(), *map(str, sizes)]


def turns_of(wires: Wires, command: Sequence[str | Path], session: bool) -> list[Turn]:
    """Start the other side, let it make its cycles, and end it. Raises PeerSilent with what it said.

    With a `session` it brings the devices up first, and is interrupted as by a person when it has done enough."""
    ending = signal.SIGINT if session else signal.SIGTERM
    good_ends = (0, INTERRUPTED) if session else (0, -signal.SIGTERM)
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:

        def enough(count: int) -> bool:
            if count == CYCLES:
                process.send_signal(ending)
            return count >= CYCLES

        try:
            here = wires.accept(wires)
            cell = Cell(here.robot, here.sensor, lambda: process.poll() is not None, moving=not session)
            cell.serve(enough)
            said = process.communicate(timeout=PATIENCE_S)[0]
        except BaseException:
            process.kill()
            raise
    if len(cell.turns) < CYCLES or process.returncode not in good_ends:
        raise PeerSilent(
            f"the other side ended with {process.returncode} after {len(cell.turns)} cycles; it said: {said.strip()}"
        )
    return cell.turns[WARM_UP:]


def bridge_command(wires: Wires, place: Path, busy_poll_ms: float = 0.0) -> list[str | Path]:
    """A run as a person starts it, without a view."""
    config = place / "bench.toml"
    config.write_text(CONFIG % busy_poll_ms, encoding="utf-8")
    robot, sensor = wires.urls
    wires_of = ("--robot", robot, "--sensor", sensor)
    run = (
        "run",
        config,
        *wires_of,
        "--unchecked",
        "--no-view",
        "--record",
        place / "run.mcap",
        "--overwrite",
    )
    return [sys.executable, "-m", "hil_bridge", *run]


def measured(name: str, place: Path, say: Callable[[str], None]) -> tuple[Figure, ...]:
    """The figures over one kind of wire. Raises OSError where this kind is not to be had."""

    def ask(command: Callable[[Wires], Sequence[str | Path]], session: bool = False) -> list[Turn]:
        with WIRES[name]() as wires:
            return turns_of(wires, command(wires), session)

    host = machine.compiled("host")

    def in_c() -> list[Turn]:
        return [] if host is None else ask(lambda wires: [host, *plain_arguments(wires)])

    say(f"{name}: C")
    c = in_c()
    say(f"{name}: bridge")
    stolen = machine.stolen_s()
    bridge = ask(lambda wires: bridge_command(wires, place), session=True)
    stolen = machine.stolen_s() - stolen
    say(f"{name}: bridge, busy polling")
    polling = ask(lambda wires: bridge_command(wires, place, busy_poll_ms=BUSY_POLL_MS), session=True)
    say(f"{name}: asyncio alone, C again")
    plain = ask(lambda wires: [sys.executable, HERE / "asyncio_host.py", *plain_arguments(wires)])
    c += in_c()
    figures = []
    for what, member in TIMED:
        ours, polled, theirs, bare = (spread(turns, member) for turns in (bridge, polling, c, plain))
        for percentile, target in (("p50", P50), ("p99", P99)):
            title = f"{name}, {what}, {percentile}"
            base = getattr(theirs, percentile) if c else None
            figures.append(Figure(title, getattr(ours, percentile), "µs", base, "C", target))
            figures.append(
                Figure(f"{title}, busy polling", getattr(polled, percentile), "µs", base, "C", target)
            )
            base = getattr(bare, percentile)
            figures.append(Figure(title, getattr(ours, percentile), "µs", base, "asyncio alone"))
    figures.append(Figure(f"{name}, {STOLEN}", stolen, "s"))
    return tuple(figures)


def spread(turns: Sequence[Turn], member: str) -> Spread:
    """Spread of one of the times, µs."""
    return Spread([getattr(turn, member) * MICRO for turn in turns])


def kept_awake(place: Path, say: Callable[[str], None]) -> tuple[Figure, ...]:
    """Over TCP with processors that do not sleep: what is left is computing. Raises ConfigError where the machine does
    not let itself be kept awake.
    """
    host = machine.compiled("host")

    def in_c() -> list[Turn]:
        if host is None:
            return []
        with tcp() as wires:
            return turns_of(wires, [host, *plain_arguments(wires)], session=False)

    with real_time_thread(RealTime(keep_awake=True)):
        say(f"TCP{AWAKE}")
        theirs = in_c()
        stolen = machine.stolen_s()
        with tcp() as wires:
            ours = turns_of(wires, bridge_command(wires, place), session=True)
        stolen = machine.stolen_s() - stolen
        theirs += in_c()
    figures = [
        Figure(
            f"TCP, {what}, {percentile}{AWAKE}",
            getattr(spread(ours, member), percentile),
            "µs",
            getattr(spread(theirs, member), percentile) if theirs else None,
            "C",
        )
        for what, member in TIMED
        for percentile in ("p50", "p99")
    ]
    return (*figures, Figure(f"TCP, {STOLEN}{AWAKE}", stolen, "s"))


def measure(say: Callable[[str], None]) -> Report:
    """Over every kind of wire that this machine has."""
    figures: list[Figure] = []
    left_out = [] if machine.compiled("host") else [machine.NO_COMPILER]
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        place = Path(name)
        for wire in WIRES:
            try:
                figures += measured(wire, place, say)
            except OSError as error:
                left_out.append(f"{wire}: {error}")
        try:
            figures += kept_awake(place, say)
        except ConfigError as error:
            left_out.append(str(error))
    return Report(tuple(figures), tuple(left_out))
