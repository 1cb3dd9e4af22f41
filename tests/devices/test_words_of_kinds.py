"""The words of every kind of device: for its bytes, pasted, and for its faults."""

import json
import re
import tomllib
from dataclasses import replace

import pytest
from click.testing import CliRunner, Result

from hil_bridge.cli import cli
from hil_bridge.devices.kinds import ROBOTS, SENSORS, describer_of
from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import load_config, read_config, with_all_kinds
from hil_bridge.settings.template import commented_defaults, schema

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
        (("nothing", "00"), "unknown kind 'nothing'; choose one of computer-link"),
        (
            ("jr3-board", "00"),
            "jr3-board: 'JR3 sensor at a DSP receiver board, by its register protocol' has no decoder",
        ),
        (("egm", "0"), "1 digits are not complete bytes"),
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

    words = describer_of(replace(ROBOTS.kind("egm"), describe=broken))
    assert words is not None
    assert words(b"12")[0]["problems"] == ["RuntimeError: a first line"]


# --- faults


def listed(*arguments: str) -> dict[str, dict[str, object]]:
    result = CliRunner().invoke(cli, ["list", "faults", *arguments, "--json"])
    assert result.exit_code == 0, result.output
    found: dict[str, dict[str, object]] = json.loads(result.output)
    return found


@pytest.mark.parametrize("robot", ["egm", "rtde", "rsi"])
@pytest.mark.parametrize("sensor", ["netft", "ft300", "ati-can"])
def test_the_faults_of_a_cell_are_those_of_its_devices(robot: str, sensor: str) -> None:
    found = listed("--robot", robot, "--sensor", sensor)
    parts = ROBOTS.kind(robot).emulation, SENSORS.kind(sensor).emulation
    for part in parts:
        assert part is not None
        for on, faults in part.faults.items():
            assert list(found[on]) == list(faults)
    assert {"surface", "obstacle", "computer"} <= set(found)
    assert ("bus" in found) == (sensor == "ati-can")


def test_a_receiver_board_has_no_wire_of_its_own() -> None:
    found = listed("--sensor", "jr3-board")
    assert "sensor-wire" not in found
    assert list(found["sensor"]) == ["wrong-scales", "unplugged"]
    assert len(listed("--sensor", "jr3")["sensor-wire"]) > 5


@pytest.mark.parametrize("name", ["jr3", "jr3-uart"])
def test_a_gateway_s_sensor_has_the_faults_of_a_stream(name: str) -> None:
    fault = {"on": "sensor-wire", "fault": "lost"}
    assert load_config(None, {"sensor.emulated": name, "faults": [fault]}).faults[0].fault == "lost"


@pytest.mark.parametrize(("option", "thing"), [("--robot", "robot"), ("--sensor", "sensor")])
def test_faults_of_an_unknown_kind_are_refused(option: str, thing: str) -> None:
    error = CliRunner().invoke(cli, ["list", "faults", option, "nothing"]).exception
    assert isinstance(error, ConfigError)
    assert f"there is no {thing} 'nothing'" in str(error)


# --- configuration


def test_sections_of_all_our_kinds_are_in_the_commented_file() -> None:
    """They are comments; without their # the file holds the same defaults."""
    text = commented_defaults()
    assert tomllib.loads(text)["robot"]["emulated"] == "s3"
    assert "egm" not in tomllib.loads(text)["robot"]
    plain = tomllib.loads(re.sub(r"^#(?=[^ ])", "", text, flags=re.MULTILINE))
    for name in ("s3", "egm", "rtde", "rsi"):
        assert plain["robot"][name]
        assert plain["cell"][name]
    for name in ("jr3", "netft", "ati_can", "ft300"):
        assert plain["sensor"][name]
        assert plain["cell"][name]
    assert read_config(plain).model_dump() == with_all_kinds().model_dump()


def test_the_schema_knows_the_sections_of_all_our_kinds() -> None:
    found = schema()
    definitions = found["$defs"]
    for section, names in (
        ("RobotConfig", ("s3", "egm", "rtde", "rsi")),
        ("SensorConfig", ("jr3", "netft", "ati_can", "ft300")),
    ):
        for name in names:
            assert definitions[section]["properties"][name]["description"]
            assert name in definitions["CellConfig"]["properties"]
    assert "counts for 1 N" in definitions["NetFtProfile"]["properties"]["counts_per_unit"]["description"]


_OF_ONE_KIND = re.compile(r"\bS3\b|\bJR3\b|computer link")
_SECTIONS = (("RobotConfig", "s3"), ("CellConfig", "s3"), ("SensorConfig", "jr3"), ("CellConfig", "jr3"))


def _referred(node: object) -> set[str]:
    """Names of the definitions that a part of a schema refers to."""
    if isinstance(node, dict):
        own = {str(node["$ref"]).rpartition("/")[2]} if "$ref" in node else set()
        return own.union(*map(_referred, node.values()))
    return set().union(*map(_referred, node)) if isinstance(node, list) else set()


def test_settings_of_any_device_name_no_single_kind() -> None:
    """A text on S3 or JR3 stands in the sections of these kinds alone; the schema is also the reference."""
    definitions = schema()["$defs"]
    own: set[str] = set()
    waiting = _referred([definitions[name]["properties"][key] for name, key in _SECTIONS])
    while waiting:
        own |= waiting
        waiting = _referred([definitions[name] for name in waiting]) - own
    assert len(own) > 10
    for name in definitions.keys() - own:
        texts = {
            key: value.get("description", "")
            for key, value in definitions[name].get("properties", {}).items()
        }
        told = {key: text for key, text in texts.items() if _OF_ONE_KIND.search(text)}
        assert not told.keys() - {key for section, key in _SECTIONS if section == name}, (name, told)


def test_the_commented_file_names_a_single_kind_in_its_sections_alone() -> None:
    section = ""
    for line in commented_defaults().splitlines():
        if found := re.match(r"#?\[([\w.]+)\]", line):
            section = found[1]
        if _OF_ONE_KIND.search(line):
            assert re.search(r"\.(s3|jr3)\b", section), (section, line)


def test_the_help_of_a_run_names_no_single_kind_but_where_it_is_of_one() -> None:
    text = " ".join(CliRunner().invoke(cli, ["run", "--help"]).output.split())
    assert [
        found.start()
        for found in _OF_ONE_KIND.finditer(text.replace("settings of an S3's computer link", ""))
    ] == []
