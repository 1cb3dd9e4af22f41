"""The configuration file: refusals, and output of the commands for it."""

import dataclasses
import json
import pickle
import tomllib
from pathlib import Path
from typing import Annotated, Any

import pytest
from pydantic import AfterValidator, BaseModel, ValidationError, create_model

from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.errors import ConfigError, SettingRefused
from hil_bridge.settings.configuration import Config, dump, explain, load_config, read_config, with_all_kinds
from hil_bridge.settings.kinds import settings_of
from hil_bridge.settings.template import commented_defaults, profile_rows, schema
from protocol.devices.s3.adlp import LinkProfile
from protocol.marks import Mark, SettingError


def refusal(tmp_path: Path, text: str, **overrides: object) -> str:
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(path, {key.replace("__", "."): value for key, value in overrides.items()})
    message = str(caught.value)
    assert "\n" not in message
    return message.removeprefix(f"{tmp_path}/")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[run]\nbogus = 1", "c.toml: run.bogus is not a setting; known here: duration_s, seed, period_ms"),
        (
            "[run]\nduration_ms = 1",
            "run.duration_ms is not a setting; the unit is part of the name: duration_s",
        ),
        ("[task]\nforce = 1", "task.force is not a setting; the unit is part of the name: force_n"),
        ("[cell.surface]\nstifness_n_m = 1", "did you mean stiffness_n_m?"),
        (
            "[limits]\nforce = 1",
            "limits.force is not a setting; did you mean force_limit_n or force_margin_share?",
        ),
        (
            "[limits]\nforce_limit = 1",
            "limits.force_limit is not a setting; the unit is part of the name: force_l",
        ),
        ("[bogus]\nx = 1", "bogus is not a setting; known here: run, robot"),
        ('[run]\nduration_s = "x"', "run.duration_s: must be a valid number"),
        ("run = 3", "run must be a table of settings, got 3"),
        ("[robot]\ns3 = 3", "robot.s3 must be a table of settings, got 3"),
        ("[controller]\nparameters = 3", "controller.parameters must be a table of settings, got 3"),
        ("[frame]\ntravel = [0, 0]", "frame.travel: a value is missing, got [0, 0]"),
        ("[frame]\ntravel = [0, 0, 0]", "frame.travel: must not be the zero vector"),
        ("[frame]\ntravel = [0, 0, 1]", "frame.travel: must be perpendicular to frame.approach"),
        ("[cell.surface]\nstiffness_n_m = -1.0", "cell.surface.stiffness_n_m must be at least 0, got -1"),
        ("[task]\nforce_n = nan", "task.force_n must be a number above 0, got nan"),
        (
            '[robot.s3.link]\ndle_stuffing = "x"',
            "robot.s3.link.dle_stuffing: must be 'off' or 'double', got 'x'",
        ),
        ('[controller]\nname = "pid"', "there is no controller 'pid'; choose one of fuzzy, "),
        ("[controller.parameters]\nfoo = 1", "predictive has no parameter 'foo'; known here: window"),
        ("[run]\nseed = -1\nx = 1", "(and 1 more)"),
        (
            '[robot.s3.link]\nprofile = "x"',
            "robot.s3.link.profile must be one of default, observed-client, got 'x'",
        ),
        (
            '[cell.s3.link]\nprofile = "x"',
            "cell.s3.link.profile must be one of default, observed-client, got 'x'",
        ),
        (
            '[robot.s3.link]\nprofile = "observed-client"\nmove_length = 52',
            "robot.s3.link.move_length must be 60 in the profile observed-client, got 52; leave it or the profile out",
        ),
        (
            "[robot.link]\nbaudrate = 19200",
            "c.toml: robot.link is not a setting; known here: url, ",
        ),  # of 0.5
        (
            '[sensor]\nemulated = "gateway"',
            "sensor.emulated: there is no sensor 'gateway'; choose one of ati-can, ",
        ),
        ('[[faults]]\non = "link"\nfault = "delay"', "unknown target 'link'; known: robot, pose, "),
        ("hello", "c.toml is not valid TOML: "),
        (
            "[tool]\nmass_kg = 0.5\n\n[tool]\nmass_kg = 0.4\n",
            "c.toml is not valid TOML: it contains the table [tool] twice (at line 4, column 6); merge the second into "
            "the first",
        ),
    ],
)
def test_invalid_setting_is_named_with_remedy(tmp_path: Path, text: str, message: str) -> None:
    assert message in refusal(tmp_path, text)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (SettingError("url", "must not be"), "configuration: robot.url must not be"),
        (ValueError("url must not be"), "configuration: robot: url must not be"),
    ],
)
def test_profile_check_names_setting_by_field(error: ValueError, message: str) -> None:
    def refuse(values: object) -> object:
        raise error

    model = create_model("Model", robot=(Annotated[dict[str, str], AfterValidator(refuse)], ...))
    with pytest.raises(ValidationError) as caught:
        model(robot={})
    assert str(explain(caught.value, None, set())) == message


def test_setting_refused_can_be_pickled() -> None:
    refused = SettingRefused("c.toml", ("faults", "0", "when"), "must be a condition", " ", 2)
    copy = pickle.loads(pickle.dumps(refused))
    assert str(copy) == str(refused) == "c.toml: faults.0.when must be a condition (and 2 more)"
    assert copy.without_source == "faults.0.when must be a condition (and 2 more)"
    assert copy.below(2) == "when must be a condition (and 2 more)"
    assert copy.below(3) == "must be a condition (and 2 more)"
    assert str(SettingRefused("--force-n", (), "must be above 0", " ")) == "--force-n must be above 0"


