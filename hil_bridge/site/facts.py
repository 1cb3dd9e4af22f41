"""Facts about a computer from /sys, /proc and /dev, judged by the requirements of a bridge.

Everything is read below a root folder, so that tests can provide a file tree. Sources: kernel documentation,
Documentation/ABI/testing/sysfs-class-net, sysfs-bus-usb, sysfs-class-tty, sysfs-devices-system-cpu;
drivers/usb/serial/ftdi_sio.c for the latency timer.
"""

import grp
import json
import os
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from hil_bridge.devices.kinds import CanBus

_ARPHRD_CAN = 280
"""Type of a CAN interface. Source: Linux, if_arp.h."""
_IFF_UP = 1
_SLOW_LATENCY_MS = 1
"""Smallest latency timer that is reported as slow, ms, because it adds to the time of every answer. Standard: the
minimum of an FTDI adapter.
"""
_CAP_IPC_LOCK = 14
"""Capability to lock memory. Source: Linux, linux/capability.h."""
_BAD_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies", "pit")
"""Clock sources that are slow to read or have a coarse resolution."""


_INTERMEDIATE_DRIVERS = ("port", "ctrl")
"""Drivers that Linux since 6.5 inserts between a serial port and the driver of the port."""


class Level(StrEnum):
    """Severity of a fact."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class Fact:
    """Fact about the computer, which is one line of the doctor's output."""

    level: Level
    subject: str
    text: str
    remedy: str = ""
    """Remedy for a problem; empty if there is no problem."""

    def __str__(self) -> str:
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.level:<5} {self.subject}: {self.text}{remedy}"


def ok(subject: str, text: str) -> Fact:
    """Return a fact without a problem."""
    return Fact(Level.OK, subject, text)


def warn(subject: str, text: str, remedy: str = "") -> Fact:
    """Return a fact that may cause faults."""
    return Fact(Level.WARN, subject, text, remedy)


def fail(subject: str, text: str, remedy: str = "") -> Fact:
    """Return a fact that prevents the requested operation."""
    return Fact(Level.FAIL, subject, text, remedy)


# --- serial ports


def serial_names(root: Path) -> list[str]:
    """Return the names of the serial ports that have hardware."""
    return [
        tty.name
        for tty in sorted((root / "sys/class/tty").glob("*"))
        if (tty / "device/driver").exists() and _read(tty / "type") != "0"  # 0: the driver found no UART
    ]


def serial_ports(root: Path) -> Iterator[Fact]:
    """Check each serial port: type, permission, use by another program, latency timer."""
    names = serial_names(root)
    if not names:
        yield warn(
            "serial ports",
            "none found",
            "plug the adapter in; `dmesg | tail` shows whether the kernel detected it",
        )
    for name in names:
        yield serial_port(root, name)
        yield from latency_timer(root, name)


def serial_port(root: Path, name: str) -> Fact:
    """Check one serial port, identified by its name below /dev."""
    subject, node = f"serial port /dev/{name}", root / "dev" / name
    try:
        information = node.stat()
    except OSError:
        return fail(subject, "no such port", "check the cable and `ls /dev/tty*`")
    what = _adapter(root, name)
    if not os.access(node, os.R_OK | os.W_OK):
        return fail(
            subject,
            f"{what}, no permission",
            f"`sudo usermod -aG {_group(information)} $USER`, then log in again",
        )
    holders = list(_holders(root, f"/dev/{name}"))
    if holders:
        return warn(subject, f"{what}, in use by {', '.join(holders)}", "end that program before a run")
    return ok(subject, what)


def latency_timer(root: Path, name: str) -> Iterator[Fact]:
    """Check the time for which a USB adapter delays characters, if it has such a timer."""
    path = f"/sys/bus/usb-serial/devices/{name}/latency_timer"
    text = _read(root / path.lstrip("/"))
    if not text.isdigit():
        return
    subject = f"latency timer of /dev/{name}"
    if int(text) <= _SLOW_LATENCY_MS:
        yield ok(subject, f"{text} ms")
        return
    yield warn(
        subject,
        f"{text} ms are added to every answer until the port is opened with low latency, which a run does",
        f"for other programs `setserial /dev/{name} low_latency` or `echo 1 | sudo tee {path}`",
    )


