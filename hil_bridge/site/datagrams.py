"""Checks of `hil-bridge doctor` for a UDP link: its port, its receive buffer, and the firewall."""

import errno
import ipaddress
import re
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from hil_bridge.clock.realtime import RealTime
from hil_bridge.site.facts import Fact, fail, ok, warn
from hil_bridge.transports.datagram.udp import RECEIVE_BUFFER_BYTES
from hil_bridge.transports.urls import WireUrl

DATAGRAM_BYTES = 768
"""Minimum number of bytes that the kernel counts for one datagram. Source: see RECEIVE_BUFFER_BYTES."""
FASTEST_HZ = 7000.0
"""Rate of the fastest sensor stream, Hz. Source: see RECEIVE_BUFFER_BYTES."""
LIST_COMMANDS = (("nft", "list", "ruleset"), ("iptables-save",))
"""Commands that list the firewall rules."""

_HOOKED = re.compile(r"type filter hook input [^;]*;(?:\s*policy (?P<policy>\w+);)?")
_REFUSING = re.compile(r"\b(?:drop|reject)\b")


class Rules(NamedTuple):
    """Firewall rules, as far as this user can read them."""

    text: str = ""
    """Text of all rules; empty if they cannot be read."""
    unreadable: str = ""
    """Reason why the rules cannot be read; empty if they can."""


def is_datagrams(url: WireUrl) -> bool:
    """Return whether a wire is UDP."""
    return url.scheme in ("udp", "udp-bind")


def reachable(url: WireUrl) -> Fact:
    """Check that the port of a listening wire is free, or that there is a route to the host of a connecting wire.
    Nothing is sent.
    """
    host, port = url.host_port
    listens = url.scheme == "udp-bind"
    subject = f"UDP {host} port {port}"
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            (probe.bind if listens else probe.connect)(address)
            here = probe.getsockname()[0]
    except OSError as error:
        return fail(subject, error.strerror or str(error), _remedy(error, port))
    if listens:
        return ok(subject, "free; a run shows whether the device sends")
    return ok(subject, f"is routed from {here}; UDP has no connection: a run shows whether it answers")


def _remedy(error: OSError, port: int) -> str:
    match error.errno:
        case errno.EADDRINUSE:
            return f"another program listens there: `ss -ulpn 'sport = :{port}'` names it; end it"
        case errno.EADDRNOTAVAIL:
            return (
                "no interface of this computer has that address: `ip address` lists them; 0.0.0.0 means all"
            )
        case errno.EACCES | errno.EPERM:
            return "ports below 1024 need administrator rights; use another"
        case _:
            return "check the address, the cable, and `ip route`"


def surroundings(url: WireUrl, root: Path, rules: Rules, realtime: RealTime) -> Iterator[Fact]:
    """Check the environment of a UDP wire: kernel buffers, firewall, and the settings in [realtime]."""
    yield room(root)
    if url.scheme == "udp-bind":
        yield firewall(*url.host_port, rules)
    yield in_real_time(realtime)


def room(root: Path) -> Fact:
    """Check that the kernel grants a socket the requested buffer size."""
    limits = [_number(root / "proc/sys/net/core" / name) for name in ("rmem_max", "rmem_default")]
    if limits[0] is None:
        return warn("receive buffer", "net.core.rmem_max cannot be read", "`sysctl net.core.rmem_max`")
    granted = 2 * min(limits[0], RECEIVE_BUFFER_BYTES)  # the kernel doubles it for its own needs
    count = granted // DATAGRAM_BYTES
    usual = "" if limits[1] is None else f", rmem_default {limits[1]}"
    text = (
        f"requests {RECEIVE_BUFFER_BYTES} bytes; net.core.rmem_max {limits[0]}{usual}: "
        f"room for {count} small datagrams, {count / FASTEST_HZ:.2f} s at {FASTEST_HZ:.0f} Hz"
    )
    if limits[0] >= RECEIVE_BUFFER_BYTES:
        return ok("receive buffer", text)
    return warn(
        "receive buffer",
        text,
        f"`sudo sysctl -w net.core.rmem_max={RECEIVE_BUFFER_BYTES}`, and the same line in /etc/sysctl.d to keep it",
    )


