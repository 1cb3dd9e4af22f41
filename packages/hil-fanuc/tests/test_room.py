"""The kind `fanuc` with the commands of hil-bridge."""

import math
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fanuc_desk import START, T0, started
from hil_fanuc.controller import FanucController
from hil_fanuc.describe import describe
from hil_fanuc.packets import (
    CARTESIAN,
    Capability,
    Command,
    Kind,
    Report,
    encode_to_client,
    encode_to_robot,
    nine,
)
from hil_fanuc.profile import FanucProfile
from hil_fanuc.room import ROBOT, check, match
from hil_fanuc.settings import FanucSettings
from hil_fanuc.trajectory import play
from hil_fanuc.wires import parse_address

from emulators.faults import Ledger
from emulators.panel import Panel
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.emulator_fit import RobotFigures
from hil_bridge.devices.kinds import KindSettings
from hil_bridge.devices.trajectory import Trajectory
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import ConfigError, DeviceError
from hil_bridge.testing import RobotCase
from hil_bridge.testing.robot_rig import RobotRig, run_robot

CLIENT = [sys.executable, str(Path(__file__).with_name("client.py")), "{host}", "{port}", "{rmi}"]


# --- conform


@pytest.mark.flaky(reruns=2)  # in real time: a busy machine makes the client late
def test_client_that_keeps_the_rules_passes(hil_conform: Callable[..., Any]) -> None:
    hil_conform("fanuc", CLIENT, start_s=30.0)


@pytest.mark.flaky(reruns=2)
def test_client_with_data_style_0_is_named(hil_conform: Callable[..., Any]) -> None:
    """The incident: joints that the controller reads as a pose."""
    with pytest.raises(pytest.fail.Exception) as failed:
        hil_conform("fanuc", [*CLIENT, "style-0"], start_s=30.0)
    text = str(failed.value)
    assert (
        "violate the protocol, such as data style 0: the joints of the arm are read as the pose X Y Z W P R"
        in text
    )


@pytest.mark.flaky(reruns=2)
def test_client_that_ignores_a_stop_fails(hil_conform: Callable[..., Any]) -> None:
    with pytest.raises(pytest.fail.Exception, match="motion orders after the stop"):
        hil_conform("fanuc", [*CLIENT, "deaf"], "stopped", start_s=30.0)


# --- probe


def probed(act: Callable[[RobotRig], Any] = lambda rig: None) -> tuple[dict[str, str], list[str], RobotRig]:
    results: list[Any] = []

    async def probe(rig: RobotRig) -> None:
        act(rig)
        assert ROBOT.probe is not None
        wiring = Wiring("robot", rig.clock, NullLog())
        results.extend([await ROBOT.probe("udp+memory:fanuc", rig.case.given, wiring), rig])
        await rig.wait(3.0)

    run_robot(RobotCase(ROBOT), probe)
    result, rig = results
    return dict(result.rows), [trouble.fact for trouble in result.refusals], rig


def test_probe_reads_facts_and_changes_nothing() -> None:
    rows, refusals, rig = probed()
    assert refusals == []
    assert rows == {
        "robot": "FANUC, Stream Motion 3, RMI 9.0",
        "sampling period": "8 ms",
        "limits of speed": "120 120 180 180 180 180 °/s",
        "limits of acceleration": "265 265 399 399 399 399 °/s²",
        "limits of jerk": "1240 1240 1860 1860 1860 1860 °/s³",
        "model": "crx-10ia/l",
        "position": "900.0 -100.0 355.0 mm, world",
        "alarm": "No Error",
    }
    assert not rig.robot.server.counts, "no session was begun or ended"
    assert rig.robot.interface.owner is None


def test_probe_reports_why_a_run_would_not_start() -> None:
    def stop(rig: RobotRig) -> None:
        rig.robot.program.press_stop(rig.clock.now())
        rig.robot.program.pendant_on = True

    rows, refusals, _ = probed(stop)
    assert rows["alarm"] == "SRVO-289 Motion stopped by an emergency stop"
    assert refusals == ["its teach pendant is on, or it is not in AUTO", "its servos are off"]


def test_probe_of_a_hanging_server_reads_the_rest() -> None:
    rows, refusals, _ = probed(lambda rig: rig.robot.abort_tasks(rig.clock.now()))
    assert rows["robot"] == "FANUC, RMI 9.0"
    assert rows["position"] == "900.0 -100.0 355.0 mm, world"
    assert refusals == ["it does not answer the capability request over Stream Motion"]


def test_doctor_reads_the_interface_and_leaves_the_stream_alone() -> None:
    results: list[Any] = []

    async def ask(rig: RobotRig) -> None:
        rig.robot.program.press_stop(rig.clock.now())
        rig.robot.abort_tasks(rig.clock.now())
        assert ROBOT.read_side_channel is not None
        results.append(await ROBOT.read_side_channel("udp+memory:fanuc"))
        with pytest.raises(DeviceError, match="its Remote Motion Interface: "):
            await ROBOT.read_side_channel("udp+memory:nobody")

    run_robot(RobotCase(ROBOT), ask)
    assert dict(results[0].rows) == {
        "robot": "FANUC, RMI 9.0",
        "position": "900.0 -100.0 355.0 mm, world",
        "alarm": "SRVO-289 Motion stopped by an emergency stop",
    }
    assert [trouble.fact for trouble in results[0].refusals] == ["its servos are off"]


# --- panel


