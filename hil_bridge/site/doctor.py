"""`hil-bridge doctor`: whether this computer is fit for a run, and what to do if it is not."""

import os
import platform
import resource
import socket
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.clock.realtime import RealTime, real_time_thread
from hil_bridge.devices.kinds import CanBus
from hil_bridge.devices.robots.probe import ProbeResult
from hil_bridge.errors import ConfigError, DeviceError, SettingRefused
from hil_bridge.errors.text_files import TOML_LIMIT_BYTES, format_path, open_ordinary, read_up_to
from hil_bridge.runs.checks import problems
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.devices import Robot, robot_in, sensor_in
from hil_bridge.site import datagrams, facts
from hil_bridge.site.facts import Fact, Level, fail, ok, warn
from hil_bridge.transports.urls import WireUrl

PACKAGES = ("hil-bridge", "pyserial", "python-can", "numpy", "pydantic", "mcap", "msgspec")
PERIOD_S, CYCLES = 1e-3, 1000
"""Period and number of measured wake-ups: the rate of the fastest sensor stream, for a second."""
LATE_S = 1e-3
"""Lateness of wake-ups that gives a warning. Chosen: a sample of a 1 kHz stream."""
CONNECT_S = 2.0
"""Longest wait for a host's answer. Chosen."""
LOCKED_BYTES = 1 << 29
"""Most memory that a process with all its memory locked needs. Chosen."""


def doctor(
    config_file: Path | None,
    root: Path = Path("/"),
    say: Callable[[Fact], object] | None = None,
    robot_file: Path | None = None,
) -> bool:
    """Print a line for each fact, or give it to `say`; whether what the configuration names can work. `robot_file` is a
    file of the controller.

    Raises ConfigError for a file that cannot be read.
    """
    say = say or _say
    config = None if config_file is None else load_config(config_file, {})
    details = can_details()
    can_work = True
    if config is not None:
        in_file = [] if robot_file is None else differences(config, robot_file)
        for fact in in_file:
            can_work &= fact.level is not Level.FAIL
            say(fact)
        for fact in wires(config, root, details):
            can_work &= fact.level is not Level.FAIL
            say(fact)
    for fact in computer(root, details, RealTime() if config is None else config.realtime):
        say(fact)
    return can_work


def _say(fact: Fact) -> None:
    """Print it where it is still read: what is found counts, also behind `| head`."""
    with suppress(BrokenPipeError):
        click.echo(fact)


def computer(
    root: Path, details: Mapping[str, Mapping[str, Any]] | None, realtime: RealTime
) -> Iterator[Fact]:
    """Everything about this computer, wires first; wake-ups as a thread with these settings has them."""
    for port in facts.serial_ports(
        root
    ):  # a port may be unused: only one that the configuration names can fail
        yield replace(port, level=Level.WARN) if port.level is Level.FAIL else port
    yield from facts.can_interfaces(root, details)
    yield socketcan()
    yield facts.vcan(root, platform.release())
    yield facts.clock_source(root)
    yield facts.timer_slack(root)
    yield wake_ups(realtime)
    yield keeping_awake(realtime.keep_awake)
    yield facts.governors(root)
    yield facts.processors(sorted(os.sched_getaffinity(0)))
    yield priority()
    yield locked_memory(resource.getrlimit(resource.RLIMIT_MEMLOCK)[0], facts.may_lock_memory(root))
    yield versions()


# --- what a configuration names


def wires(config: Config, root: Path, details: Mapping[str, Mapping[str, Any]] | None) -> Iterator[Fact]:
    """Whether a run with this configuration would begin here: its URLs, and all that `run` looks at by itself."""
    for name, error in problems(Setup(config), virtual=False):
        yield fail(name, str(error))
    for key, url, is_sensor in (
        ("robot.url", config.robot.url, False),
        ("sensor.url", config.sensor.url, True),
    ):
        if not url:
            yield ok(key, "empty: emulated")
            continue
        try:
            device = sensor_in(config) if is_sensor else robot_in(config)
            parsed = device.kind.parse(device.url, device.settings)
            found = wire(parsed, root, details, getattr(device.kind, "bus", None))
        except ConfigError as error:
            found = fail(key, str(error))
            parsed = None
        yield _under(key, found)
        if parsed is not None and not is_sensor:
            yield from beside(key, robot_in(config))
        if parsed is not None and datagrams.is_datagrams(parsed):
            rules = datagrams.firewall_rules()
            for fact in datagrams.surroundings(parsed, root, rules, config.realtime):
                yield _under(key, fact)


