"""The words of every kind of device for its bytes, pasted."""

import json
from dataclasses import replace

import pytest
from click.testing import CliRunner, Result

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.kinds import ROBOTS, SENSORS, words_of

TELEGRAM = b'<Rob TYPE="KUKA"><RIst X="1.0" Y="2.0" Z="3.0" A="0" B="0" C="0"/><IPOC>7</IPOC></Rob>'


def decoded(*arguments: str) -> Result:
    return CliRunner().invoke(cli, ["decode", *arguments])


@pytest.mark.parametrize(
    ("arguments", "key", "value"),
    [
        (("s3", "05"), "name", "ENQ"),
        (("jr3", "201#C80010270000"), "op", "start async"),
        (("jr3-uart", "3C 30 36 3E"), "op", "get state"),
        (("netft", "1234", "0002", "00000000"), "op", "start"),
        (("ati-can", "200#"), "op", "sample"),
        (("rtde", "00 05 56 00 02"), "op", "protocol version"),
        (("rsi", TELEGRAM.hex()), "root", "Rob"),
    ],
)
def test_a_kind_has_words_for_what_goes_over_its_wire(
    arguments: tuple[str, ...], key: str, value: str
) -> None:
    result = decoded(*arguments)
    assert result.exit_code == 0, result.output
    assert json.loads(result.output)[0][key] == value


@pytest.mark.parametrize(
    "arguments",
    [
        ("egm", "0A 00"),
        ("rsi", "3C"),
        ("ft300", "20 4E"),
        ("ati-can", "999#00"),
        ("jr3", "zz"),
        ("netft", "00"),
    ],
)
def test_bytes_without_meaning_have_exit_code_2(arguments: tuple[str, ...]) -> None:
    result = decoded(*arguments)
    assert result.exit_code == 2
    (item,) = json.loads(result.output)
    assert item["kind"] == "noise" or item["problems"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nothing", "00"), "there is no kind 'nothing' to decode; choose one of computer-link"),
        (("jr3-board", "00"), "jr3-board: there are no words"),
        (("egm", "0"), "1 digits are no whole bytes"),
    ],
)
def test_what_cannot_be_decoded_is_one_line(arguments: tuple[str, ...], words: str) -> None:
    error = decoded(*arguments).exception
    assert isinstance(error, ConfigError)
    assert words in str(error)
    assert "\n" not in str(error)


def test_the_help_names_every_kind() -> None:
    text = " ".join(decoded("--help").output.split())
    for name in (*ROBOTS.names, *SENSORS.names):
        assert name in text


def test_words_of_another_package_that_raise_become_a_problem() -> None:
    def broken(raw: bytes) -> list[dict[str, object]]:
        raise RuntimeError("a first line\nand a second")

    words = words_of(replace(ROBOTS.kind("egm"), describe=broken))
    assert words is not None
    assert words(b"12")[0]["problems"] == ["RuntimeError: a first line"]
