"""Runs with sensors other than a JR3, in virtual time: force, recording, and ends by faults."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.record import read
from hil_bridge.record.device_facts import devices_of
from tests.near_surface import NEAR_TOML

pytestmark = pytest.mark.sweep

KINDS = ("netft", "ft300", "ft300-urcap", "ati-can")


QUICK = "\n[cell.netft]\nrate_hz = 200\nboot_s = 0.1\n"
"""Settings for runs that do not test the rate of a Net F/T."""


def run(*arguments: str) -> str:
    result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture
def run_sensor(tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Run with a sensor and a configuration; return the summary, with `error` if the run ended with one."""

    def go(kind: str, configuration: str = "", duration: str = "2", *more: str) -> dict[str, Any]:
        file, record, summary_file = tmp_path / "c.toml", tmp_path / f"{kind}.mcap", tmp_path / "s.json"
        quick = "" if kind != "netft" or "[cell.netft]" in configuration else QUICK
        near = "" if "[cell.surface]" in configuration else NEAR_TOML
        file.write_text(near + configuration + quick)
        arguments = (
            *("run", str(file), "--virtual", "--no-view", "--sensor", kind, "--duration", duration),
            *("--record", str(record), "--summary", str(summary_file), "--overwrite", *more),
        )
        error = ""
        try:
            result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
        except BridgeError as raised:
            error, code = str(raised), raised.exit_code
        else:
            code, error = result.exit_code, result.stderr
        summary: dict[str, Any] = json.loads(summary_file.read_text()) if summary_file.exists() else {}
        return {**summary, "error": error, "code": code, "record": record}

    return go


RunSensor = Callable[..., dict[str, Any]]


def fault(on: str, name: str, *parameters: str, phase: str = "track", after_s: float = 0.5) -> str:
    durations = "".join(f"{one}\n" for one in parameters if one.startswith("for_s"))
    options = ", ".join(one for one in parameters if not one.startswith("for_s"))
    options = durations + (f"with = {{{options}}}\n" if options else "")
    return f'[[faults]]\non = "{on}"\nfault = "{name}"\nphase = "{phase}"\nafter_s = {after_s}\n{options}'