def differences(config: Config, file: Path) -> list[Fact]:
    """Compare a file of the controller with the configuration. Raises ConfigError for the file."""
    robot = robot_in(config)
    if robot.kind.compare_file is None:
        raise ConfigError(
            f"{format_path(file)}: the kind {robot.kind.name} has no controller file to compare"
        )
    with open_ordinary(file) as opened:
        data = read_up_to(opened, TOML_LIMIT_BYTES + 1)
    try:
        if len(data) > TOML_LIMIT_BYTES:
            raise ValueError(f"longer than {TOML_LIMIT_BYTES} bytes")
        found: ProbeResult = robot.kind.compare_file(data, robot.url, robot.settings)
    except ValueError as error:
        raise ConfigError(f"{format_path(file)} is not a file of this controller: {error}") from error
    facts = [ok(file.name, f"{name}: {text}") for name, text in found.rows]
    return [*facts, *(fail(file.name, trouble.fact, trouble.remedy) for trouble in found.refusals)]


def beside(key: str, robot: Robot) -> Iterator[Fact]:
    """Facts that a robot tells over another channel of its URL, such as web services. It is only read."""
    ask = robot.kind.read_side_channel
    if ask is None:
        return

    async def main() -> ProbeResult:
        told: ProbeResult = await ask(robot.url)
        return told

    try:
        told = run_real(main)
    except (ConfigError, DeviceError) as error:
        yield fail(key, error.fact, error.remedy)
        return
    if told.rows:
        yield ok(key, ", ".join(f"{name} {text}" for name, text in told.rows))
    for trouble in told.refusals:
        yield fail(key, trouble.fact, trouble.remedy)


def _under(key: str, found: Fact) -> Fact:
    return Fact(found.level, key, f"{found.subject}: {found.text}", found.remedy)


def wire(
    url: WireUrl,
    root: Path,
    details: Mapping[str, Mapping[str, Any]] | None,
    bus: CanBus | None = None,
) -> Fact:
    """Whether what a URL names is there and may be opened. A host is connected to and left again."""
    match url.scheme:
        case "serial" | "can+slcan":
            return _port(url.target, root)
        case "can+socketcan":
            return facts.can_interface(root, url.target, details, bus)
        case "tcp" | "rfc2217" | "can+slcan+tcp":
            return _host(*url.host_port)
        case "udp" | "udp-bind":
            return datagrams.reachable(url)
        case _:
            return fail(url.text, "such a wire exists only inside one process", "name a port or an interface")


def _port(target: str, root: Path) -> Fact:
    device = Path(os.path.realpath(root / target.lstrip("/")))
    devices = Path(os.path.realpath(root / "dev"))
    if not device.is_relative_to(devices):
        there = "is not a device" if device.exists() else "no such port"
        return fail(f"serial port {target}", there, "check the cable and `ls /dev/tty*`")
    return facts.serial_port(root, str(device.relative_to(devices)))


def _host(host: str, port: int) -> Fact:
    subject = f"{host} port {port}"
    try:
        socket.create_connection((host, port), timeout=CONNECT_S).close()
    except OSError as error:
        reason = error.strerror or str(error)
        return fail(subject, reason, "check the address, the cable, and that the other side is running")
    return ok(subject, "answers")


# --- queries to the system


def can_details() -> dict[str, dict[str, Any]] | None:
    """Bit rates and states of the CAN interfaces; None without iproute2."""
    command = ("ip", "-json", "-details", "link", "show")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5.0, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return facts.link_details(done.stdout)


