"""The kinds `xarm` with the commands of hil-bridge: runs, faults, conform, probe, panel and descriptions."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hil_xarm.describe import describe
from hil_xarm.faults import FORCE_FAULTS
from hil_xarm.force_room import SENSOR
from hil_xarm.force_room import match as match_sensor
from hil_xarm.frames import Function, Reply, Request, pack_floats
from hil_xarm.reports import NORMAL, REAL
from hil_xarm.room import ROBOT
from hil_xarm.room import match as match_robot
from hil_xarm.wires import parse_address
from xarm_desk import START, Desk

import hil_bridge
from emulators.faults import Ledger
from emulators.panel import Panel
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.emulator_fit import RobotFigures, SensorFigures
from hil_bridge.devices.kinds import default_settings
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.testing import RobotCase
from hil_bridge.testing.robot_rig import RobotRig, run_robot

CLIENT = [sys.executable, str(Path(__file__).with_name("client.py")), "{host}", "{port}", "{real}"]
NEAR = {"start_position_mm": [400.0, -100.0, 193.0]}
SITE: dict[str, Any] = {
    "robot": {"emulated": "xarm"},
    "sensor": {"emulated": "xarm-force"},
    "run": {"duration_s": 1.0},
    "cell": NEAR,
}


# --- runs


@pytest.mark.parametrize("sensor", ["xarm-force", "jr3", "netft", "ft300", "ft300-urcap", "ati-can"])
def test_loop_closes_with_every_sensor(sensor: str) -> None:
    result = hil_bridge.simulate(SITE | {"sensor": {"emulated": sensor}}, seed=7)
    assert result.outcome == "completed", result.text
    assert result.figures.force_mean_steady_n == pytest.approx(10.0, abs=0.8)


@pytest.mark.parametrize("robot", ["egm", "rsi", "s3"])
def test_loop_closes_with_every_robot(robot: str) -> None:
    near = {"start_position_mm": [900.0, -100.0, 593.0]}
    result = hil_bridge.simulate(SITE | {"robot": {"emulated": robot}, "cell": near}, seed=7)
    assert result.outcome == "completed", result.text


def test_external_values_close_the_loop_too() -> None:
    sensor = {"emulated": "xarm-force", "xarm": {"external": True}}
    result = hil_bridge.simulate(SITE | {"sensor": sensor}, seed=7)
    assert result.outcome == "completed", result.text


@pytest.mark.parametrize(
    ("on", "fault", "values", "cause"),
    [
        ("robot", "emergency-stop", {}, "robot-state"),
        ("robot", "speed-error", {}, "robot-state"),
        ("robot", "collision", {}, "robot-state"),
        ("robot", "mode-changed", {}, "robot-state"),
        ("robot", "paused", {}, "robot-state"),
        ("robot", "power-cycle", {}, "robot-state"),
        ("robot", "mute", {}, "dead-link"),
        ("robot", "stalls", {"probability": 0.05}, "off-path"),
        ("wire", "off", {}, "dead-link"),
        ("sensor", "lost", {}, "robot-state"),
        ("sensor", "switched-off", {}, "sensor-failed"),
        ("sensor", "saturated", {}, "force"),
        ("sensor-wire", "off", {}, "force-too-old"),
        ("signal", "stuck", {}, "unanswered"),
    ],
)
def test_fault_ends_the_run_or_is_borne(on: str, fault: str, values: dict[str, Any], cause: str) -> None:
    failing = {"on": on, "fault": fault, "phase": "track", "after_s": 0.2, "with": values}
    result = hil_bridge.simulate(SITE, faults=[failing], seed=7)
    assert result.cause is not None
    assert result.cause.value == cause, result.text


# --- conform


@pytest.mark.flaky(reruns=2)  # in real time: a busy machine makes the client late
def test_client_that_keeps_the_rules_passes(hil_conform: Callable[..., Any]) -> None:
    hil_conform("xarm", CLIENT, start_s=30.0)


@pytest.mark.flaky(reruns=2)
@pytest.mark.parametrize(
    ("mode", "scenario", "reason"),
    [
        # a leap is measured from the tool if that is nearer, and the tool moves in real time
        ("leaps", "nominal", r"1 of its orders leap, by up to (59\.\d|60\.0) mm"),
        ("deaf", "stopped", "motion orders after the stop"),
        ("clears", "stopped", "released the stop without an operator: clear error"),
    ],
)
def test_client_that_breaks_a_rule_fails(
    mode: str, scenario: str, reason: str, hil_conform: Callable[..., Any]
) -> None:
    with pytest.raises(pytest.fail.Exception, match=reason):
        hil_conform("xarm", [*CLIENT, mode], scenario, start_s=30.0)


# --- probe


def probed(act: Callable[[RobotRig], Any] = lambda rig: None) -> tuple[dict[str, str], list[str], RobotRig]:
    results: list[Any] = []

    async def probe(rig: RobotRig) -> None:
        act(rig)
        assert ROBOT.probe is not None
        wiring = Wiring("robot", rig.clock, NullLog())
        results.extend([await ROBOT.probe("memory:xarm", rig.case.given, wiring), rig])

    run_robot(RobotCase(ROBOT, start=START), probe)
    result, rig = results
    return dict(result.rows), [trouble.fact for trouble in result.refusals], rig


def test_probe_reads_facts_and_changes_nothing() -> None:
    rows, refusals, rig = probed()
    assert rows == {
        "robot": "UFACTORY, 6 axes, type 6",
        "serial": "XI0000EMULATED",
        "firmware": "v2.5.0",
        "rate": "100 Hz; 100 Hz by its settings",
        "position": "400.0 -100.0 200.0 mm",
        "state": "ready",
    }
    assert refusals == []
    assert not rig.robot.box.is_enabled


def test_probe_reports_the_error_of_the_box() -> None:
    _, refusals, _ = probed(lambda rig: rig.robot.box.fail(31))
    assert refusals == ["the robot cannot move: it reports error 31, collision"]


# --- panel


def test_panel_moves_each_control_and_shows_the_state() -> None:
    desk = Desk()
    desk.prepare()
    emulation = ROBOT.emulation
    assert emulation is not None
    assert emulation.controls is not None
    panel = Panel(desk.robot, emulation.controls, Ledger(emulation.faults))
    rows = panel.show(desk.now)["rows"]
    assert (rows["mode"], rows["state"], rows["motion"]) == ("servo", "asleep", "possible")
    panel.perform({"do": "emergency-stop", "to": "press"}, desk.now)
    shown = panel.show(desk.now)
    assert shown["at"] == {"emergency-stop": "press"}
    assert shown["rows"]["motion"] == "not possible: error 1, the emergency stop button is pressed"
    panel.perform({"do": "emergency-stop", "to": "release"}, desk.now)
    panel.perform({"do": "power"}, desk.now)
    rows = panel.show(desk.now)["rows"]
    assert (rows["error"], rows["motors"], rows["state"]) == ("none", "off", "stopped")


# --- descriptions


def test_frames_of_both_directions_are_described() -> None:
    servo = Request(
        13, 3, Function.SERVO_POSE, pack_floats(400.0, -100.0, 200.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    first, second = describe(servo.encode() + Reply(13, 3, Function.SERVO_POSE, 0x50).encode())
    assert (first["message"], first["direction"]) == ("servo pose", "to robot")
    assert first["fields"][1]["value"] == [400.0, -100.0, 200.0, 0.0, 0.0, 0.0]
    assert (second["message"], second["direction"]) == ("reply to servo pose", "from robot")
    assert second["problems"] == ["error"]
    (ready,) = describe(Reply(3, 2, Function.SET_MODE, 0x10).encode())
    assert (ready["message"], ready["fields"][1]["value"]) == ("reply to set mode", "not ready")
    (either,) = describe(Request(3, 2, Function.SET_STATE, b"\0").encode())
    assert (either["message"], either["direction"]) == ("set state, or its reply", "")
    (error,) = describe(Reply(2, 2, Function.ERROR, 0x40, bytes((60, 0))).encode())
    assert error["problems"] == ["error", "error 60, speed of the tool beyond the limit in servo mode"]


def test_reports_are_described_by_their_size() -> None:
    (item,) = describe(REAL.encode({"raw": (1.0,) * 6}))
    assert item["message"] == "real report"
    assert {"name": "raw", "value": [1.0] * 6, "unit": "N, N·m"} in item["fields"]
    first, second = describe(NORMAL.encode({"error": (31,)}) * 2)
    assert (first["problems"], second["offset"]) == (["error 31, collision"], 145)


@pytest.mark.parametrize("raw", [b"", b"\xff" * 9, b"\0\0\0\x87", bytes(5)])
def test_anything_else_is_noise(raw: bytes) -> None:
    assert all(item["kind"] == "noise" for item in describe(raw))


# --- settings


@pytest.mark.parametrize(
    ("url", "command", "real"),
    [
        ("tcp://10.0.0.5", "tcp://10.0.0.5:502", "tcp://10.0.0.5:30003"),
        ("tcp://10.0.0.5:1502?real=1503", "tcp://10.0.0.5:1502", "tcp://10.0.0.5:1503"),
        ("tcp://[::1]:502", "tcp://[::1]:502", "tcp://[::1]:30003"),
        ("memory:arm?latency_ms=1", "memory:arm?latency_ms=1", "memory:arm-real?latency_ms=1"),
    ],
)
def test_address_names_both_ports(url: str, command: str, real: str) -> None:
    address = parse_address(url)
    assert (address.command.text, address.real) == (command, real)


@pytest.mark.parametrize("url", ["tcp://10.0.0.5?real=x", "tcp://10.0.0.5?real=99999", "udp://10.0.0.5:1"])
def test_invalid_address_is_refused(url: str) -> None:
    for kind in (ROBOT, SENSOR):
        with pytest.raises(ConfigError):
            kind.parse(url, default_settings(kind))


def test_match_returns_the_measured_latency_and_noise() -> None:
    settings = default_settings(ROBOT)
    own: dict[str, Any] = dict(match_robot(settings, RobotFigures(servo_s=0.08))["cell.xarm"])
    delay = own["transport_delay_ms"] * 1e-3 + 2.0 / own["natural_frequency_rad_s"]
    assert delay == pytest.approx(0.08, abs=1e-6)
    noise = (0.1, 0.2, 0.3, 0.01, 0.02, 0.03)
    sections = match_sensor(settings, SensorFigures(noise=noise))
    assert sections == {"cell.xarm": {"noise_n": [0.1, 0.2, 0.3], "noise_nm": [0.01, 0.02, 0.03]}}


def test_targets_of_robot_and_sensor_differ() -> None:
    assert ROBOT.emulation is not None
    assert not ROBOT.emulation.faults.keys() & FORCE_FAULTS.keys()