@pytest.mark.parametrize("kind", KINDS)
def test_sensor_run_holds_force_and_records_facts(kind: str, run_sensor: RunSensor) -> None:
    usual = "[cell.netft]\nboot_s = 5.0\n" if kind == "netft" else ""
    summary = run_sensor(kind, usual, duration="8")
    assert (summary["code"], summary["outcome"]) == (0, "completed")
    assert summary["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    sensor = devices_of(read(summary["record"])).sensor
    assert sensor.kind == kind
    assert sensor.facts is not None
    assert sensor.facts.tares == "host"
    record = str(summary["record"])
    assert "every command identical" in run("replay", record)
    assert "way of the sample from the sensor to its arrival" in run("latency", record)


@pytest.mark.parametrize("kind", KINDS)
def test_sensor_runs_with_same_seed_are_identical(kind: str, run_sensor: RunSensor) -> None:
    first = run_sensor(kind, duration="0.5")["record"].read_bytes()
    assert run_sensor(kind, duration="0.5")["record"].read_bytes() == first
    assert run_sensor(kind, "", "0.5", "--seed", "8")["record"].read_bytes() != first


CONTOUR = """
[cell.surface]
kind = "sinusoidal"
amplitude_mm = 3.0
period_mm = 100.0
"""


@pytest.mark.parametrize("kind", KINDS)
def test_sensor_run_follows_contour(kind: str, run_sensor: RunSensor) -> None:
    summary = run_sensor(kind, CONTOUR, duration="5")
    assert summary["outcome"] == "completed"
    heights = [truth.position[2] for truth in read(summary["record"]).truths]
    assert max(heights[-25:]) - min(heights[-25:]) > 1e-3


ENDS: Sequence[tuple[str, str, str, tuple[str, ...], bool]] = (
    ("netft", "sensor", "unplugged", (), True),
    ("netft", "sensor", "status", ("bit = 8",), True),
    ("netft", "sensor", "saturated", (), True),
    ("netft", "sensor-wire", "off", (), False),
    ("netft", "sensor", "frozen-counter", (), False),
    ("netft", "sensor", "power-cycle", (), False),
    ("ft300", "sensor", "unplugged", (), False),
    ("ft300", "sensor-wire", "off", (), False),
    ("ft300", "sensor", "power-cycle", (), False),
    ("ft300-urcap", "sensor", "unplugged", (), False),
    ("ft300-urcap", "sensor-wire", "off", (), False),
    ("ft300-urcap", "sensor", "power-cycle", (), False),
    ("ati-can", "sensor", "unplugged", (), True),
    ("ati-can", "sensor", "status", ("bit = 5",), True),
    ("ati-can", "sensor", "watchdog", (), False),
    ("ati-can", "sensor", "other-host", (), False),
    ("ati-can", "sensor", "power-cycle", (), False),
    ("ati-can", "bus", "off", ("for_s = 1.0",), False),
)
"""Kind, fault, its parameters, and whether the tool retracts; otherwise it stops."""


def true_force(summary: dict[str, Any]) -> float:
    return max(abs(part) for part in read(summary["record"]).truths[-1].force)


@pytest.mark.parametrize(("kind", "on", "name", "parameters", "retracts"), ENDS)
def test_lost_sensor_ends_run(
    kind: str, on: str, name: str, parameters: tuple[str, ...], retracts: bool, run_sensor: RunSensor
) -> None:
    summary = run_sensor(kind, fault(on, name, *parameters), duration="5")
    assert summary["code"] == 3
    assert summary["outcome"] == "stopped"
    assert summary["error"].count("hil-bridge: ") == 1
    assert true_force(summary) == 0.0 if retracts else true_force(summary) < 11.0


SIGNALS: Sequence[tuple[str, tuple[str, ...]]] = (
    ("stuck", ()),
    ("offset", ('axis = "fz"', "amount = -60.0")),
    ("spike", ('axis = "fz"', "amount = -200.0", "for_s = 0.02")),  # longer than any sensor's frame
)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("name", "parameters"), SIGNALS)
def test_signal_fault_ends_run_with_any_sensor(
    kind: str, name: str, parameters: tuple[str, ...], run_sensor: RunSensor
) -> None:
    summary = run_sensor(kind, fault("signal", name, *parameters), duration="8")
    assert summary["code"] == 3, summary
    assert true_force(summary) < 11.0


@pytest.mark.parametrize("kind", KINDS)
def test_sensor_unsupported_fault_is_refused(kind: str, run_sensor: RunSensor) -> None:
    assert "known: " in run_sensor(kind, fault("sensor-wire", "sleepy"))["error"]
    refused = run_sensor("jr3", fault("sensor", "power-cycle"))["error"]
    assert "power-cycle needs sensor.emulated = ati-can or ft300 or ft300-urcap or netft, not jr3" in refused


STREAMS = "[run]\nperiod_ms = 20\n[controller]\nsample_ms = 20\n"


@pytest.mark.parametrize(("robot", "kind"), [("egm", "netft"), ("rtde", "ft300"), ("rsi", "ati-can")])
def test_sensors_work_with_all_robots(robot: str, kind: str, run_sensor: RunSensor) -> None:
    lost = fault(*(("sensor-wire", "off") if kind == "ft300" else ("sensor", "unplugged")), after_s=0.3)
    summary = run_sensor(kind, STREAMS + lost, "3", "--robot", robot)
    assert (summary["code"], summary["outcome"]) == (3, "stopped")
    assert true_force(summary) < 11.0
    assert max(abs(cycle.force) for cycle in read(summary["record"]).cycles) > 3.0


# --- Net F/T


