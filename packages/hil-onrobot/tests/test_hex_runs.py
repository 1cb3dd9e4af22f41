"""Runs with the emulated sensor in virtual time: with every robot, and with faults."""

from typing import Any

import pytest
from hil_onrobot.room import SENSOR, split_url

import hil_bridge
from hil_bridge.devices.emulator_fit import SensorFigures
from hil_bridge.devices.kinds import default_settings
from hil_bridge.errors import ConfigError, DeviceError

NEAR = {"start_position_mm": [900.0, -100.0, 593.0], "tool": {"mass_kg": 1.0}}  # just above the surface
SITE: dict[str, Any] = {"sensor": {"emulated": "onrobot-hex"}, "run": {"duration_s": 1.0}, "cell": NEAR}


@pytest.mark.parametrize("robot", ["egm", "rsi", "rtde", "s3"])
def test_loop_closes_with_every_robot(robot: str) -> None:
    cell = {} if robot == "rtde" else NEAR
    result = hil_bridge.simulate(SITE | {"robot": {"emulated": robot}, "cell": cell}, seed=7)
    assert result.outcome == "completed", result.text
    if robot != "s3":  # which takes longer to settle
        assert result.figures.force_mean_steady_n == pytest.approx(10.0, abs=1.0)


@pytest.mark.parametrize(
    ("on", "fault", "values", "cause"),
    [
        ("sensor", "unplugged", {}, "saturated"),
        ("sensor", "status", {}, "saturated"),
        ("sensor", "power-cycle", {}, "force-too-old"),
        ("sensor", "taken", {}, "time-is-up"),
        ("sensor", "frozen-counter", {}, "force-too-old"),
        ("sensor", "biased", {}, "left-pressing"),
        ("sensor-wire", "off", {}, "force-too-old"),
        ("sensor-wire", "lost", {"probability": 0.05}, "time-is-up"),
        ("signal", "stuck", {}, "unanswered"),
    ],
)
def test_fault_ends_the_run_or_is_borne(on: str, fault: str, values: dict[str, Any], cause: str) -> None:
    failing = {"on": on, "fault": fault, "phase": "track", "after_s": 0.2, "with": values}
    result = hil_bridge.simulate(SITE | {"robot": {"emulated": "egm"}}, faults=[failing], seed=7)
    assert result.cause is not None
    assert result.cause.value == cause, result.text


@pytest.mark.parametrize(
    ("url", "parts"),
    [
        ("udp://192.168.1.1:49152", ("udp://192.168.1.1:49152", None)),
        ("udp://h:49152?tcp_port=49151", ("udp://h:49152", 49151)),
    ],
)
def test_url_may_name_the_tcp_port(url: str, parts: tuple[str, int | None]) -> None:
    assert split_url(url) == parts
    assert SENSOR.parse(url, default_settings(SENSOR)).scheme == "udp"


def test_measured_noise_becomes_settings_of_the_emulator() -> None:
    """The filter of 150 Hz reduces the noise by the factor of its one pole, 0.66."""
    assert SENSOR.emulation is not None
    assert SENSOR.emulation.match is not None
    noise = (0.1, 0.1, 0.1, 0.01, 0.01, 0.01)
    sections = SENSOR.emulation.match(default_settings(SENSOR), SensorFigures(noise=noise))
    assert sections["cell.onrobot_hex"]["noise_n"] == pytest.approx([0.1509] * 3, rel=1e-3)


def test_scales_are_read_from_the_sensor() -> None:
    """A sensor with half the usual counts per N: its force is right, or the check by the tool's weight refuses it."""
    cell = {**NEAR, "onrobot_hex": {"counts_per_n": 5_000, "counts_per_nm": 50_000}}
    site = SITE | {"robot": {"emulated": "egm"}, "cell": cell}
    assert hil_bridge.simulate(site, seed=7).outcome == "completed"
    deaf = {**SITE["sensor"], "onrobot_hex": {"read_scales": False}}
    with pytest.raises(DeviceError, match="weight"):
        hil_bridge.simulate(site | {"sensor": deaf}, seed=7)


@pytest.mark.parametrize("url", ["udp://h:1?tcp_port=99999", "udp://h:1?tcp_port=x", "tcp://h:1"])
def test_wrong_url_is_refused(url: str) -> None:
    with pytest.raises(ConfigError):
        SENSOR.parse(url, default_settings(SENSOR))