def _adapter(root: Path, name: str) -> str:
    """Return the driver of a port, and for a USB adapter also its product name and ids."""
    device = (root / "sys/class/tty" / name / "device").resolve()
    folders = (device, *device.parents[:4])
    drivers = ((folder / "driver").resolve().name for folder in folders if (folder / "driver").exists())
    driver = next((driver for driver in drivers if driver not in _INTERMEDIATE_DRIVERS), "unknown driver")
    for folder in folders:
        vendor, product = _read(folder / "idVendor"), _read(folder / "idProduct")
        if vendor and product:
            called = " ".join(filter(None, (_read(folder / "manufacturer"), _read(folder / "product"))))
            return f"{called or 'USB adapter'} ({vendor}:{product}, {driver})"
    return driver


def _group(information: os.stat_result) -> str:
    """Return the group that may open the port in addition to its owner."""
    if information.st_mode & stat.S_IRWXG:
        try:
            return grp.getgrgid(information.st_gid).gr_name
        except KeyError:
            return str(information.st_gid)
    return "dialout"


def _holders(root: Path, device: str) -> Iterator[str]:
    """Return the programs that have a device open, as far as this user can see them."""
    for process in (root / "proc").glob("[0-9]*"):
        try:
            open_files = [os.readlink(link) for link in (process / "fd").iterdir()]
        except OSError:
            continue  # the process belongs to another user or has ended
        if device in open_files:
            yield f"{_read(process / 'comm') or 'process'} ({process.name})"


# --- CAN


def can_names(root: Path) -> list[str]:
    """Return the names of the CAN interfaces."""
    return [
        interface.name
        for interface in sorted((root / "sys/class/net").glob("*"))
        if _read(interface / "type") == str(_ARPHRD_CAN)
    ]


def can_interfaces(root: Path, details: Mapping[str, Mapping[str, Any]] | None) -> Iterator[Fact]:
    """Check each CAN interface: state, bit rate, behaviour after bus-off.

    `details` is the result of `link_details`, or None if iproute2 is not installed.
    """
    names = can_names(root)
    for name in names:
        yield can_interface(root, name, details)
    if not names:
        yield ok("CAN interfaces", "none")
    if details is None and names:
        yield warn("iproute2", "is not installed, so bit rates are unknown", "install the package iproute2")


def can_interface(
    root: Path,
    name: str,
    details: Mapping[str, Mapping[str, Any]] | None,
    bus: CanBus | None = None,
) -> Fact:
    """Check one CAN interface, identified by its name. Its bit rate is compared with the bit rate of the device on
    this bus.
    """
    subject, folder = f"CAN interface {name}", root / "sys/class/net" / name
    if _read(folder / "type") != str(_ARPHRD_CAN):
        there = ", ".join(can_names(root)) or "none"
        return fail(subject, f"no such CAN interface (known: {there})", "`ip link` lists all")
    flags = _read(folder / "flags")
    up = flags.startswith("0x") and bool(int(flags, 16) & _IFF_UP)
    link = (details or {}).get(name, {})
    kind = str(link.get("kind", ""))
    bring_up = (
        f"`sudo ip link set {name} up type can bitrate {bus.bitrate if bus else 'RATE'} restart-ms 100`"
    )
    if not up:
        remedy = f"`sudo ip link set {name} up`" if kind == "vcan" else bring_up
        return fail(subject, "is down", remedy)
    if kind == "vcan":
        return ok(subject, "is up, virtual")
    bitrate, state, restart_ms = link.get("bitrate"), str(link.get("state", "")), link.get("restart_ms", 0)
    errors = tuple(link.get("errors", (0, 0)))
    counters = "error counters sent {}, received {}".format(*errors) if any(errors) else ""
    parts = ("is up", f"{bitrate} bit/s" if bitrate else "", state.lower(), counters)
    text = ", ".join(filter(None, parts))
    if bus is not None and bitrate is not None and bitrate != bus.bitrate:
        return fail(
            subject,
            f"{text}; {bus.device} uses {bus.bitrate}",
            f"`sudo ip link set {name} down`, then {bring_up}",
        )
    if state == "BUS-OFF":
        return fail(
            subject, text, f"check cable and termination, then `sudo ip link set {name} type can restart`"
        )
    if state and state != "ERROR-ACTIVE":
        return warn(subject, text, "frames are damaged on this bus: check termination, cable and bit rate")
    if link and not restart_ms:
        return warn(
            subject, f"{text}, stays off after bus-off", f"`sudo ip link set {name} type can restart-ms 100`"
        )
    return ok(subject, text)


