"""`hil-bridge conform`: input that is refused before the scenarios start."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import BridgeError
from hil_bridge.lab.conform.real_time import usual_port
from hil_bridge.lab.conform.trial import where_of
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.devices import robot_at


def conform(*arguments: str) -> "tuple[int, str]":
    result = CliRunner().invoke(cli, ["conform", *arguments])
    if isinstance(result.exception, BridgeError):
        return result.exception.exit_code, str(result.exception)
    return result.exit_code, result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("rtde",), "the client's command is missing; give it after --"),
        (
            ("nope", "--", "true"),
            "unknown robot or sensor 'nope'; known: egm, rsi, rtde, s3, ati-can",
        ),
        (("rtde", "--only", "fire", "--", "true"), "no scenario 'fire' for rtde; known: nominal, late"),
        (("rtde", "--set", "fire=1", "--", "true"), "must be NAME=VALUE"),
        (("rtde", "--junit", "/nowhere/x.xml", "--", "true"), "no such folder"),
    ],
)
def test_conform_invalid_input_is_refused_in_one_line(arguments: tuple[str, ...], message: str) -> None:
    code, output = conform(*arguments)
    assert code == 2
    assert message in output


def test_conform_rules_are_listed_with_units() -> None:
    code, output = conform("rtde", "--rules", "--set", "react_s=0.2")
    assert code == 0
    assert "react_s               0.2 s     time to react to a stop" in output.splitlines()


def test_conform_verdicts_do_not_overwrite_a_file(tmp_path: Path) -> None:
    path = tmp_path / "verdicts.json"
    path.touch()
    code, output = conform("rtde", "--json", str(path), "--", "true")
    assert code == 2
    assert "already exists" in output


@pytest.mark.parametrize(
    ("kind", "url", "names"),
    [
        (
            "rtde",
            "rtde+tcp://127.0.0.1:41000?dashboard=41001&script=41002",
            {"host": "127.0.0.1", "port": "41000", "dashboard": "41001", "script": "41002"},
        ),
        ("rtde", "rtde+tcp://127.0.0.2", {"host": "127.0.0.2", "port": "30004"}),
        ("egm", "egm+udp-bind://127.0.0.1:6510", {"host": "127.0.0.1", "port": "6510"}),
        ("s3", "s3+serial:///dev/pts/0?baudrate=9600&parity=E", {"device": "/dev/pts/0"}),
    ],
)
def test_conform_client_command_gets_robot_address(kind: str, url: str, names: dict[str, str]) -> None:
    result = where_of(robot_at(load_config(None, {"robot.emulated": kind}), url)).names
    assert {key: result.get(key) for key in names} == names
    assert result["url"] == url


def test_conform_client_port_is_free() -> None:
    config = load_config(None, {"robot.emulated": "egm"})
    assert usual_port(config, None, ["./client"]) == "egm+udp://127.0.0.1:6510"
    assert not usual_port(config, None, ["./client", "{port}"]).endswith(":6510")
    assert usual_port(config, "egm+udp://127.0.0.1:7", ["{port}"]) == "egm+udp://127.0.0.1:7"
