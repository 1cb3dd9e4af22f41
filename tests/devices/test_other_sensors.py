"""Runs with sensors other than a JR3, in virtual time: the loop, its record, and the ways in which it must end."""

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
"""For runs that are not about the rate of a Net F/T's records."""


def run(*arguments: str) -> str:
    result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture
def tried(tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Run with a sensor and a configuration; the summary, with `error` where the run ended with one."""

    def go(kind: str, configuration: str = "", duration: str = "2", *more: str) -> dict[str, Any]:
        file, record, told = tmp_path / "c.toml", tmp_path / f"{kind}.mcap", tmp_path / "s.json"
        quick = "" if kind != "netft" or "[cell.netft]" in configuration else QUICK
        near = "" if "[cell.surface]" in configuration else NEAR_TOML
        file.write_text(near + configuration + quick)
        arguments = (
            *("run", str(file), "--virtual", "--no-view", "--sensor", kind, "--duration", duration),
            *("--record", str(record), "--summary", str(told), "--overwrite", *more),
        )
        error = ""
        try:
            result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
        except BridgeError as raised:
            error, code = str(raised), raised.exit_code
        else:
            code, error = result.exit_code, result.stderr
        summary: dict[str, Any] = json.loads(told.read_text()) if told.exists() else {}
        return {**summary, "error": error, "code": code, "record": record}

    return go


Try = Callable[..., dict[str, Any]]


def fault(on: str, name: str, *parameters: str, phase: str = "track", after_s: float = 0.5) -> str:
    lasts = "".join(f"{one}\n" for one in parameters if one.startswith("for_s"))
    given = ", ".join(one for one in parameters if not one.startswith("for_s"))
    given = lasts + (f"with = {{{given}}}\n" if given else "")
    return f'[[faults]]\non = "{on}"\nfault = "{name}"\nphase = "{phase}"\nafter_s = {after_s}\n{given}'


@pytest.mark.parametrize("kind", KINDS)
def test_the_loop_closes_and_the_record_tells_the_sensor(kind: str, tried: Try) -> None:
    usual = "[cell.netft]\nboot_s = 5.0\n" if kind == "netft" else ""
    told = tried(kind, usual, duration="8")
    assert (told["code"], told["outcome"]) == (0, "completed")
    assert told["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    sensor = devices_of(read(told["record"])).sensor
    assert sensor.kind == kind
    assert sensor.facts is not None
    assert sensor.facts.tares == "host"
    record = str(told["record"])
    assert "every command identical" in run("replay", record)
    assert "way of the sample from the sensor to its arrival" in run("latency", record)


@pytest.mark.parametrize("kind", KINDS)
def test_two_runs_with_one_seed_are_the_same_bytes(kind: str, tried: Try) -> None:
    first = tried(kind, duration="0.5")["record"].read_bytes()
    assert tried(kind, duration="0.5")["record"].read_bytes() == first
    assert tried(kind, "", "0.5", "--seed", "8")["record"].read_bytes() != first


CONTOUR = """
[cell.surface]
kind = "sinusoidal"
amplitude_mm = 3.0
period_mm = 100.0
"""


@pytest.mark.parametrize("kind", KINDS)
def test_a_contour_is_followed(kind: str, tried: Try) -> None:
    told = tried(kind, CONTOUR, duration="5")
    assert told["outcome"] == "completed"
    heights = [truth.position[2] for truth in read(told["record"]).truths]
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
"""Kind, fault, its parameters, and whether the tool is lifted; otherwise it stands still."""


def true_force(told: dict[str, Any]) -> float:
    return max(abs(part) for part in read(told["record"]).truths[-1].force)


@pytest.mark.parametrize(("kind", "on", "name", "parameters", "lifted"), ENDS)
def test_a_sensor_that_is_lost_ends_the_run(
    kind: str, on: str, name: str, parameters: tuple[str, ...], lifted: bool, tried: Try
) -> None:
    told = tried(kind, fault(on, name, *parameters), duration="5")
    assert told["code"] == 3
    assert told["outcome"] == "stopped"
    assert told["error"].count("hil-bridge: ") == 1
    assert true_force(told) == 0.0 if lifted else true_force(told) < 11.0


SIGNALS: Sequence[tuple[str, tuple[str, ...]]] = (
    ("stuck", ()),
    ("offset", ('axis = "fz"', "amount = -60.0")),
    ("spike", ('axis = "fz"', "amount = -200.0", "for_s = 0.02")),  # longer than any sensor's frame
)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("name", "parameters"), SIGNALS)
def test_a_signal_that_goes_wrong_ends_a_run_with_any_sensor(
    kind: str, name: str, parameters: tuple[str, ...], tried: Try
) -> None:
    told = tried(kind, fault("signal", name, *parameters), duration="8")
    assert told["code"] == 3, told
    assert true_force(told) < 11.0


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_that_a_sensor_cannot_have_is_refused_at_once(kind: str, tried: Try) -> None:
    assert "it can have" in tried(kind, fault("sensor-wire", "sleepy"))["error"]
    refused = tried("jr3", fault("sensor", "power-cycle"))["error"]
    assert "power-cycle needs sensor.emulated = ati-can or ft300 or ft300-urcap or netft, not jr3" in refused


STREAMS = "[run]\nperiod_ms = 20\n[controller]\nsample_ms = 20\n"


@pytest.mark.parametrize(("robot", "kind"), [("egm", "netft"), ("rtde", "ft300"), ("rsi", "ati-can")])
def test_other_sensors_go_with_other_robots(robot: str, kind: str, tried: Try) -> None:
    lost = fault(*(("sensor-wire", "off") if kind == "ft300" else ("sensor", "unplugged")), after_s=0.3)
    told = tried(kind, STREAMS + lost, "3", "--robot", robot)
    assert (told["code"], told["outcome"]) == (3, "stopped")
    assert true_force(told) < 11.0
    assert max(abs(cycle.force) for cycle in read(told["record"]).cycles) > 3.0


# --- Net F/T


def test_a_box_whose_transfer_is_switched_off_ends_the_run_with_words(tried: Try) -> None:
    told = tried("netft", "[cell.netft]\nrdt_enabled = false\n")
    assert told["code"] == 3
    assert "is switched off; enable it on its page" in told["error"]


@pytest.mark.full
def test_a_quick_stream_does_not_drown_the_run(tried: Try) -> None:
    told = tried("netft", "[cell.netft]\nrate_hz = 3500\nboot_s = 0.1\n", duration="0.3")
    assert told["outcome"] == "completed"
    recording = read(told["record"])
    assert len(recording.sensors) > 5_000
    # The force is paired with the position of the past, which 256 frames of this stream would not reach.
    paired = [cycle.sample.paired_force for cycle in recording.cycles if cycle.sample is not None]
    assert len(paired) > 10
    assert None not in paired


def test_a_threshold_is_told_and_ends_nothing(tried: Try) -> None:
    told = tried("netft", fault("sensor", "threshold", after_s=0.2), "0.5")
    assert told["outcome"] == "completed"
    assert any("threshold passed" in event.text for event in read(told["record"]).events)


def test_a_stream_that_another_program_took_is_asked_for_again(tried: Try) -> None:
    told = tried("netft", fault("sensor", "taken", after_s=0.2), "0.5")
    assert any("asked again" in event.text for event in read(told["record"]).events)


@pytest.mark.parametrize("option", ["http_port=x", "http_port=70000", "http_port=1&http_port=2"])
def test_a_port_that_is_none_is_refused(option: str) -> None:
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


def test_an_ft300_may_be_asked_question_by_question(tried: Try) -> None:
    told = tried("ft300", '[sensor.ft300]\nmode = "modbus"\n', duration="3")
    assert told["outcome"] == "completed"
    sensor = devices_of(read(told["record"])).sensor
    assert sensor.facts is not None
    assert sensor.facts.period is None


def test_a_force_beyond_the_rating_is_no_value(tried: Try) -> None:
    told = tried("ft300", fault("signal", "offset", 'axis = "fx"', "amount = 320.0"), duration="5")
    assert told["code"] == 3
    assert true_force(told) == 0.0


def test_a_sensor_that_refuses_questions_ends_the_run_with_words(tried: Try) -> None:
    told = tried("ft300", fault("sensor", "refuses", phase="connect", after_s=0.0))
    assert told["code"] == 3
    assert "it refuses a question: device failure (4)" in told["error"]


# --- NETCANOEM


def test_a_calibration_that_is_not_there_ends_the_run_with_words(tried: Try) -> None:
    told = tried("ati-can", "[sensor.ati_can]\nslot = 4\n")
    assert told["code"] == 3
    assert "status 8040: bad calibration" in told["error"]


def test_bus_faults_are_refused_for_a_sensor_without_a_bus(tried: Try) -> None:
    assert "needs sensor.emulated = ati-can or jr3, not netft" in tried("netft", fault("bus", "off"))["error"]


@pytest.mark.full
def test_gages_that_are_off_without_a_load_need_the_bias_that_is_identified(
    tried: Try, tmp_path: Path
) -> None:
    off = "[cell.ati_can]\noffset_gages = 400\n"
    assert "the tool's weight is" in tried("ati-can", off)["error"]
    file, found = tmp_path / "off.toml", tmp_path / "tool.toml"
    file.write_text(f'[sensor]\nemulated = "ati-can"\n{off}')
    run("identify", "tool", str(file), "--virtual", "-o", str(found))
    assert tried("ati-can", found.read_text() + off)["outcome"] == "completed"