def test_panel_moves_each_control_and_shows_the_state() -> None:
    desk = started()
    emulation = ROBOT.emulation
    assert emulation is not None
    assert emulation.controls is not None
    panel = Panel(desk.robot, emulation.controls, Ledger(emulation.faults))
    rows = panel.show(desk.now)["rows"]
    assert (rows["stream"], rows["motion"]) == ("version 3, sends reports, ready", "possible")
    panel.perform({"do": "emergency-stop", "to": "press"}, desk.now)
    desk.wait(0.6)
    shown = panel.show(desk.now)
    assert shown["at"] == {"emergency-stop": "press", "pendant": "off"}
    assert shown["rows"]["motion"] == "not possible: SRVO-002 Teach pendant E-stop"
    panel.perform({"do": "emergency-stop", "to": "release"}, desk.now)
    panel.perform({"do": "pendant", "to": "on"}, desk.now)
    assert panel.show(desk.now)["at"] == {"emergency-stop": "release", "pendant": "on"}
    panel.perform({"do": "pendant", "to": "off"}, desk.now)
    panel.perform({"do": "abort-all"}, desk.now)
    assert panel.show(desk.now)["rows"]["motion"] == "not possible: its server of Stream Motion hangs"
    panel.perform({"do": "power"}, desk.now)
    assert panel.show(desk.now)["rows"]["alarms"] == "none"
    desk.begin()


# --- descriptions


def test_packets_are_described() -> None:
    (item,) = describe(encode_to_robot(Command(3, 7, nine((1.0,) * 6), CARTESIAN)))
    assert (item["message"], item["direction"]) == ("command, pose (type 201)", "to robot")
    fields = {field["name"]: field for field in item["fields"]}
    assert fields["data_style"]["value"] == "0, pose"
    assert fields["position"]["unit"] == "mm, °"
    report = Report(3, 1, 0x85, 0.008, nine(()), nine(()), robot_status=5, contact_stop=2)
    (item,) = describe(encode_to_client(report))
    values = {field["name"]: field["value"] for field in item["fields"]}
    assert values["status"] == "ready, system ready; rate 8"
    assert values["robot_status"] == "error, emergency stop"
    assert values["contact_stop"] == "stop"
    (item,) = describe(encode_to_robot(Capability(Kind.GET_CAPABILITY, 3)))
    assert item["direction"] == "to robot"


def test_lines_are_described_with_their_errors() -> None:
    first, second = describe(b'{"Command":"FRC_Reset"}\r\n{"Command":"FRC_Reset","ErrorID":2556940}\r\n')
    assert (first["message"], first["direction"], first["problems"]) == ("FRC_Reset", "to robot", [])
    assert second["offset"] == 25
    assert second["problems"] == ["the controller cannot be reset (2556940)"]


@pytest.mark.parametrize("raw", [b"", b"\x00" * 9, b"{nonsense}\r\n", bytes.fromhex("000000ca")])
def test_anything_else_is_noise(raw: bytes) -> None:
    (item,) = describe(raw) or [{"kind": "noise"}]
    assert item["kind"] == "noise"


# --- settings


def test_models_of_client_and_emulator_must_be_equal() -> None:
    with pytest.raises(ConfigError, match="make them equal"):
        check(KindSettings(FanucSettings(model="m-10ia"), FanucProfile()))


@pytest.mark.parametrize(
    ("url", "stream", "door"),
    [
        ("udp://10.0.0.5", "udp://10.0.0.5:60015", "tcp://10.0.0.5:16001"),
        ("udp://10.0.0.5:60020?rmi=16005", "udp://10.0.0.5:60020", "tcp://10.0.0.5:16005"),
        ("udp+memory:crx", "udp+memory:crx", "memory:crx-rmi-16001"),
    ],
)
def test_address_names_both_channels(url: str, stream: str, door: str) -> None:
    address = parse_address(url)
    assert (address.stream, address.line_url(address.door)) == (stream, door)


@pytest.mark.parametrize("url", ["udp://10.0.0.5?rmi=x", "udp://10.0.0.5?rmi=99999", "tcp://10.0.0.5:1"])
def test_invalid_address_is_refused(url: str) -> None:
    with pytest.raises(ConfigError):
        parse_address(url)


def test_match_returns_the_measured_latency() -> None:
    settings = SimpleNamespace(emulated=FanucProfile())
    sections = match(settings, RobotFigures(servo_s=0.125))
    own: dict[str, Any] = dict(sections["cell.fanuc"])
    delay = own["transport_delay_ms"] * 1e-3 + 2.0 / own["natural_frequency_rad_s"]
    assert delay == pytest.approx(0.125, abs=1e-6)
    assert own["transport_delay_ms"] % 8 == 0


def test_trajectory_is_followed_after_the_delay_of_the_servo() -> None:
    """A sine of 2 mm and 0.5 Hz, which the arm follows 90 ms later: set point to report, and the client's trail."""
    times = tuple(0.008 * k for k in range(375))
    wave = tuple((0.0, 0.0, 0.002 * math.sin(math.pi * time)) for time in times)
    settings = KindSettings(FanucSettings(), FanucProfile())
    robot = FanucController(settings.emulated, START, T0, 7)
    result = play(robot, Trajectory("order_position", times, wave), settings, T0)
    ordered, reached = (np.array(result.columns[name]) for name in ("order_z", "z"))
    lags = [float(np.abs(reached[k:] - ordered[: len(ordered) - k]).max()) for k in range(40)]
    assert 0.07 < 0.008 * int(np.argmin(lags)) < 0.16
    assert min(lags) < 2e-4
