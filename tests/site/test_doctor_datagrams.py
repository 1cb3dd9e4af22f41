"""Doctor on UDP wires: port, kernel buffer, and firewall rules given as texts."""

import socket
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from hil_bridge.clock.realtime import RealTime
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.devices import sensor_in
from hil_bridge.site import datagrams, doctor
from hil_bridge.site.datagrams import Rules, firewall, firewall_rules, in_real_time, reachable, room
from hil_bridge.site.facts import Level
from hil_bridge.transports.urls import CONNECT_DATAGRAMS, LISTEN_DATAGRAMS, parse_url

NFT = """table inet filter {{
	chain input {{
		type filter hook input priority filter; policy {policy};
		{rule}
	}}
	chain forward {{
		type filter hook forward priority filter; policy drop;
	}}
}}
"""
IPTABLES = """*filter
:INPUT {policy} [0:0]
:FORWARD DROP [0:0]
{rule}
COMMIT
"""


def test_doctor_reports_udp_port_in_use() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as accepted:
        accepted.bind(("127.0.0.1", 0))
        port = accepted.getsockname()[1]
        url = parse_url(f"udp-bind://127.0.0.1:{port}", LISTEN_DATAGRAMS)
        fact = reachable(url)
        assert fact.level is Level.FAIL
        assert f"sport = :{port}" in fact.remedy
    assert reachable(url).level is Level.OK


def test_doctor_refuses_listening_on_nonlocal_address() -> None:
    fact = reachable(parse_url("udp-bind://192.0.2.1:6510", LISTEN_DATAGRAMS))
    assert fact.level is Level.FAIL
    assert "`ip address`" in fact.remedy


def test_doctor_reports_route_to_host() -> None:
    fact = reachable(parse_url("udp://127.0.0.1:49152", CONNECT_DATAGRAMS))
    assert (fact.level, "is routed from 127.0.0.1" in fact.text) == (Level.OK, True)


@pytest.mark.parametrize(
    ("limit", "level", "message"),
    [
        ("212992\n", Level.WARN, "room for 554 small"),
        ("1048576", Level.OK, "room for 2730 small"),
        ("x", Level.WARN, "cannot"),
    ],
)
def test_doctor_compares_receive_buffer_with_request(
    tmp_path: Path, limit: str, level: Level, message: str
) -> None:
    folder = tmp_path / "proc/sys/net/core"
    folder.mkdir(parents=True)
    (folder / "rmem_max").write_text(limit)
    fact = room(tmp_path)
    assert fact.level is level
    assert message in fact.text
    (folder / "rmem_default").write_text("212992\n")
    assert level is not Level.OK or "rmem_default 212992" in room(tmp_path).text


@pytest.mark.parametrize(
    ("text", "level"),
    [
        ("", Level.OK),
        (NFT.format(policy="accept", rule=""), Level.OK),
        (NFT.format(policy="drop", rule=""), Level.WARN),
        (NFT.format(policy="accept", rule="ip saddr 10.0.0.0/8 drop"), Level.WARN),
        (NFT.format(policy="drop", rule="udp dport 6510 accept"), Level.OK),
        (NFT.format(policy="drop", rule="udp dport { 53, 6500-6520 } accept"), Level.OK),
        (NFT.format(policy="drop", rule="udp dport 6511 accept"), Level.WARN),
        (NFT.format(policy="drop", rule="udp dport 6510 drop"), Level.WARN),
        (NFT.format(policy="drop", rule="tcp dport 6510 accept"), Level.WARN),
        (IPTABLES.format(policy="ACCEPT", rule=""), Level.OK),
        (IPTABLES.format(policy="DROP", rule=""), Level.WARN),
        (IPTABLES.format(policy="DROP", rule="-A INPUT -p udp -m udp --dport 6510 -j ACCEPT"), Level.OK),
        (IPTABLES.format(policy="ACCEPT", rule="-A INPUT -j REJECT --reject-with icmp"), Level.WARN),
    ],
)
def test_doctor_warns_of_dropping_firewall(text: str, level: Level) -> None:
    assert firewall("0.0.0.0", 6510, Rules(text)).level is level
    assert firewall("127.0.0.1", 6510, Rules(text)).level is Level.OK


def test_doctor_reports_unreadable_firewall_rules(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(command: Sequence[str], **options: object) -> "subprocess.CompletedProcess[str]":
        if command[0] == "nft":
            return subprocess.CompletedProcess(command, 1, "", "Operation not permitted (you must be root)\n")
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr(subprocess, "run", refuse)
    rules = firewall_rules()
    fact = firewall("0.0.0.0", 6510, rules)
    assert fact.level is Level.WARN
    assert (
        "cannot be read (nft: Operation not permitted (you must be root); iptables-save: No such" in fact.text
    )


def test_doctor_reports_real_time_settings_for_datagrams() -> None:
    assert "busy polling of 100 ms" in in_real_time(RealTime(busy_poll_ms=100.0)).text
    assert "SCHED_FIFO 50" in in_real_time(RealTime(fifo_priority=50)).text
    assert "is at its defaults" in in_real_time(RealTime()).text


def test_doctor_checks_configuration_with_datagrams(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datagrams, "firewall_rules", lambda: Rules(NFT.format(policy="drop", rule="")))
    config = load_config(
        None,
        {
            "robot.url": "egm+udp-bind://127.0.0.1:0",
            "sensor.url": "netft+udp://127.0.0.1:49152",
            "run.period_ms": 20.0,
            "controller.sample_ms": 20.0,
        },
    )
    result = [str(fact) for fact in doctor.wires(config, tmp_path, None)]
    robot = [line for line in result if " robot.url: " in line]
    sensor = [line for line in result if " sensor.url: " in line]
    assert [line.split(": ")[1].split(",")[0] for line in robot] == [
        "UDP 127.0.0.1 port 0",
        "receive buffer",
        "firewall",
        "datagrams in real time",
    ]
    assert len(sensor) == 3, "replies to requests pass a firewall"


def test_doctor_checks_other_wires_of_a_sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datagrams, "firewall_rules", lambda: Rules(NFT.format(policy="drop", rule="")))
    config = load_config(None, {"sensor.url": "netft+udp://127.0.0.1:49152"})
    sensor = sensor_in(config)
    wire = parse_url("udp-bind://127.0.0.1:0", LISTEN_DATAGRAMS)
    kind = replace(sensor.kind, other_wires=lambda url, settings: [wire])
    monkeypatch.setattr(doctor, "sensor_in", lambda config: replace(sensor, kind=kind))
    lines = [str(fact) for fact in doctor.wires(config, tmp_path, None)]
    parts = [line.split(": ")[1].split(",")[0] for line in lines if " sensor.url: " in line]
    assert parts[:2] == ["UDP 127.0.0.1 port 49152", "UDP 127.0.0.1 port 0"]
    assert parts.count("firewall") == 1
