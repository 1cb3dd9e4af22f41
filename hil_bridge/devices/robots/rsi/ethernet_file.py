"""Comparison of a controller's Ethernet configuration with the settings of a run, including HOLDON.

HOLDON is not visible on the wire, because it takes effect only in a cycle whose answer is lost.
"""

from collections.abc import Iterator
from ipaddress import ip_address
from typing import Any

from hil_bridge.devices.kinds import KindSettings
from hil_bridge.devices.robots.probe import ProbeResult
from hil_bridge.transports.urls import LISTEN_DATAGRAMS, parse_url
from protocol.devices.rsi import EthernetFile, RsiLink, axis_tags, pose_tags, read_ethernet_file
from protocol.endpoint import Trouble


def compare_file(data: bytes, url: str, settings: KindSettings[RsiLink, Any]) -> ProbeResult:
    """Return the content of the file and each difference from the settings. Raises ValueError if it is not an
    Ethernet configuration.
    """
    file, link = read_ethernet_file(data), settings.client
    required = pose_tags(link.correction_tag) if link.correction == "pose" else axis_tags(link.axis_tag)
    rows = [
        ("sends", " ".join(file.sends)),
        ("takes", ", ".join(f"{tag} (HOLDON {int(one.holds)})" for tag, one in file.receives.items())),
    ]
    if not any(tag.partition(".")[0] == "Delay" for tag in file.sends):
        rows.append(
            ("DEF_Delay", "not in SEND: an answer that the controller has not accepted is not detected")
        )
    if unsent := [tag for tag in file.receives if tag not in required]:
        rows.append(("not sent by a run", " ".join(unsent)))
    troubles = (*_wire(file, url), *_telegrams(file, link), *_corrections(file, link, required))
    return ProbeResult(tuple(row for row in rows if row[1]), troubles)


def _wire(file: EthernetFile, url: str) -> Iterator[Trouble]:
    """Compare address and port if the URL contains them."""
    wire = parse_url(url, LISTEN_DATAGRAMS) if url else None
    if wire is None or wire.scheme != "udp-bind":
        return
    host, port = wire.host_port
    if file.port != str(port):
        yield Trouble(f"PORT is {file.port or 'missing'}, and robot.url listens on {port}", "make them equal")
    if file.host != host and _is_one_address(host):
        yield Trouble(
            f"IP_NUMBER is {file.host or 'missing'}, and robot.url listens on {host}", "make them equal"
        )


def _is_one_address(host: str) -> bool:
    """Return whether `host` is the address of a single interface: neither a host name nor the unspecified address."""
    try:
        return not ip_address(host).is_unspecified
    except ValueError:
        return False


def _telegrams(file: EthernetFile, link: RsiLink) -> Iterator[Trouble]:
    if file.sentype != link.sentype:
        yield Trouble(
            f"SENTYPE is {file.sentype or 'missing'}, and robot.rsi.sentype is {link.sentype}: each answer would be "
            "discarded",
            "make them equal",
        )
    if file.sends_alone:
        yield Trouble("ONLYSEND is TRUE: the controller accepts no answers", "set it to FALSE")
    needed = ("RIst", "RSol", "AIPos", "ASPos") if link.correction == "axes" else ("RIst",)
    for tag in needed:
        if tag not in file.sends:
            yield Trouble(
                f"DEF_{tag} is not in SEND", f"add it: robot.rsi.correction = {link.correction} reads it"
            )


def _corrections(file: EthernetFile, link: RsiLink, required: tuple[str, ...]) -> Iterator[Trouble]:
    if missing := [tag for tag in required if tag not in file.receives]:
        element = "correction_tag" if link.correction == "pose" else "axis_tag"
        yield Trouble(
            f"RECEIVE has no {' '.join(missing)}, which a run sends", f"add them, or set robot.rsi.{element}"
        )
    keeps = link.mode == "absolute"
    effect = (
        "one lost answer would send the robot back to its start"
        if keeps
        else "the last increment would be repeated in each lost cycle"
    )
    if wrong := [tag for tag in required if tag in file.receives and file.receives[tag].holds != keeps]:
        yield Trouble(
            f"HOLDON is {int(not keeps)} for {' '.join(wrong)}, and robot.rsi.mode is {link.mode}: {effect}",
            f"set it to {int(keeps)}, or correct mode",
        )
    channels: dict[str, str] = {}
    for tag in required:
        if tag in file.receives and (other := channels.setdefault(file.receives[tag].channel, tag)) != tag:
            yield Trouble(f"{other} and {tag} have the same INDX", "give each its own INDX")
