"""`hil-bridge conform` with what it refuses before it plays."""

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
    ("arguments", "words"),
    [
        (("rtde",), "the client's command is missing; give it after --"),
        (
            ("nope", "--", "true"),
            "unknown robot or sensor 'nope'; known: egm, rsi, rtde, s3, ati-can",
        ),
        (("rtde", "--only", "fire", "--", "true"), "no scenario 'fire' for rtde; known: nominal, late"),
        (("rtde", "--set", "fire=1", "--", "true"), "must be NAME=VALUE"),
        (("rtde", "--junit", "/nowhere/x.xml", "--", "true"), "there is no such folder"),
    ],
)
def test_wrong_input_is_refused_in_one_line(arguments: tuple[str, ...], words: str) -> None:
    code, told = conform(*arguments)
    assert code == 2
    assert words in told


def test_the_rules_are_shown_with_their_units() -> None:
    code, told = conform("rtde", "--rules", "--set", "react_s=0.2")
    assert code == 0
    assert "react_s               0.2 s     time to react to a stop" in told.splitlines()


def test_verdicts_do_not_overwrite_a_file(tmp_path: Path) -> None:
    place = tmp_path / "verdicts.json"
    place.touch()
    code, told = conform("rtde", "--json", str(place), "--", "true")
    assert code == 2
    assert "is there already" in told


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
def test_a_client_is_told_where_the_robot_is(kind: str, url: str, names: dict[str, str]) -> None:
    found = where_of(robot_at(load_config(None, {"robot.emulated": kind}), url)).names
    assert {key: found.get(key) for key in names} == names
    assert found["url"] == url


def test_a_port_of_the_client_is_free_where_the_command_is_told_it() -> None:
    config = load_config(None, {"robot.emulated": "egm"})
    assert usual_port(config, None, ["./client"]) == "egm+udp://127.0.0.1:6510"
    assert not usual_port(config, None, ["./client", "{port}"]).endswith(":6510")
    assert usual_port(config, "egm+udp://127.0.0.1:7", ["{port}"]) == "egm+udp://127.0.0.1:7"
