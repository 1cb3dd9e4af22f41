"""Tests of our client at the emulated controller of Universal Robots: movements, with stops and faults during them."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest

from emulators.devices.rtde import RTDE_FAULTS, RtdeProfile
from emulators.devices.rtde.connection import Connection
from emulators.devices.rtde.kinematics import USUAL
from protocol.devices.rtde import packets
from protocol.devices.rtde.client import RtdeClient
from protocol.devices.rtde.data_packet import EXPECTED
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import Kind
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.program import INPUT_NAMES
from protocol.devices.rtde.states import Runtime, SafetyMode
from protocol.devices.rtde.wires import CLIENT_PORTS, Port
from protocol.geometry import Pose
from tests.emulation.exact_arm import EXACT
from tests.emulation.rtde_desk import CONTROL, DT, START, Desk, Pair, inputs_of, outputs_of, ready, values_of


def test_client_starts_stream_and_is_answered_each_cycle() -> None:
    pair = ready()
    assert not pair.lost
    assert pair.controller.player.program is not None
    assert pair.fault == ""
    before = len(pair.reports)
    pair.pass_time(0.1)
    assert len(pair.reports) - before == 50
    assert np.diff([report.sequence for report in pair.reports]).tolist() == [1] * (len(pair.reports) - 1)
    assert pair.reports[-1].pose.position == pytest.approx(START.position, abs=1e-9)
    assert pair.reports[-1].received_at - pair.reports[-1].pose_at == pytest.approx(DT)


def test_first_package_precedes_program_without_order() -> None:
    pair = Pair()
    pair.controller.io.inputs = {"input_int_register_24": 1, "input_int_register_25": 9}
    pair.pass_time(0.2)
    recipe = Recipe(1, INPUT_NAMES, EXPECTED[INPUT_NAMES])
    upload = next(number for number, data in enumerate(pair.sent) if data.startswith(b"def hil_bridge"))
    command, sequence = recipe.unpack(pair.sent[upload - 1][3:])[9:]
    assert (command, sequence) == (0, 100_001)
    assert pair.place == pytest.approx(START.position, abs=1e-9)


def test_arm_follows_within_model_lag() -> None:
    pair = ready()
    pair.begin(dx=-0.05)
    pair.pass_time(0.4)
    assert pair.set_point is not None
    lag = pair.place[0] - pair.set_point.position[0]
    assert lag == pytest.approx(0.1 * (0.03 + DT), abs=0.0006)
    pair.end()
    pair.pass_time(0.2)
    stopped_at = pair.place
    assert stopped_at == pytest.approx(pair.set_point.position, abs=3e-5)
    assert pair.controller.io.outputs["output_int_register_24"] == 1
    pair.pass_time(0.5)
    assert pair.place == stopped_at
    assert pair.fault == ""
    pair.begin(dz=-0.01)
    pair.pass_time(0.5)
    assert pair.place[2] == pytest.approx(0.59, abs=2e-5)


def test_silent_client_stops_arm_and_program() -> None:
    pair = ready()
    pair.begin(dx=-0.2)
    pair.pass_time(0.3)
    pair.run(0.2)  # the client's process is gone; its connection stands
    assert pair.controller.player.runtime == Runtime.STOPPED
    assert pair.controller.counts["watchdog stop"] == 1
    stopped_at = pair.place
    pair.run(1.0)
    assert pair.place == stopped_at
    assert 0.0 < START.position[0] - stopped_at[0] < 0.06


def test_missing_targets_make_program_brake() -> None:
    pair = ready()
    pair.begin(dx=-0.2)
    pair.pass_time(0.3)
    writer = pair.client._inputs
    assert writer is not None
    last = pair.sent[-1]
    for _ in range(80):
        pair.run(DT)
        pair.ports[Port.RTDE].send(last)
    assert pair.controller.io.outputs["output_int_register_24"] == 3
    assert pair.controller.player.runtime == Runtime.PLAYING
    pair.exchange()
    assert "no new target for too long" in pair.reports[-1].fault


def test_program_of_other_client_is_reported() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.upload(CONTROL)
    pair.pass_time(0.3)
    assert pair.controller.player.program is not None
    assert pair.controller.player.program.name == "rtde_control"
    assert pair.fault == "our program was stopped, and another one may be playing; begin again"
    stopped_at = pair.place
    pair.pass_time(0.3)
    assert pair.place == stopped_at


def test_farewell_ends_program() -> None:
    pair = ready()
    for piece in pair.client.farewell():
        pair.ports[piece.port].send(piece.data)
    pair.run(0.1)
    assert pair.controller.player.runtime == Runtime.STOPPED
    assert pair.controller.io.outputs["output_int_register_24"] == 5


def test_fault_after_movement_keeps_arm_stationary() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.2)
    pair.end()
    pair.inject("robot", "slider", percent=50.0)
    pair.pass_time(0.01)
    assert struct.unpack(">i", pair.sent[-1][-8:-4])[0] == 0


STOPS = [
    ("robot", "protective-stop", {}, "protective stop; find its cause"),
    ("robot", "emergency-stop", {}, "emergency stop; release the"),
    ("robot", "safeguard-stop", {}, "safeguard stop; close"),
    ("robot", "program-stopped", {}, "our program is stopped"),
    ("robot", "program-paused", {}, "our program is paused"),
    ("robot", "motors-off", {}, "'power off'; power it on"),
    ("robot", "slider", {"percent": 40.0}, "speed slider is at 40 %"),
    ("pose", "nan", {}, "it reports the position (nan, nan, nan)"),
]


@pytest.mark.parametrize(("on", "fault", "values", "message"), STOPS, ids=[stop[1] for stop in STOPS])
def test_stop_is_reported_and_ends_orders(
    on: str, fault: str, values: dict[str, object], message: str
) -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    injection = pair.inject(on, fault, **values)
    pair.pass_time(0.1)
    assert message in pair.fault
    assert "\n" not in pair.fault
    assert injection.struck >= 1
    stopped_at = pair.place
    pair.pass_time(0.3)
    assert pair.place == stopped_at
    command = struct.unpack(">i", pair.sent[-1][-8:-4])[0]
    assert command == 0


# robot_mode, safety_mode, safety_status_bits, robot_status_bits, runtime_state
REPORTED_STOPS = [
    (None, (7, 1, 0x001, 3, 2)),
    ("program-stopped", (7, 1, 0x001, 1, 1)),
    ("program-paused", (7, 1, 0x001, 1, 4)),
    ("protective-stop", (7, 3, 0x404, 1, 4)),
    ("safeguard-stop", (7, 5, 0x410, 1, 4)),
    ("emergency-stop", (3, 7, 0x4C0, 0, 1)),
    ("motors-off", (3, 1, 0x001, 0, 1)),
]


@pytest.mark.parametrize(
    ("fault", "expected"), REPORTED_STOPS, ids=[str(fault) for fault, _ in REPORTED_STOPS]
)
def test_reported_stops_match_specification(fault: str | None, expected: tuple[int, ...]) -> None:
    desk = Desk()
    reader = desk.plug()
    names = ("robot_mode", "safety_mode", "safety_status_bits", "robot_status_bits", "runtime_state")
    displayed = outputs_of(reader, *names)
    reader.ask(packets.encode(Kind.START))
    desk.upload(CONTROL)
    desk.run(0.06)
    if fault is not None:
        desk.inject("robot", fault)
    desk.run(0.01)
    assert tuple(values_of(reader, displayed)[-1].values()) == expected


def test_protective_stop_may_end_program() -> None:
    desk = Desk(replace(EXACT, on_protective_stop="stopped"))
    desk.upload(CONTROL)
    desk.run(0.06)
    desk.inject("robot", "protective-stop")
    assert (desk.controller.player.runtime, desk.controller.player.program) == (Runtime.STOPPED, None)


def test_replayed_program_has_no_old_order() -> None:
    pair = ready()
    board = pair.plug(Port.DASHBOARD)
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.inject("robot", "protective-stop")
    pair.pass_time(5.1)
    stopped_at = pair.place
    assert board.line("unlock protective stop") == "Protective stop releasing"
    assert board.line("play") == "Starting program"
    pair.pass_time(0.5)
    assert pair.controller.player.runtime == Runtime.PLAYING
    assert pair.place == stopped_at
    assert pair.fault == ""


def test_dropped_connections_make_arm_brake() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.inject("wire", "dropped")
    assert pair.ports[Port.RTDE].server.closing
    pair.run(0.3)
    assert pair.controller.player.runtime == Runtime.STOPPED
    assert pair.controller.manipulator.still


def test_mute_robot_ends_movement_within_100_ms() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.inject("wire", "mute", for_s=1.0)
    pair.pass_time(0.098)
    assert not pair.lost
    pair.pass_time(0.006)
    assert "nothing received for 100 ms" in pair.lost[0]


def test_deaf_robot_stops_its_program() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.inject("wire", "deaf")
    pair.pass_time(0.3)
    assert "our program is stopped" in pair.fault


def test_late_and_lost_packets_keep_order_and_numbers() -> None:
    pair = ready()
    pair.inject("wire", "late", ms=20.0, for_s=0.1, way="from")
    pair.inject("wire", "lost", probability=1.0, count=3, way="from")
    count = len(pair.reports)
    pair.pass_time(0.3)
    new = pair.reports[count:]
    assert len(new) == 147
    steps = np.diff([report.sequence for report in pair.reports[count - 1 :]]).tolist()
    assert sorted(steps) == [1] * 146 + [4]


def test_pose_faults_change_reported_pose() -> None:
    pair = ready()
    pair.inject("pose", "offset", z_mm=3.0, for_s=0.1)
    pair.pass_time(0.05)
    assert pair.reports[-1].pose.position[2] == pytest.approx(0.603)
    pair.pass_time(0.1)
    pair.inject("pose", "frozen", for_s=0.5)
    pair.begin(dx=-0.02)
    pair.pass_time(0.4)
    assert pair.reports[-1].pose.position[0] == pytest.approx(0.9)
    assert pair.place[0] == pytest.approx(0.88, abs=1e-4)


def test_every_fault_has_handler() -> None:
    handlers = Desk().robot.handlers
    assert {on: set(faults) for on, faults in RTDE_FAULTS.items()} == {
        on: set(result) for on, result in handlers.items()
    }


@pytest.mark.parametrize(
    ("profile", "act", "message"),
    [
        (replace(EXACT, remote_control=False), None, "switch it to Remote Control"),
        (EXACT, ("robot", "motors-off"), "power it on"),
        (EXACT, ("robot", "protective-stop"), "PROTECTIVE_STOP"),
        (EXACT, ("robot", "in-use"), "another client holds its input registers"),
        (EXACT, ("wire", "mute"), "its dashboard does not respond"),
    ],
)
def test_robot_not_ready_is_reported(profile: RtdeProfile, act: tuple[str, str] | None, message: str) -> None:
    pair = Pair.__new__(Pair)
    Desk.__init__(pair, profile)
    if act is not None:
        pair.inject(*act)
    desk = pair
    fresh = Pair(profile)
    fresh.__dict__.update(robot=desk.robot, controller=desk.controller, ledger=desk.ledger, plugs=[])
    fresh.ports = {port: fresh.plug(port) for port in CLIENT_PORTS}
    fresh.client = RtdeClient(ClientProfile(), fresh.now)
    fresh.pass_time(3.0)
    assert message in fresh.lost[0]
    assert not fresh.reports


def test_robot_without_data_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Connection, "_sends", False)
    pair = Pair(EXACT)
    pair.pass_time(3.0)
    assert "it sends no data" in pair.lost[0]


def test_target_jump_causes_protective_stop() -> None:
    pair = ready(client=ClientProfile(joint_step_rad=0.3))
    pair.begin()
    pair.speed = 1e3
    assert pair.set_point is not None
    x, y, z = pair.set_point.position
    pair.goal = Pose((x - 0.06, y, z), pair.set_point.quaternion)
    pair.pass_time(0.02)
    assert pair.controller.counts["protective stop: a sudden change of the target"] == 1
    assert "protective stop" in pair.fault


def test_target_out_of_reach_is_refused() -> None:
    pair = ready()
    pair.begin()
    pair.speed, pair.goal = 1e9, Pose((5.0, 0.0, 0.5), START.quaternion)
    pair.pass_time(0.1)
    assert next(report.fault for report in pair.reports if report.fault).startswith("no joints near")
    assert pair.place == pytest.approx(START.position, abs=1e-9)
    assert pair.controller.state.safety == SafetyMode.NORMAL


def test_arm_at_end_of_reach_keeps_posture() -> None:
    pair = ready()
    pair.begin(dx=0.4, dz=0.3)
    pair.pass_time(4.0)
    assert next(report.fault for report in pair.reports if report.fault).startswith("no joints near")
    assert pair.controller.state.safety == SafetyMode.NORMAL
    assert max(abs(a - b) for a, b in zip(pair.controller.arm.joints, USUAL, strict=True)) < 2.5
    assert pair.controller.manipulator.still


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_nan_target_causes_protective_stop(bad: float) -> None:
    pair = ready()
    recipe = Recipe(1, INPUT_NAMES, EXPECTED[INPUT_NAMES])
    pair.run(DT)
    pair.ports[Port.RTDE].send(recipe.pack(bad, 0, 0, 0, 3, 0, 0.002, 0.1, 300.0, 1, 5))
    pair.run(DT)
    assert pair.controller.counts["protective stop: a target that is not a number"] == 1


def test_too_fast_tool_causes_protective_stop() -> None:
    desk = Desk()
    client = desk.plug()
    recipe = inputs_of(client, "input_int_register_0", *(f"input_double_register_{n}" for n in range(8)))
    desk.upload(CONTROL)
    desk.run(0.06)
    client.send(recipe.pack(9, 3.3, 0, 0, 0, 0, 0, 40.0, 0.0))
    desk.run(0.3)
    assert [name for name in desk.controller.counts if "fast" in name]
    assert desk.controller.player.runtime == Runtime.PAUSED
