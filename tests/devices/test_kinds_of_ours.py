"""All built-in kinds have faults, targets, scenarios, marks and an entry in the help."""

import dataclasses
import re

import pytest
from click.testing import CliRunner
from msgspec.structs import asdict, replace

from emulators.arm.reported_pose import POSE_FAULTS
from emulators.faults.packets import BYTES, DATAGRAMS, SENSOR_WIRE, WIRE
from hil_bridge.cli import cli
from hil_bridge.devices.facts import RobotFacts, ServoFacts
from hil_bridge.devices.kinds import ROBOTS, SENSORS, EmulatedKinds
from hil_bridge.devices.sensors.jr3.room import CAN_GATEWAY, UART_GATEWAY
from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.robots.scenarios import SCENARIOS, Rules
from hil_bridge.lab.conform.robots.stage import RobotTrial
from hil_bridge.lab.conform.trial import NOMINAL
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import load_config, read_config
from hil_bridge.settings.kinds import settings_of
from protocol.marks import Mark
from tools.faults_doc import ROBOT_NAMES, SENSOR_NAMES, faults_of_device


def test_jr3_receivers_share_sections() -> None:
    config = read_config({"sensor": {"emulated": "jr3-uart", "jr3": {"uart": {"period_ms": 2.0}}}})
    assert settings_of(config, UART_GATEWAY).client.uart.period_ms == 2.0
    assert settings_of(config, CAN_GATEWAY).client is settings_of(config, UART_GATEWAY).client


def test_jr3_receiver_has_declared_faults() -> None:
    faults = {
        name: set(EmulatedKinds.named("s3", name).faults["sensor"])
        for name in ("jr3", "jr3-uart", "jr3-board")
    }
    assert faults["jr3"] == faults["jr3-uart"] > faults["jr3-board"] == {"unplugged", "wrong-scales"}
    second = {"on": "sensor", "fault": "unplugged", "with": {"sensor": "second"}}
    read_config({"sensor": {"emulated": "jr3-board"}, "faults": [second]})
    with pytest.raises(ValueError, match="unplugged with sensor = second needs sensor"):
        read_config({"sensor": {"emulated": "jr3-uart"}, "faults": [second]})


@pytest.mark.parametrize("name", [name for name in (*ROBOT_NAMES, *SENSOR_NAMES) if name != "jr3-board"])
def test_built_in_devices_have_all_wire_faults(name: str) -> None:
    """The receiver board is an exception: its registers are read, and no frames arrive."""
    faults = faults_of_device(name)[WIRE if name in ROBOT_NAMES else SENSOR_WIRE]
    line = name in ("s3", "jr3-uart", "ft300")
    assert {*faults} >= {*(BYTES if line else DATAGRAMS).faults}
    assert ("reordered" in faults, "malformed" in faults) == (not line, not line)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_built_in_robots_have_all_pose_faults(name: str) -> None:
    without = {"s3": {"nan", "missing"}, "rtde": {"missing"}}.get(name, set())
    faults = faults_of_device(name)["pose"]
    assert {*POSE_FAULTS} - {*faults} == without
    assert all(faults[fault] is POSE_FAULTS[fault] for fault in {*POSE_FAULTS} - without)
    assert "emergency-stop" in faults_of_device(name)["robot"]


@pytest.mark.parametrize("name", [*ROBOT_NAMES, *SENSOR_NAMES])
def test_fault_targets_are_same_for_all_devices(name: str) -> None:
    own = (
        {"robot", "pose", WIRE, "program-wire", "witness"}
        if name in ROBOT_NAMES
        else {"signal", "sensor", SENSOR_WIRE}
    )
    assert {*faults_of_device(name)} <= own


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_built_in_robots_support_all_conform_scenarios(name: str) -> None:
    config = load_config(None, {"robot.emulated": name})
    trial = RobotTrial(config, "", Rules(), lambda: pytest.fail("no client is tried"))
    assert [*trial.mishaps] == [*SCENARIOS]
    assert [name for name, mishap in trial.mishaps.items() if mishap is None] == [NOMINAL]


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_servo_marks_match_its_fields(name: str) -> None:
    servo = Setup(load_config(None, {"robot.emulated": name})).facts.servo
    assert servo is not None
    assert {*servo.marks} == {key for key, value in asdict(servo).items() if key != "marks" and value}
    assert {*servo.marks.values()} <= {*map(str, Mark)}


def test_real_robot_has_mark_of_each_servo_value() -> None:
    servo = ServoFacts(
        0.02, 0.02, 40.0, 1.0, marks={"transport_delay_s": "derived", "damping_ratio": "observed"}
    )
    robot = RobotFacts(servo=servo)
    assert robot.servo_source("transport_delay_s") == "derived, from the profile"
    both = "assumed and observed, from the profile"
    assert robot.servo_source("natural_frequency_rad_s", "damping_ratio") == both
    emulated = replace(robot, emulated=True)
    assert emulated.servo_source("transport_delay_s") == "as configured for the emulated robot"


def test_sensor_with_conflicting_fault_target_is_refused() -> None:
    cell = EmulatedKinds.named("egm", "netft")
    emulation = cell.sensor.emulation
    assert emulation is not None
    faults = {**emulation.faults, WIRE: DATAGRAMS.faults}
    sensor = dataclasses.replace(cell.sensor, emulation=dataclasses.replace(emulation, faults=faults))
    with pytest.raises(ConfigError, match="egm and netft both define faults for the target wire"):
        _ = cell._replace(sensor=sensor).faults


def test_run_help_names_every_built_in_kind() -> None:
    text = " ".join(CliRunner().invoke(cli, ["run", "--help"]).output.split())
    robots = text.partition("--robot URL")[2].partition("--sensor URL")[0].partition("emulated:")[2]
    sensors = text.partition("--sensor URL")[2].partition("--surface")[0].partition("emulated:")[2]
    assert set(ROBOTS.own) <= set(re.findall(r"[\w-]+", robots))
    assert set(SENSORS.own) <= set(re.findall(r"[\w-]+", sensors.replace("- ", "-")))
