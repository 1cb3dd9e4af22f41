"""Descriptions of every kind of device: decoded bytes and faults."""

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
def test_kind_describes_traffic_of_its_wire(arguments: tuple[str, ...], key: str, value: str) -> None:
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
def test_decode_invalid_bytes_exits_with_code_2(arguments: tuple[str, ...]) -> None:
    result = decoded(*arguments)
    assert result.exit_code == 2
    (item,) = json.loads(result.output)
    assert item["kind"] == "noise" or item["problems"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nothing", "00"), "unknown kind 'nothing'; choose one of computer-link"),
        (
            ("jr3-board", "00"),
            "jr3-board: 'JR3 sensor at a DSP receiver board, by its register protocol' has no decoder",
        ),
        (("egm", "0"), "1 digits are not complete bytes"),
    ],
)
def test_decode_unsupported_input_is_one_line(arguments: tuple[str, ...], message: str) -> None:
    error = decoded(*arguments).exception
    assert isinstance(error, ConfigError)
    assert message in str(error)
    assert "\n" not in str(error)


def test_decode_help_names_every_kind_with_decoder() -> None:
    text = " ".join(decoded("--help").output.split())
    for registry, title in ((ROBOTS, "Robots"), (SENSORS, "Sensors")):
        names = [name for name in registry.names if registry.kind(name).describe is not None]
        assert f"{title}: {', '.join(names)}." in text
    assert "jr3-board" not in text


def test_plugin_decoder_exception_becomes_problem() -> None:
    def broken(raw: bytes) -> list[dict[str, object]]:
        raise RuntimeError("a first line\nand a second")

    describe = describer_of(replace(ROBOTS.kind("egm"), describe=broken))
    assert describe is not None
    assert describe(b"12")[0]["problems"] == ["RuntimeError: a first line"]


# --- faults


def list_as_json(*arguments: str) -> dict[str, dict[str, object]]:
    result = CliRunner().invoke(cli, ["list", "faults", *arguments, "--json"])
    assert result.exit_code == 0, result.output
    entries: dict[str, dict[str, object]] = json.loads(result.output)
    return entries


@pytest.mark.parametrize("robot", ["egm", "rtde", "rsi"])
@pytest.mark.parametrize("sensor", ["netft", "ft300", "ati-can"])
def test_cell_faults_are_those_of_its_devices(robot: str, sensor: str) -> None:
    result = list_as_json("--robot", robot, "--sensor", sensor)
    parts = ROBOTS.kind(robot).emulation, SENSORS.kind(sensor).emulation
    for part in parts:
        assert part is not None
        for on, faults in part.faults.items():
            assert list(result[on]) == list(faults)
    assert {"surface", "obstacle", "computer"} <= set(result)
    assert ("bus" in result) == (sensor == "ati-can")


def test_receiver_board_has_no_sensor_wire_faults() -> None:
    result = list_as_json("--sensor", "jr3-board")
    assert "sensor-wire" not in result
    assert list(result["sensor"]) == ["wrong-scales", "unplugged"]
    assert len(list_as_json("--sensor", "jr3")["sensor-wire"]) > 5


@pytest.mark.parametrize("name", ["jr3", "jr3-uart"])
def test_gateway_sensor_has_faults_of_stream(name: str) -> None:
    fault = {"on": "sensor-wire", "fault": "lost"}
    assert load_config(None, {"sensor.emulated": name, "faults": [fault]}).faults[0].fault == "lost"


@pytest.mark.parametrize(("option", "device"), [("--robot", "robot"), ("--sensor", "sensor")])
def test_list_faults_of_unknown_kind_is_refused(option: str, device: str) -> None:
    error = CliRunner().invoke(cli, ["list", "faults", option, "nothing"]).exception
    assert isinstance(error, ConfigError)
    assert f"there is no {device} 'nothing'" in str(error)


# --- configuration


def test_commented_file_has_sections_of_built_in_kinds() -> None:
    """The sections are comments; without their #, the file contains the same defaults."""
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


def test_schema_has_sections_of_built_in_kinds() -> None:
    result = schema()
    definitions = result["$defs"]
    for section, names in (
        ("RobotConfig", ("s3", "egm", "rtde", "rsi")),
        ("SensorConfig", ("jr3", "netft", "ati_can", "ft300")),
    ):
        for name in names:
            assert definitions[section]["properties"][name]["description"]
            assert name in definitions["CellConfig"]["properties"]
    assert "counts per N" in definitions["NetFtProfile"]["properties"]["counts_per_unit"]["description"]


_OF_ONE_KIND = re.compile(r"\bS3\b|\bJR3\b|computer link")
_SECTIONS = (("RobotConfig", "s3"), ("CellConfig", "s3"), ("SensorConfig", "jr3"), ("CellConfig", "jr3"))


def _references(node: object) -> set[str]:
    """Return the names of the definitions that a part of a schema refers to."""
    if isinstance(node, dict):
        own = {str(node["$ref"]).rpartition("/")[2]} if "$ref" in node else set()
        return own.union(*map(_references, node.values()))
    return set().union(*map(_references, node)) if isinstance(node, list) else set()


def test_common_settings_name_no_single_kind() -> None:
    """Texts on S3 or JR3 are only in the sections of these kinds; the schema is also the reference."""
    definitions = schema()["$defs"]
    own: set[str] = set()
    waiting = _references([definitions[name]["properties"][key] for name, key in _SECTIONS])
    while waiting:
        own |= waiting
        waiting = _references([definitions[name] for name in waiting]) - own
    assert len(own) > 10
    for name in definitions.keys() - own:
        texts = {
            key: value.get("description", "")
            for key, value in definitions[name].get("properties", {}).items()
        }
        specific = {key: text for key, text in texts.items() if _OF_ONE_KIND.search(text)}
        assert not specific.keys() - {key for section, key in _SECTIONS if section == name}, (name, specific)


def test_commented_file_names_kinds_in_their_sections_only() -> None:
    section = ""
    for line in commented_defaults().splitlines():
        if result := re.match(r"#?\[([\w.]+)\]", line):
            section = result[1]
        if _OF_ONE_KIND.search(line):
            assert re.search(r"\.(s3|jr3)\b", section), (section, line)


def test_run_help_names_kinds_only_where_specific() -> None:
    text = " ".join(CliRunner().invoke(cli, ["run", "--help"]).output.split())
    assert [
        result.start()
        for result in _OF_ONE_KIND.finditer(text.replace("settings of an S3's computer link", ""))
    ] == []