def test_invalid_option_is_named_as_typed(tmp_path: Path) -> None:
    assert refusal(tmp_path, "", run__duration_s=0.0).startswith("--duration: must be greater than 0")
    assert refusal(tmp_path, "", task__force_n=-3.0).startswith("--force-n must be a number above 0")
    assert refusal(tmp_path, "[run]\nseed = -1", run__duration_s=3.0).startswith("c.toml: run.seed")


def test_unreadable_configuration_is_named(tmp_path: Path) -> None:
    (tmp_path / "latin.toml").write_bytes(b"[run]\n# \xb5m\n")
    for path, reason in (
        (tmp_path, "Is a directory"),
        (tmp_path / "nothing.toml", "No such file"),
        (tmp_path / "latin.toml", "is not valid utf-8: invalid start byte in line 2; save it as utf-8"),
    ):
        with pytest.raises(ConfigError, match=reason) as caught:
            load_config(path, {})
        assert str(path) in str(caught.value)


def test_written_defaults_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text(commented_defaults())
    assert load_config(path, {}) == read_config({})


def keys(prefix: str, value: Any) -> set[str]:
    if isinstance(value, BaseModel):
        items = [(name, getattr(value, name)) for name in type(value).model_fields]
    elif dataclasses.is_dataclass(value):
        items = [(field.name, getattr(value, field.name)) for field in dataclasses.fields(value)]
    else:
        return {prefix}
    return set().union(*(keys(f"{prefix}.{name}" if prefix else name, item) for name, item in items))


def test_defaults_file_has_every_setting_with_comment() -> None:
    names, section, comment = set(), "", False
    for line in commented_defaults().splitlines():
        if line.startswith("["):
            section = line.strip("[]")
        elif line and not line.startswith("#"):
            assert comment, f"{line} has no comment"
            names.add(f"{section}.{line.partition(' = ')[0]}")
        elif line.endswith(" ="):  # not set by default
            assert comment, f"{line} has no comment"
            names.add(f"{section}.{line[2:-2]}".lstrip("."))
        comment = line.startswith("# ")
    assert names == keys("", Config())
    assert tomllib.loads(commented_defaults())["cell"]["surface"]


def test_schema_describes_every_setting() -> None:
    described = json.loads(json.dumps(schema()))

    def walk(prefix: str, node: dict[str, Any]) -> set[str]:
        keys: set[str] = set()
        for name, entry in node["properties"].items():
            key = f"{prefix}.{name}" if prefix else name
            assert entry.get("description"), key
            inner = entry.get("$ref", "").removeprefix("#/$defs/")
            table = described["$defs"].get(inner, {})
            keys |= walk(key, table) if "properties" in table else {key}
        return keys

    assert walk("", described) == keys("", with_all_kinds())
    tables = [node for node in described["$defs"].values() if "properties" in node]
    assert not any(table.get("additionalProperties", True) for table in tables)


def test_profile_rows_include_every_marked_setting(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text("[robot.s3.link]\nbid_limit = 7\n")
    rows = dict(profile_rows(load_config(path, {})))
    assert rows["robot.s3.link.bid_limit"].value == 7
    assert rows["robot.s3.link.bid_limit"].default == 3
    assert rows["robot.s3.link.baudrate"].info.mark is Mark.OBSERVED
    assert rows["cell.s3.robot.turnaround_ms"].info.mark is Mark.ASSUMED


def test_model_dependent_default_can_be_overridden(
    tmp_path: Path,
) -> None:
    path = tmp_path / "c.toml"

    def rows(more: str) -> dict[str, Any]:
        path.write_text(f'[robot]\nemulated = "rtde"\n[cell.rtde]\n{more}')
        return dict(profile_rows(load_config(path, {})))

    name = "cell.rtde.force_offset_n"
    usual, cb3 = rows(""), rows('model = "ur10"\n')
    assert (
        (usual[name].value, usual[name].info.mark)
        == (usual[name].default, Mark.OBSERVED)
        == (4.5, Mark.OBSERVED)
    )
    assert cb3[name].value == cb3[name].default == 28.0
    point = "cell.rtde.joint_bits"
    assert (usual[point].info.mark, cb3[point].info.mark) == (Mark.OBSERVED, Mark.ASSUMED)
    assert rows('model = "ur10"\nforce_offset_n = 4.5\n')[name].value == 4.5
    described = schema()["$defs"]["RtdeProfile"]["properties"]["force_offset_n"]
    assert (described["default"], described["type"]) == (4.5, "number")
    config = load_config(path, {})
    assert read_config(json.loads(dump(config))) == config


def test_link_profile_expands_and_round_trips(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text('[robot.s3.link]\nprofile = "observed-client"\nbaudrate = 19200\n')
    config = load_config(file, {"cell.s3.link.profile": "observed-client"})
    assert settings_of(config, S3).client.link == LinkProfile.named("observed-client", baudrate=19200)
    assert settings_of(config, S3).emulated.link == LinkProfile.named("observed-client")
    assert read_config(json.loads(dump(config))) == config
    over = load_config(file, {"robot.s3.link.profile": "default"})
    assert settings_of(over, S3).client.link == LinkProfile(baudrate=19200)
