"""Checks whether this computer is fit for a run, with remedies, for `hil-bridge doctor`."""

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
"""Period of the measured wake-ups, s, and their number: the rate of the fastest sensor stream, for one second."""
LATE_S = 1e-3
"""Lateness of wake-ups above which a warning is given, s. Chosen: one sample of a 1 kHz stream."""
CONNECT_S = 2.0
"""Time-out for connecting to a host, s. Chosen."""
LOCKED_BYTES = 1 << 29
"""Largest amount of memory that a process with all its memory locked needs, bytes. Chosen."""


def doctor(
    config_file: Path | None,
    root: Path = Path("/"),
    say: Callable[[Fact], object] | None = None,
    robot_file: Path | None = None,
) -> bool:
    """Print each fact as a line, or pass it to `say`. Return whether everything in the configuration can work.

    `robot_file` is a file of the controller. Raises ConfigError if a file cannot be read.
    """
    say = say or _print_line
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


def _print_line(fact: Fact) -> None:
    """Print a line while the output is still read. With a closed pipe (`| head`), the result of the checks still
    counts.
    """
    with suppress(BrokenPipeError):
        click.echo(fact)


def computer(
    root: Path, details: Mapping[str, Mapping[str, Any]] | None, realtime: RealTime
) -> Iterator[Fact]:
    """Check this computer, wires first. `realtime` contains the thread settings for the measured wake-ups."""
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
    yield check_realtime_priority()
    yield locked_memory(resource.getrlimit(resource.RLIMIT_MEMLOCK)[0], facts.may_lock_memory(root))
    yield versions()


# --- what a configuration names


def wires(config: Config, root: Path, details: Mapping[str, Mapping[str, Any]] | None) -> Iterator[Fact]:
    """Check whether a run with this configuration could start on this computer: its URLs, and everything that `run`
    itself checks.
    """
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
            opened = device.wires()
        except ConfigError:  # already reported
            continue
        for one in opened:
            yield _under(key, wire(one, root, details, getattr(device.kind, "bus", None)))
        if not is_sensor:
            yield from check_side_channel(key, robot_in(config))
        for one in filter(datagrams.is_datagrams, opened):
            rules = datagrams.firewall_rules()
            for fact in datagrams.surroundings(one, root, rules, config.realtime):
                yield _under(key, fact)


def differences(config: Config, file: Path) -> list[Fact]:
    """Compare a file of the controller with the configuration. Raises ConfigError if the file is invalid."""
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
        result: ProbeResult = robot.kind.compare_file(data, robot.url, robot.settings)
    except ValueError as error:
        raise ConfigError(f"{format_path(file)} is not a file of this controller: {error}") from error
    facts = [ok(file.name, f"{name}: {text}") for name, text in result.rows]
    return [*facts, *(fail(file.name, trouble.fact, trouble.remedy) for trouble in result.refusals)]


def check_side_channel(key: str, robot: Robot) -> Iterator[Fact]:
    """Return the facts that a robot reports over another channel of its URL, such as web services. The channel is
    only read.
    """
    ask = robot.kind.read_side_channel
    if ask is None:
        return

    async def main() -> ProbeResult:
        result: ProbeResult = await ask(robot.url)
        return result

    try:
        outcome = run_real(main)
    except (ConfigError, DeviceError) as error:
        yield fail(key, error.fact, error.remedy)
        return
    if outcome.rows:
        yield ok(key, ", ".join(f"{name} {text}" for name, text in outcome.rows))
    for trouble in outcome.refusals:
        yield fail(key, trouble.fact, trouble.remedy)


def _under(key: str, fact: Fact) -> Fact:
    return Fact(fact.level, key, f"{fact.subject}: {fact.text}", fact.remedy)


def wire(
    url: WireUrl,
    root: Path,
    details: Mapping[str, Mapping[str, Any]] | None,
    bus: CanBus | None = None,
) -> Fact:
    """Check that the target of a URL exists and may be opened. A host is connected to and then disconnected."""
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
    """Return bit rates and states of the CAN interfaces, or None if iproute2 is not installed."""
    command = ("ip", "-json", "-details", "link", "show")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5.0, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return facts.link_details(done.stdout)


def socketcan() -> Fact:
    """Check that the kernel supports CAN."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return warn(
            "SocketCAN", error.strerror or str(error), "`sudo modprobe can_raw`; slcan adapters need none"
        )
    return ok("SocketCAN", "available")


def wake_ups(realtime: RealTime) -> Fact:
    """Measure the lateness of this process's wake-ups, with the thread settings of a run. If the machine refuses
    these settings, measure with the defaults.
    """
    try:
        with real_time_thread(realtime):
            return judge_lateness(run_real(_lateness, realtime.busy_poll_ms * 1e-3), realtime)
    except ConfigError:
        return judge_lateness(run_real(_lateness), RealTime())


def judge_lateness(late: Sequence[float], realtime: RealTime) -> Fact:
    """Judge the machine by the lateness of its wake-ups, s, in ascending order, and give the remedy. `realtime`
    contains the settings of the thread.
    """
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
        "and `realtime.cpus`; `realtime.keep_awake` helps on a physical computer",
    )


async def _lateness() -> list[float]:
    """Return the lateness of many periodic wake-ups, s, in ascending order."""
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


def keeping_awake(is_configured: bool) -> Fact:
    """Check whether this process may keep the processors from sleeping."""
    try:
        with real_time_thread(RealTime(keep_awake=True)):
            asks = "asks" if is_configured else "would ask"
            return ok("processors' sleep", f"may be prevented; `realtime.keep_awake` {asks} for it")
    except SettingRefused as error:
        what = "may not be prevented; needed only where wake-ups are late"
        return warn("processors' sleep", what, error.problem)


def check_realtime_priority() -> Fact:
    """Check whether this process may use real-time priority."""
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
    """Check whether this process may lock its memory. `limit` is the limit in bytes; `capable` says that the
    process is privileged and has no limit.
    """
    if capable or limit == resource.RLIM_INFINITY or limit >= LOCKED_BYTES:
        return ok("locked memory", "permitted; `realtime.lock_memory` asks for it")
    return warn(
        "locked memory",
        f"limited to {limit >> 20} MiB; needed only for `realtime.lock_memory`",
        "put `@dialout - memlock unlimited` into /etc/security/limits.d/hil-bridge.conf and log in again",
    )


def versions() -> Fact:
    """Return the versions of Python and of the packages, for a problem report."""
    lines = [f"Python {platform.python_version()}", f"Linux {platform.release()}"]
    for package in PACKAGES:
        try:
            lines.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            return fail(
                "versions", f"{package} is not installed", "install hil-bridge in a separate environment"
            )
    return ok("versions", ", ".join(lines))