def socketcan() -> Fact:
    """Whether the kernel speaks CAN at all."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return warn(
            "SocketCAN", error.strerror or str(error), "`sudo modprobe can_raw`; slcan adapters need none"
        )
    return ok("SocketCAN", "available")


def wake_ups(realtime: RealTime) -> Fact:
    """How late this process wakes, measured as it would be run; as any other where the machine refuses that."""
    try:
        with real_time_thread(realtime):
            return judge_lateness(run_real(_lateness, realtime.busy_poll_ms * 1e-3), realtime)
    except ConfigError:
        return judge_lateness(run_real(_lateness), RealTime())


def judge_lateness(late: Sequence[float], realtime: RealTime) -> Fact:
    """Judge the machine by these latenesses of a thread run so, s, ascending, and give the remedy."""
    mean, p99 = sum(late) / len(late), late[int(0.99 * len(late))]
    awake = ", processors kept awake" * realtime.keep_awake + ", busy polling" * bool(realtime.busy_poll_ms)
    text = (
        f"{mean * 1e6:.0f} µs late on average, 99 % within {p99 * 1e6:.0f} µs, at most {late[-1] * 1e6:.0f} µs "
        f"({len(late)} at {1 / PERIOD_S:.0f} Hz{awake})"
    )
    if p99 <= LATE_S:
        return ok("wake-ups", text)
    if awake:
        return warn(
            "wake-ups", text, "the machine, or the host of a virtual one, is busy: end other programs"
        )
    return warn(
        "wake-ups",
        text,
        "the machine is busy, or its processors sleep deeply: end other programs, then set `realtime.fifo_priority` "
        "and `realtime.cpus`; `realtime.keep_awake` helps on a computer that is no virtual machine",
    )


async def _lateness() -> list[float]:
    """Lateness of each of many periodic wake-ups, s, ascending."""
    clock = Clock.running()
    try:
        begun = clock.now()
        late = []
        for number in range(1, CYCLES + 1):
            due = begun + number * PERIOD_S
            await clock.sleep_until(due)
            late.append(max(0.0, clock.now() - due))
        return sorted(late)
    finally:
        clock.close()


def keeping_awake(wanted: bool) -> Fact:
    """Whether we may keep the processors from sleeping."""
    try:
        with real_time_thread(RealTime(keep_awake=True)):
            asks = "asks" if wanted else "would ask"
            return ok("processors' sleep", f"may be prevented; `realtime.keep_awake` {asks} for it")
    except SettingRefused as error:
        what = "may not be prevented; needed only where wake-ups are late"
        return warn("processors' sleep", what, error.problem)


def priority() -> Fact:
    """Whether we may take real-time priority."""
    try:
        with real_time_thread(RealTime(fifo_priority=1)):
            return ok("real-time priority", "permitted; `realtime.fifo_priority` asks for it")
    except ConfigError:
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        return warn(
            "real-time priority",
            f"not permitted (rtprio limit {limit}); needed only for a 1 kHz sensor on a busy machine",
            "put `@dialout - rtprio 80` into /etc/security/limits.d/hil-bridge.conf and log in again",
        )


def locked_memory(limit: int, capable: bool) -> Fact:
    """Whether we may keep our memory from being swapped out, with such a limit unless we are above it."""
    if capable or limit == resource.RLIM_INFINITY or limit >= LOCKED_BYTES:
        return ok("locked memory", "permitted; `realtime.lock_memory` asks for it")
    return warn(
        "locked memory",
        f"limited to {limit >> 20} MiB; needed only for `realtime.lock_memory`",
        "put `@dialout - memlock unlimited` into /etc/security/limits.d/hil-bridge.conf and log in again",
    )


def versions() -> Fact:
    """Python's and the packages' versions, for a report of trouble."""
    found = [f"Python {platform.python_version()}", f"Linux {platform.release()}"]
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            return fail(
                "versions", f"{package} is not installed", "install hil-bridge into an environment of its own"
            )
    return ok("versions", ", ".join(found))