def test_netft_disabled_transfer_ends_run_with_reason(run_sensor: RunSensor) -> None:
    summary = run_sensor("netft", "[cell.netft]\nrdt_enabled = false\n")
    assert summary["code"] == 3
    assert "is switched off; enable it on its page" in summary["error"]


@pytest.mark.full
def test_netft_fast_stream_does_not_delay_run(run_sensor: RunSensor) -> None:
    summary = run_sensor("netft", "[cell.netft]\nrate_hz = 3500\nboot_s = 0.1\n", duration="0.3")
    assert summary["outcome"] == "completed"
    recording = read(summary["record"])
    assert len(recording.sensors) > 5_000
    # The force is paired with the position of the past, which 256 frames of this stream would not reach.
    paired = [cycle.sample.paired_force for cycle in recording.cycles if cycle.sample is not None]
    assert len(paired) > 10
    assert None not in paired


def test_netft_threshold_is_reported_only(run_sensor: RunSensor) -> None:
    summary = run_sensor("netft", fault("sensor", "threshold", after_s=0.2), "0.5")
    assert summary["outcome"] == "completed"
    assert any("threshold passed" in event.text for event in read(summary["record"]).events)


def test_netft_stolen_stream_is_requested_again(run_sensor: RunSensor) -> None:
    summary = run_sensor("netft", fault("sensor", "taken", after_s=0.2), "0.5")
    assert any("requested again" in event.text for event in read(summary["record"]).events)


@pytest.mark.parametrize("option", ["http_port=x", "http_port=70000", "http_port=1&http_port=2"])
def test_netft_invalid_port_is_refused(option: str) -> None:
    with pytest.raises(ConfigError, match=r"http_port must be a port|'http_port' is given twice"):
        run(
            "run",
            "--no-view",
            "--no-record",
            "--tool-mass-kg",
            "0.5",
            "--sensor",
            f"netft+udp://127.0.0.1:49152?{option}",
        )


# --- FT 300


def test_ft300_can_be_polled(run_sensor: RunSensor) -> None:
    summary = run_sensor("ft300", '[sensor.ft300]\nmode = "modbus"\n', duration="3")
    assert summary["outcome"] == "completed"
    sensor = devices_of(read(summary["record"])).sensor
    assert sensor.facts is not None
    assert sensor.facts.period is None


def test_ft300_force_above_rating_is_invalid(run_sensor: RunSensor) -> None:
    summary = run_sensor("ft300", fault("signal", "offset", 'axis = "fx"', "amount = 320.0"), duration="5")
    assert summary["code"] == 3
    assert true_force(summary) == 0.0


def test_ft300_refused_requests_end_run_with_reason(run_sensor: RunSensor) -> None:
    summary = run_sensor("ft300", fault("sensor", "refuses", phase="connect", after_s=0.0))
    assert summary["code"] == 3
    assert "it refuses a request: device failure (4)" in summary["error"]


# --- NETCANOEM


def test_ati_can_missing_calibration_ends_run_with_reason(run_sensor: RunSensor) -> None:
    summary = run_sensor("ati-can", "[sensor.ati_can]\nslot = 4\n")
    assert summary["code"] == 3
    assert "status 8040: bad calibration" in summary["error"]


def test_bus_fault_without_bus_is_refused(run_sensor: RunSensor) -> None:
    assert (
        "needs sensor.emulated = ati-can or jr3, not netft"
        in run_sensor("netft", fault("bus", "off"))["error"]
    )


@pytest.mark.full
def test_ati_can_gage_offset_needs_identified_bias(run_sensor: RunSensor, tmp_path: Path) -> None:
    offset = "[cell.ati_can]\noffset_gages = 400\n"
    assert "the tool's weight is" in run_sensor("ati-can", offset)["error"]
    file, result = tmp_path / "off.toml", tmp_path / "tool.toml"
    file.write_text(f'[sensor]\nemulated = "ati-can"\n{offset}')
    run("identify", "tool", str(file), "--virtual", "-o", str(result))
    assert run_sensor("ati-can", result.read_text() + offset)["outcome"] == "completed"
