"""Runs with the emulated sensor in virtual time: with every robot, with faults, and over its own settings."""

from typing import Any

import pytest
from hil_schunk.room import SENSOR, split_url

import hil_bridge
from hil_bridge.devices.emulator_fit import SensorFigures
from hil_bridge.devices.kinds import default_settings
from hil_bridge.errors import ConfigError, DeviceError

NEAR = {"start_position_mm": [900.0, -100.0, 593.0], "tool": {"mass_kg": 1.0}}  # just above the surface
SITE: dict[str, Any] = {"sensor": {"emulated": "schunk-fts"}, "run": {"duration_s": 1.0}, "cell": NEAR}


@pytest.mark.parametrize("robot", ["egm", "rsi", "rtde", "s3"])
def test_loop_closes_with_every_robot(robot: str) -> None:
    cell = {} if robot == "rtde" else NEAR
    result = hil_bridge.simulate(SITE | {"robot": {"emulated": robot}, "cell": cell}, seed=7)
    assert result.outcome == "completed", result.text
    if robot != "s3":  # which takes longer to settle
        assert result.figures.force_mean_steady_n == pytest.approx(10.0, abs=0.8)


@pytest.mark.parametrize(
    ("on", "fault", "values", "cause"),
    [
        ("sensor", "unplugged", {}, "saturated"),
        ("sensor", "status", {"bit": 0}, "saturated"),
        ("sensor", "power-cycle", {}, "force-too-old"),
        ("sensor", "taken", {}, "time-is-up"),
        ("sensor", "frozen-counter", {}, "force-too-old"),
        ("sensor-wire", "off", {}, "force-too-old"),
        ("sensor-wire", "lost", {"probability": 0.05}, "time-is-up"),
        ("sensor-wire", "reordered", {"probability": 0.2}, "time-is-up"),
        ("signal", "stuck", {}, "unanswered"),
    ],
)
def test_fault_ends_the_run_or_is_borne(on: str, fault: str, values: dict[str, Any], cause: str) -> None:
    failing = {"on": on, "fault": fault, "phase": "track", "after_s": 0.2, "with": values}
    result = hil_bridge.simulate(SITE | {"robot": {"emulated": "egm"}}, faults=[failing], seed=7)
    assert result.cause is not None
    assert result.cause.value == cause, result.text


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("refusing", "answers the command select filter with error 03"),
        ("short-answers", "no answer to the command read within 2 s"),
        ("status", "it reports: hardware fault"),
    ],
)
def test_faulty_sensor_is_refused_with_the_reason(fault: str, reason: str) -> None:
    failing = {"on": "sensor", "fault": fault, "phase": "connect", "after_s": 0.0}
    with pytest.raises(DeviceError, match=reason):
        hil_bridge.simulate(SITE | {"robot": {"emulated": "egm"}}, faults=[failing], seed=7)


def test_filter_and_tool_of_the_client_reach_the_sensor() -> None:
    sensor = {"emulated": "schunk-fts", "schunk_fts": {"filter": 4, "tool": 2}}
    cell = {**NEAR, "schunk_fts": {"tool_points_mm": [[0, 0, 0], [0, 0, 0], [0, 0, 10], [0, 0, 0]]}}
    result = hil_bridge.simulate(
        SITE | {"robot": {"emulated": "egm"}, "sensor": sensor, "cell": cell}, seed=7
    )
    assert result.outcome == "completed", result.text


@pytest.mark.parametrize(
    ("url", "parts"),
    [
        ("tcp://192.168.0.100:82", ("tcp://192.168.0.100:82", None)),
        ("tcp://h:82?data_port=5000", ("tcp://h:82", 5000)),
        ("tcp://h:82?connect_s=3&data_port=5000", ("tcp://h:82?connect_s=3", 5000)),
    ],
)
def test_url_may_name_the_data_port(url: str, parts: tuple[str, int | None]) -> None:
    assert split_url(url) == parts
    assert SENSOR.parse(url, default_settings(SENSOR)).scheme == "tcp"


@pytest.mark.parametrize(
    ("sensor", "address"), [("h", "0.0.0.0"), ("localhost", "127.0.0.1"), ("127.0.0.1", "127.0.0.1")]
)
def test_measurements_of_a_local_sensor_arrive_on_loopback_only(sensor: str, address: str) -> None:
    assert SENSOR.other_wires is not None
    (wire,) = SENSOR.other_wires(f"tcp://{sensor}:82?data_port=5000", default_settings(SENSOR))
    assert (wire.scheme, wire.host_port) == ("udp-bind", (address, 5000))
    assert wire.options["sender"] == ("127.0.0.1" if sensor == "localhost" else sensor), "no other sender"


def test_measured_noise_becomes_settings_of_the_emulator() -> None:
    assert SENSOR.emulation is not None
    assert SENSOR.emulation.match is not None
    noise = (0.1, 0.2, 0.3, 0.01, 0.02, 0.03)
    sections = SENSOR.emulation.match(default_settings(SENSOR), SensorFigures(noise=noise))
    assert sections == {"cell.schunk_fts": {"noise_n": [0.1, 0.2, 0.3], "noise_nm": [0.01, 0.02, 0.03]}}


@pytest.mark.parametrize(
    "url", ["tcp://h:82?data_port=0", "tcp://h:82?data_port=x", "udp://h:82", "serial:///x"]
)
def test_wrong_url_is_refused(url: str) -> None:
    with pytest.raises(ConfigError):
        SENSOR.parse(url, default_settings(SENSOR))
