"""Kinds of devices, built-in and of a plug-in, by name and by URL, from the configuration to the recording."""

import dataclasses
import json
import re
import sys
from collections.abc import Iterator
from functools import partial
from importlib.metadata import EntryPoints
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from hil_bridge.cli import cli
from hil_bridge.cli.devices import device_settings
from hil_bridge.devices.kinds import ROBOTS, SENSORS, SURFACES, default_settings, robot_of, sensor_of
from hil_bridge.errors import ConfigError
from hil_bridge.errors.offers import offered
from hil_bridge.lab.conform.real_time import cell_of, make_trial
from hil_bridge.lab.conform.robots.scenarios import Rules
from hil_bridge.record import read
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.checks import problems
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, load_config, read_config
from hil_bridge.settings.kinds import settings_of, surface_settings
from tests.near_surface import CLOSE_TOML

EXAMPLES = Path(__file__).parents[2] / "examples"
TOYS = {"toy-robot": "toy_robot", "toy-sensor": "toy_sensor", "toy-surface": "toy_surface"}
"""Packages of the examples, and their modules."""
POINTS = """
[hil_bridge.robots]
toyarm = toy_robot.room:ROBOT
[hil_bridge.sensors]
toyload = toy_sensor.room:SENSOR
[hil_bridge.surfaces]
toyspring = toy_surface.surface:SURFACE
"""
NAMES = ("--robot", "toyarm", "--sensor", "toyload", "--surface", "toyspring")