def _number(path: Path) -> int | None:
    try:
        return int(path.read_text(encoding="ascii", errors="replace"))
    except (OSError, ValueError):
        return None


def in_real_time(realtime: RealTime) -> Fact:
    """Return a fact about the effect of [realtime] on UDP. The loop's own thread reads the socket, as it reads
    every wire.
    """
    enabled = [
        text
        for text, is_enabled in (
            (f"busy polling of {realtime.busy_poll_ms:g} ms", realtime.busy_poll_ms),
            (f"SCHED_FIFO {realtime.fifo_priority}", realtime.fifo_priority),
        )
        if is_enabled
    ]
    if enabled:
        return ok("datagrams in real time", f"{', '.join(enabled)} of [realtime]: as for every other wire")
    return ok("datagrams in real time", "[realtime] is at its defaults, which apply as to every other wire")


# --- firewall


def firewall_rules() -> Rules:
    """Read the rules of nftables, or otherwise of iptables, as far as this user may read them."""
    reasons = []
    for command in LIST_COMMANDS:
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=5.0, check=False)
        except OSError as error:
            reasons.append(f"{command[0]}: {error.strerror or error}")
            continue
        except subprocess.TimeoutExpired:
            reasons.append(f"{command[0]}: no answer")
            continue
        if done.returncode == 0:
            return Rules(done.stdout)
        reasons.append(f"{command[0]}: {(done.stderr.strip().splitlines() or ['refused'])[0]}")
    return Rules(unreadable="; ".join(reasons))


def firewall(host: str, port: int, rules: Rules) -> Fact:
    """Check whether the firewall may drop incoming packets to a port, as far as the rules can be read."""
    subject = f"firewall, UDP port {port}"
    if _is_loopback(host):
        return ok(subject, "loopback: firewalls seldom filter it")
    if rules.unreadable:
        return warn(
            subject,
            f"its rules cannot be read ({rules.unreadable})",
            "`sudo nft list ruleset` or `sudo iptables-save` shows whether it drops what comes to this port",
        )
    if not _may_refuse(rules.text):
        return ok(subject, "no rule drops incoming packets")
    if _accepts_port(rules.text, port):
        return ok(subject, "a rule accepts this port")
    return warn(
        subject,
        "rules drop some incoming packets, and none accepts this port by number",
        f"if nothing arrives, allow it: `sudo ufw allow {port}/udp`, or a rule `udp dport {port} accept`",
    )


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _may_refuse(text: str) -> bool:
    """Return whether an input filter drops or rejects packets, by its policy or by a rule in its chains."""
    if re.search(r"^:INPUT (?!ACCEPT)", text, re.MULTILINE):
        return True
    if re.search(r"^-A .*-j (?:DROP|REJECT)\b", text, re.MULTILINE) and ":INPUT" in text:
        return True
    hooked = list(_HOOKED.finditer(text))
    if any(chain["policy"] in ("drop", "reject") for chain in hooked):
        return True
    rest = _HOOKED.sub("", text)
    return bool(hooked) and bool(_REFUSING.search(re.sub(r"policy \w+;", "", rest)))


def _accepts_port(text: str, port: int) -> bool:
    """Return whether an accepting rule contains this port: alone, in a set, or in a range."""
    for line in text.splitlines():
        match = re.search(r"udp .*?dports? (?P<ports>\{[^}]*\}|[\d:,-]+)", line)
        if match is None or not re.search(r"\b(?:accept|ACCEPT)\b", line):
            continue
        for low, high in re.findall(r"(\d+)(?:[-:](\d+))?", match["ports"]):
            if int(low) <= port <= int(high or low):
                return True
    return False