def link_details(text: str) -> dict[str, dict[str, Any]]:
    """Return kind, bit rate, state and restart time of each interface from `ip -json -details link show`.

    Entries with an unknown format are omitted.
    """
    try:
        links = json.loads(text)
    except ValueError:
        return {}
    interfaces: dict[str, dict[str, Any]] = {}
    for link in links if isinstance(links, list) else ():
        if not isinstance(link, dict) or not isinstance(link.get("linkinfo"), dict):
            continue
        info = link["linkinfo"]
        data = _table(info, "info_data")
        timing = _table(data, "bittiming")
        interfaces[str(link.get("ifname"))] = {
            "kind": info.get("info_kind", ""),
            "bitrate": timing.get("bitrate"),
            "state": data.get("state", ""),
            "restart_ms": data.get("restart_ms", 0),
            "errors": tuple(_table(data, "berr_counter").get(side, 0) for side in ("tx", "rx")),
        }
    return interfaces


def _table(values: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return a table inside another table, or an empty table."""
    table = values.get(key)
    return table if isinstance(table, dict) else {}


def vcan(root: Path, release: str) -> Fact:
    """Check whether virtual CAN interfaces can be created, for tests without hardware."""
    modules = root / "lib/modules" / release
    lists = (_read(modules / name) for name in ("modules.dep", "modules.builtin"))
    if (root / "sys/module/vcan").exists() or any("/vcan.ko" in text for text in lists):
        return ok("virtual CAN", "available")
    return warn(
        "virtual CAN",
        "this kernel has no module vcan",
        "needed only for tests; install the kernel's extra modules",
    )


# --- clock and scheduler


def clock_source(root: Path) -> Fact:
    """Check the clock source of the kernel."""
    name = _read(root / "sys/devices/system/clocksource/clocksource0/current_clocksource") or "unknown"
    if name in _BAD_CLOCKS:
        return warn(
            "clock source",
            f"{name} is slow to read",
            "see `dmesg | grep -i clocksource` for why tsc is not used",
        )
    return ok("clock source", name)


def timer_slack(root: Path) -> Fact:
    """Return the time by which the kernel may delay ordinary waits. Waits on a timerfd, which the bridge uses, are
    exempt.
    """
    text = _read(root / "proc/self/timerslack_ns")
    return ok("timer slack", f"{int(text) / 1e3:g} µs" if text.isdigit() else "not reported by this kernel")


def may_lock_memory(root: Path) -> bool:
    """Return whether this process may lock memory without limit, as root may."""
    match = re.search(r"^CapEff:\s*([0-9a-f]+)$", _read(root / "proc/self/status"), re.MULTILINE)
    return match is not None and bool(int(match[1], 16) >> _CAP_IPC_LOCK & 1)


def governors(root: Path) -> Fact:
    """Check the frequency governors of the processors."""
    folders = sorted((root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq"))
    names = sorted({_read(folder / "scaling_governor") for folder in folders} - {""})
    if not names:
        return ok("frequency governor", "none: the frequency is fixed, or the host of this machine sets it")
    if names == ["powersave"] and _read(folders[0] / "scaling_driver") not in (
        "intel_pstate",
        "amd-pstate-epp",
    ):
        return warn(
            "frequency governor",
            "powersave: every wake-up is slow",
            "`sudo cpupower frequency-set -g performance`",
        )
    return ok("frequency governor", ", ".join(names))


def processors(usable: Sequence[int]) -> Fact:
    """Check the number of available processors."""
    if len(usable) < 2:
        return warn(
            "processors", "one: recorder, view and control share it", "do not run anything else during a run"
        )
    return ok("processors", str(len(usable)))


def _read(path: Path) -> str:
    """Read a small file. Return "" if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