def installed(site_folder: Path, points: str, monkeypatch: pytest.MonkeyPatch) -> None:
    info = site_folder / "toys-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(str(site_folder))
    for folder in TOYS:
        monkeypatch.syspath_prepend(str(EXAMPLES / folder))


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Provide the toys as one package, as if its wheel were installed."""
    installed(tmp_path, POINTS, monkeypatch)
    yield
    for name in [name for name in sys.modules if name.split(".")[0] in TOYS.values()]:
        del sys.modules[name]


def run(*arguments: str) -> str:
    result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def refusal(*arguments: str) -> str:
    with pytest.raises(ConfigError) as refused:
        CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert "\n" not in str(refused.value)
    return str(refused.value)


# --- URLs


@pytest.mark.parametrize(
    ("url", "kind", "wire"),
    [
        ("jr3+can+socketcan://can0", "jr3", "can+socketcan://can0"),
        ("jr3+can+slcan+pty:", "jr3", "can+slcan+pty:"),
        ("jr3-uart+serial:///dev/ttyACM0", "jr3-uart", "serial:///dev/ttyACM0"),
        ("jr3-board+tcp://10.0.0.1:1762", "jr3-board", "tcp://10.0.0.1:1762"),
        ("netft+udp://10.0.0.1:49152", "netft", "udp://10.0.0.1:49152"),
        ("ft300-urcap+tcp://10.0.0.1:63351", "ft300-urcap", "tcp://10.0.0.1:63351"),
    ],
)
def test_sensor_url_selects_kind(url: str, kind: str, wire: str) -> None:
    selected, rest = sensor_of(url)
    assert (selected.name, rest) == (kind, wire)


@pytest.mark.parametrize(
    ("url", "suggestion"),
    [
        ("serial:///dev/ttyUSB0?parity=E", "s3+serial:///dev/ttyUSB0?parity=E"),
        ("tcp://10.0.0.1:4000", "rtde+tcp://10.0.0.1:4000 or s3+tcp://10.0.0.1:4000"),
        ("memory:robot", "rtde+memory:robot or s3+memory:robot"),
        ("udp-bind://0.0.0.0:6510", "egm+udp-bind://0.0.0.0:6510 or rsi+udp-bind://0.0.0.0:6510"),
    ],
)
def test_robot_url_without_kind_suggests_url(url: str, suggestion: str) -> None:
    with pytest.raises(ConfigError) as refused:
        robot_of(url)
    assert str(refused.value) == f"{url!r} names no kind of robot; did you mean {suggestion}?"
    assert {robot_of(one)[1] for one in suggestion.split(" or ")} == {url}


@pytest.mark.parametrize(
    ("url", "suggestion"),
    [
        ("can+socketcan://can0", "ati-can+can+socketcan://can0 or jr3+can+socketcan://can0"),
        (
            "can+slcan:///dev/ttyACM0?bitrate=1000000",
            "ati-can+can+slcan:///dev/ttyACM0?bitrate=1000000 or jr3+can+slcan:///dev/ttyACM0?bitrate=1000000",
        ),
        (
            "serial:///dev/ttyACM0?gateway=jr3",
            "ft300+serial:///dev/ttyACM0 or jr3-uart+serial:///dev/ttyACM0",
        ),
        (
            "serial:///dev/x?parity=E&gateway=jr3",
            "ft300+serial:///dev/x?parity=E or jr3-uart+serial:///dev/x?parity=E",
        ),
        ("tcp://10.0.0.1:1762?filter=2", "jr3-board+tcp://10.0.0.1:1762?filter=2"),
        ("udp://10.0.0.1:49152", "netft+udp://10.0.0.1:49152"),
    ],
)
def test_sensor_url_without_kind_suggests_url(url: str, suggestion: str) -> None:
    with pytest.raises(ConfigError) as refused:
        sensor_of(url)
    assert str(refused.value) == f"{url!r} names no kind of sensor; did you mean {suggestion}?"


def test_can_gateway_on_byte_wire_suggests_receivers() -> None:
    with pytest.raises(
        ConfigError, match=r"did you mean jr3-board\+tcp://10\.0\.0\.1:1762 for a receiver board"
    ):
        SENSORS.kind("jr3").parse("tcp://10.0.0.1:1762", default_settings(SENSORS.kind("jr3")))


@pytest.mark.parametrize(("find", "device"), [(robot_of, "robot"), (sensor_of, "sensor")])
def test_url_of_unknown_kind_lists_kinds(find: Any, device: str) -> None:
    with pytest.raises(ConfigError, match=f"there is no {device} 'kuka'; choose one of "):
        find("kuka+tcp://10.0.0.1:4000")
    with pytest.raises(ConfigError, match=r"it names no kind; choose one of .*, as in KIND\+WIRE"):
        find("foo:bar")


def test_emulated_unknown_kind_is_refused() -> None:
    for section, name in (("robot", "kuka"), ("sensor", "usb"), ("sensor", "gateway")):
        with pytest.raises(ValueError, match=f"there is no {section} '{name}'"):
            read_config({section: {"emulated": name}})


def test_default_devices_are_used_for_file_without_any(tmp_path: Path) -> None:
    usual = run("run", "--virtual", "--duration", "1", "--no-view", "--record", str(tmp_path / "a.mcap"))
    config = tmp_path / "c.toml"
    config.write_text('[robot]\nemulated = "s3"\n[sensor]\nemulated = "jr3"\n')
    named = run(
        "run", str(config), "--virtual", "--duration", "1", "--no-view", "--record", str(tmp_path / "b.mcap")
    )
    assert usual.replace("a.mcap", "b.mcap") == named
    assert [c.target for c in read(tmp_path / "a.mcap").cycles] == [
        c.target for c in read(tmp_path / "b.mcap").cycles
    ]


# --- devices of a plug-in


@pytest.mark.usefixtures("toys")
def test_toy_devices_hold_force_and_record_facts(tmp_path: Path) -> None:
    record, near = str(tmp_path / "toys.mcap"), tmp_path / "near.toml"
    near.write_text(CLOSE_TOML)
    run(
        "run",
        str(near),
        "--virtual",
        "--duration",
        "2",
        "--no-view",
        *NAMES,
        "--record",
        record,
        "--summary",
        str(tmp_path / "s.json"),
    )
    summary = json.loads((tmp_path / "s.json").read_text())
    assert summary["outcome"] == "completed"
    assert summary["force_mean_steady_n"] == pytest.approx(10.0, abs=0.3)
    assert summary["cycle_time"]["mean_s"] == pytest.approx(0.004, rel=5e-3)
    devices = devices_of(read(Path(record)))
    assert (devices.robot.kind, devices.robot.model, devices.robot.cycle_s) == ("toyarm", "toy arm", 0.004)
    assert devices.sensor.kind == "toyload"
    assert devices.sensor.facts is not None
    assert devices.sensor.facts.scales[0] == 1e-3
    assert "robot's packet, interpolator and path to the loops" in run("latency", record)
    assert "every command identical" in run("replay", record)
    assert run("report", record).strip().endswith("report.html")


def quick(**sections: dict[str, Any]) -> Config:
    """Return a configuration with the toy arm, whose cycle is 4 ms, as for a run."""
    return Setup(
        read_config({**sections, "robot": {"emulated": "toyarm"}, "sensor": {"emulated": "toyload"}})
    ).config


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize(
    ("controller", "period_ms", "sample_ms"),
    [("predictive", 0.0, 4.0), ("pi", 0.0, 4.0), ("admittance", 0.0, 4.0), ("fuzzy", 180.0, 180.0)],
)
def test_controller_runs_at_tuned_sample_time(controller: str, period_ms: float, sample_ms: float) -> None:
    config = quick(controller={"name": controller})
    assert (config.run.period_ms, config.controller.sample_ms) == (period_ms, sample_ms)
    assert Setup(config).loop


@pytest.mark.parametrize(
    ("sensor", "period_ms"),
    [("netft", 0.0), ("jr3", 12.0), ("jr3-uart", 12.0), ("ft300", 12.0), ("ft300-urcap", 12.0)],
)
def test_controller_waits_for_new_force(sensor: str, period_ms: float) -> None:
    """A robot with a cycle of 4 ms waits for a sensor with a period of 10 ms."""
    config = Setup(read_config({"robot": {"emulated": "egm"}, "sensor": {"emulated": sensor}})).config
    assert config.run.period_ms == period_ms
    assert Setup(config).loop


def test_robot_without_cycle_time_needs_period() -> None:
    config = read_config({"robot": {"emulated": "egm"}, "sensor": {"emulated": "netft"}})
    robot = replace(Setup(config).facts, cycle_s=None, line_floor_s=None)
    with pytest.raises(ConfigError, match=r"reports no cycle time of its own: set run\.period_ms"):
        Setup(config).loop_for(robot)


@pytest.mark.usefixtures("toys")
def test_configuration_overrides_tuning() -> None:
    parameters = quick(controller={"name": "pi", "parameters": {"integral": 0.5}}).controller.parameters
    assert (parameters["integral"], parameters["proportional"]) == (0.5, 0.0)
    assert quick(run={"period_ms": 12.0}, controller={"name": "pi"}).controller.sample_ms == 12.0
    own = quick(run={"period_ms": 20.0}, controller={"sample_ms": 20.0}).controller
    assert (own.sample_ms, own.parameters) == (20.0, {})


@pytest.mark.usefixtures("toys")
def test_period_without_tuning_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text("[run]\nperiod_ms = 50\n")
    message = refusal("run", str(file), "--virtual", "--no-view", "--no-record", *NAMES)
    assert "controller.sample_ms = 50" in message


@pytest.mark.usefixtures("toys")
def test_kind_settings_are_in_sections_of_its_name(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text(
        '[robot]\nemulated = "toyarm"\n[cell]\nsurface_kind = "toyspring"\n'
        "[cell.toyarm]\nspeed_mm_s = 90\n[cell.toyspring]\nstiffness_n_mm = 7\n"
    )
    config = load_config(file, {})
    assert settings_of(config, ROBOTS.kind("toyarm")).emulated.speed_mm_s == 90
    assert surface_settings(config, SURFACES.kind("toyspring")).stiffness_n_mm == 7
    file.write_text("[cell.toyspring]\nstiffness_n_mm = -1\n")
    with pytest.raises(ConfigError, match=r"cell\.toyspring\.stiffness_n_mm must be more than 0, got -1"):
        load_config(file, {})
    file.write_text("[cell.toyspring]\nstiffness_n_m = 7\n")
    with pytest.raises(
        ConfigError, match=r"stiffness_n_m is not a setting; the unit is part of the name: stiff"
    ):
        load_config(file, {})
    file.write_text('[robot]\nemulated = "toyarm"\n[[faults]]\non = "cable"\nfault = "cut"\n')
    with pytest.raises(ConfigError, match=r"unknown target 'cable'; known: robot, signal"):
        load_config(file, {})


def test_kind_not_installed_has_no_sections(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text("[cell.toyarm]\nspeed_mm_s = 90\n")
    with pytest.raises(ConfigError, match=r"cell\.toyarm is not a setting"):
        load_config(file, {})


def test_device_option_without_colon_is_kind() -> None:
    message = refusal("run", "--virtual", "--robot", "toyarm")
    assert message == f"--robot: there is no robot 'toyarm'; choose one of {', '.join(ROBOTS.names)}"


@pytest.mark.parametrize("groups", [(), ("hil_bridge.robots",)])
def test_kind_outdated_installation_names_remedy(
    monkeypatch: pytest.MonkeyPatch, groups: tuple[str, ...]
) -> None:
    points_kept = [point for point in offered() if point.group in groups and point.name != "s3"]
    monkeypatch.setattr("hil_bridge.errors.plugins.offered", lambda: EntryPoints(points_kept))
    for choose in (partial(ROBOTS.kind, "s3"), partial(robot_of, "s3+serial:///dev/ttyUSB0")):
        with pytest.raises(
            ConfigError, match=r"robot 's3' is not installed; install hil-bridge again: pip install"
        ):
            choose()


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ("toy_sensor.room:SENSOR", "toy_sensor.room:SENSOR must be a RobotKind with that name"),
        ("toy_robot.room:NOTHING", "cannot be loaded: AttributeError"),
        ("toy_robot.nowhere:ROBOT", "cannot be loaded: the module toy_robot.nowhere is missing"),
    ],
)
def test_kind_of_broken_package_names_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, point: str, expected: str
) -> None:
    installed(tmp_path, f"[hil_bridge.robots]\ntoyarm = {point}\n", monkeypatch)
    assert "toyarm" in ROBOTS.names
    load_config(None, {})  # a package that is not selected has no effect
    message = refusal("run", "--virtual", "--robot", "toyarm")
    assert "robot 'toyarm' of toys 1.0" in message
    assert expected in message


CAN_ROOM = """
from dataclasses import replace
from hil_bridge.devices.sensors.ati_can.room import SENSOR
SENSOR = replace(SENSOR, name="theircan")
WITHOUT_BUS = replace(SENSOR, name="theirserial", bus=None)
"""


def test_plugin_can_sensor_has_bus_faults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = "[hil_bridge.sensors]\ntheircan = their_room:SENSOR\ntheirserial = their_room:WITHOUT_BUS\n"
    (tmp_path / "their_room.py").write_text(CAN_ROOM)
    installed(tmp_path, points, monkeypatch)
    cut = {"on": "bus", "fault": "off", "phase": "track"}
    read_config({"sensor": {"emulated": "theircan"}, "faults": [cut]})
    for kind in ("theirserial", "jr3-uart", "netft"):
        with pytest.raises(ValueError, match=f"bus: off needs sensor.emulated = ati-can or jr3, not {kind}"):
            read_config({"sensor": {"emulated": kind}, "faults": [cut]})


SMALL_ROOM = """
from dataclasses import replace
from hil_bridge.devices.robots.egm.room import ROBOT
CELL = {"start_position_mm": [400, -100, 200], "surface": {"height_mm": 190, "origin_x_mm": 400}}
ROBOT = replace(ROBOT, name="small", emulation=replace(ROBOT.emulation, cell=CELL))
"""


def test_robot_of_short_reach_brings_its_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "small_room.py").write_text(SMALL_ROOM)
    installed(tmp_path, "[hil_bridge.robots]\nsmall = small_room:ROBOT\n", monkeypatch)
    cell = read_config({"robot": {"emulated": "small"}}).cell
    assert cell.start_position_mm == (400.0, -100.0, 200.0)
    assert (cell.surface.height_mm, cell.surface.origin_x_mm) == (190.0, 400.0)
    given = {"surface": {"height_mm": 180.0}, "start_position_mm": [410.0, 0.0, 200.0]}
    cell = read_config({"robot": {"emulated": "small"}, "cell": given}).cell
    assert cell.start_position_mm == (410.0, 0.0, 200.0)
    assert (cell.surface.height_mm, cell.surface.origin_x_mm) == (180.0, 400.0)
    assert read_config({"robot": {"emulated": "egm"}}).cell.surface.height_mm == 590.0


@pytest.mark.usefixtures("toys")
def test_plugin_robot_supports_conform_and_panel_faults() -> None:
    trial = make_trial(cell_of("toyarm", None), Rules(), ["true"])
    assert list(trial.scenarios) == ["nominal", "refused", "stopped", "emergency"]
    emulation = ROBOTS.kind("toyarm").emulation
    assert emulation is not None
    assert emulation.controls is not None
    assert emulation.controls.faults == emulation.faults


@pytest.mark.usefixtures("toys")
def test_robot_without_conform_support_reports_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = ROBOTS.kind("toyarm")
    assert kind.emulation is not None
    mute = dataclasses.replace(kind, emulation=dataclasses.replace(kind.emulation, mishaps={}), probe=None)
    monkeypatch.setattr(type(ROBOTS), "kind", lambda self, name: mute)
    message = refusal("conform", "toyarm", "--", "true")
    assert message.startswith("toyarm: cannot test its clients, its RobotEmulation has no mishaps; ")
    message = refusal("probe", "robot", "toyarm+udp://127.0.0.1:9")
    assert message == "the kind toyarm has no probe; its package provides one as `probe` of its RobotKind"


@pytest.mark.parametrize("robot", ["egm", "rtde", "rsi"])
def test_checks_before_run_use_its_period(robot: str) -> None:
    """`doctor` refuses no configuration that a run accepts."""
    config = read_config({"robot": {"emulated": robot}, "sensor": {"emulated": "netft"}})
    assert not list(problems(Setup(config), virtual=True))


def test_list_plugins_shows_package_and_summary(toys: None) -> None:
    message = run("list", "plugins")
    assert [line.split()[:4] for line in message.splitlines()] == [
        ["robot", "toyarm", "toys", "1.0"],
        ["sensor", "toyload", "toys", "1.0"],
        ["surface", "toyspring", "toys", "1.0"],
    ]
    rows = json.loads(run("list", "plugins", "--json", "--all"))
    assert {row["name"] for row in rows if row["package"] == "hil-bridge"} >= {
        "s3",
        "egm",
        "netft",
        "predictive",
    }
    assert {row["state"] for row in rows} == {"ok"}


def test_list_plugins_shows_fault_of_broken_plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    installed(tmp_path, "[hil_bridge.robots]\nlost = toy_robot.nowhere:ROBOT\n", monkeypatch)
    result = CliRunner().invoke(cli, ["list", "plugins"], catch_exceptions=False)
    assert result.exit_code == 2
    assert (
        "WRONG: robot 'lost' of toys 1.0 cannot be loaded: the module toy_robot.nowhere is missing"
        in result.output
    )


def test_list_controllers_shows_parameters() -> None:
    message = run("list", "controllers", "predictive")
    assert message.startswith("predictive: ")
    assert "  made for a sample every 180 ms; hil-bridge" in message
    assert "  at 4 ms: " in message
    everything = json.loads(run("list", "controllers", "--json"))
    assert {one["name"] for one in everything} >= {"fuzzy", "pi", "admittance"}
    assert all(parameter["meaning"] for one in everything for parameter in one["parameters"])
    assert "there is no controller 'nothing'" in refusal("list", "controllers", "nothing")


def test_device_option_with_kind_overrides_url_of_file(tmp_path: Path) -> None:
    file = tmp_path / "site.toml"
    file.write_text('[robot]\nurl = "rtde+tcp://192.0.2.1"\n[sensor]\nurl = "netft+udp://192.0.2.2"\n')
    config = load_config(file, device_settings("egm", None, None))
    assert (config.robot.url, config.robot.emulated) == ("", "egm")
    assert config.sensor.url == "netft+udp://192.0.2.2", "the command line names no sensor"


@pytest.mark.parametrize(
    ("option", "suggestion"),
    [("/dev/ttyUSB0", "s3+serial:///dev/ttyUSB0"), ("192.0.2.1", "rtde+tcp://192.0.2.1")],
)
def test_port_or_address_alone_suggests_url(option: str, suggestion: str) -> None:
    assert device_settings(option, None, None)["robot.url"] == option
    with pytest.raises(ConfigError, match=re.escape(suggestion)):
        robot_of(option)
