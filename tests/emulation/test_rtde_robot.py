"""Tests of the emulated controller of Universal Robots at its ports, without a wire: packets, dashboard, scripts,
cables.
"""

import math
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.rtde import RtdeRobot
from emulators.devices.rtde.robot import CLIENTS_MAX
from protocol.devices.rtde import packets
from protocol.devices.rtde.data_packet import EXPECTED, OUTPUT_NAMES
from protocol.devices.rtde.packets import Kind, Packet, Types
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.program import INPUT_NAMES, program_text
from protocol.devices.rtde.states import RobotMode, Runtime, SafetyMode
from protocol.devices.rtde.wires import Port
from tests.emulation.exact_arm import EXACT
from tests.emulation.rtde_desk import DT, START, T0, Desk, Pair, inputs_of, outputs_of, values_of

# --- packets


def test_version_requests_are_answered() -> None:
    plug = Desk().plug()
    assert plug.ask(packets.version_request(2)) == Packet(Kind.VERSION, b"\x01")
    assert plug.ask(packets.version_request(1)) == Packet(Kind.VERSION, b"\x01")
    for unknown in (0, 3):
        assert plug.ask(packets.version_request(unknown)) == Packet(Kind.VERSION, b"\x00")
    answer = plug.ask(packets.encode(Kind.CONTROLLER_VERSION))
    assert packets.read_controller_version(answer.payload) == (5, 12, 0, 0)


@pytest.mark.parametrize("version", [None, 1])
def test_version_1_has_no_rate_and_no_output_recipe(version: int | None) -> None:
    desk = Desk()
    plug = desk.plug(version=version)
    assert plug.ask(packets.encode(Kind.OUTPUTS, b"timestamp,robot_mode")) == Packet(
        Kind.OUTPUTS, b"DOUBLE,INT32"
    )
    assert inputs_of(plug, "input_int_register_0").number == 1
    assert plug.ask(packets.encode(Kind.START)) == Packet(Kind.START, b"\x01")
    desk.run(0.01)
    data = [packet.payload for packet in plug.packets() if packet.kind == Kind.DATA]
    assert len(data) == 5  # each cycle
    stamp, mode = struct.unpack(">di", data[-1])
    assert (stamp, mode) == (pytest.approx(100.008), RobotMode.RUNNING)
    plug.send(b"\x00\x05\xff\r\n")
    (text,) = [packet.payload for packet in plug.packets() if packet.kind == Kind.TEXT]
    assert text == b"\x01unknown type of packet 255"


def test_unknown_output_prevents_recipe_and_start() -> None:
    desk = Desk()
    plug = desk.plug()
    answer = plug.ask(packets.outputs_request(("timestamp", "nonsense"), 500.0))
    assert packets.read_types(answer.payload) == Types(0, ("DOUBLE", "NOT_FOUND"))
    assert plug.ask(packets.encode(Kind.START)) == Packet(Kind.START, b"\x00")
    assert packets.read_types(plug.ask(packets.outputs_request((), 500.0)).payload) == Types(
        0, ("NOT_FOUND",)
    )
    long = packets.outputs_request(("timestamp",) * 300, 500.0)
    assert packets.read_types(plug.ask(long).payload) == Types(0, ("NOT_FOUND",))
    desk.run(0.02)
    assert plug.packets() == []


@pytest.mark.parametrize(
    ("rate", "every"),
    [(500.0, 1), (300.0, 1), (125.0, 4), (1.0, 500), (9999.0, 1), (0.0, 500), (math.nan, 1)],
)
def test_data_follows_at_requested_rate(rate: float, every: int) -> None:
    desk = Desk()
    plug = desk.plug()
    recipe = outputs_of(plug, "timestamp", "runtime_state", rate=rate)
    assert plug.ask(packets.encode(Kind.START)) == Packet(Kind.START, b"\x01")
    desk.run(1000 * DT)
    stamps = [float(values["timestamp"]) for values in values_of(plug, recipe)]  # type: ignore[arg-type]
    assert len(stamps) == 1000 // every
    assert np.diff(stamps) == pytest.approx(every * DT)
    assert stamps[0] == pytest.approx(100.0 + (every - 1) * DT)
    assert plug.ask(packets.encode(Kind.PAUSE)) == Packet(Kind.PAUSE, b"\x01")
    desk.run(0.1)
    assert plug.packets() == []


def test_late_process_sends_state_of_due_cycle() -> None:
    desk = Desk()
    plug = desk.plug()
    recipe = outputs_of(plug, "timestamp", rate=125.0)
    plug.ask(packets.encode(Kind.START))
    desk.run(0.04)
    newest = values_of(plug, recipe)[-1]["timestamp"]
    assert isinstance(newest, float)
    plug.server.handle_deadline(desk.now + 0.021)  # the second package was due 5 ms ago
    plug.take()
    (late,) = values_of(plug, recipe)
    assert late["timestamp"] == pytest.approx(newest + 0.016)


def test_cb3_has_different_cycle() -> None:
    desk = Desk(replace(EXACT, cycle_ms=8.0, version="3.15.0.0", model="ur10"))
    plug = desk.plug()
    recipe = outputs_of(plug, "timestamp", rate=125.0)
    plug.ask(packets.encode(Kind.START))
    desk.run(0.8)
    assert len(values_of(plug, recipe)) == 100


def test_input_is_in_use_until_other_client_leaves() -> None:
    desk = Desk(replace(EXACT, release_delay_s=0.5))
    first, second = desk.plug(), desk.plug()
    assert inputs_of(first, "input_int_register_0").number == 1
    assert inputs_of(first, "input_int_register_0", "input_int_register_1").number == 2
    refused = inputs_of(second, "input_int_register_1", "input_int_register_2", "no_input")
    assert (refused.number, refused.types) == (0, ("IN_USE", "INT32", "NOT_FOUND"))
    assert inputs_of(first, "input_int_register_2").number == 3  # the refused recipe has claimed nothing
    desk.unplug(first)
    assert inputs_of(second, "input_int_register_1").number == 0
    desk.run(0.51)
    assert inputs_of(second, "input_int_register_1").number == 1


def test_inputs_outlive_their_connection() -> None:
    desk = Desk()
    writer, reader = desk.plug(), desk.plug()
    recipe = inputs_of(writer, "input_int_register_5", "input_double_register_6", "external_force_torque")
    writer.send(recipe.pack(-3, 2.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    desk.unplug(writer)
    displayed = outputs_of(reader, "input_int_register_5", "input_double_register_6", "actual_TCP_force")
    reader.ask(packets.encode(Kind.START))
    desk.run(0.01)
    last = values_of(reader, displayed)[-1]
    assert (last["input_int_register_5"], last["input_double_register_6"]) == (-3, 2.5)
    assert last["actual_TCP_force"] == (0.0,) * 6, "the input is not enabled"


@pytest.mark.parametrize(("what", "closes"), [("ignore", False), ("close", True)])
def test_data_packet_with_wrong_recipe_has_no_effect(what: Any, closes: bool) -> None:
    desk = Desk(replace(EXACT, bad_input=what))
    plug = desk.plug()
    recipe = inputs_of(plug, "input_int_register_0")
    for payload in (b"", b"\x09\x00\x00\x00\x01", recipe.pack(1)[3:] + b"\x00"):
        plug.send(packets.encode(Kind.DATA, payload))
    assert desk.controller.io.inputs == {}
    assert desk.controller.counts["bad inputs"] == (1 if closes else 3)
    assert plug.server.closing == closes


def test_too_small_packet_closes_connection() -> None:
    desk = Desk()
    plug = desk.plug()
    plug.send(packets.HEADER.pack(4, 0x7A) + b"x")
    assert not plug.server.closing
    plug.send(packets.HEADER.pack(2, Kind.DATA))
    assert plug.server.closing
    assert desk.controller.counts["bad packets"] == 2
    assert plug.got == b"", "a client that waits for an answer would take a text for it"


@given(st.lists(st.binary(max_size=60), max_size=6))
@settings(max_examples=60)
def test_arbitrary_bytes_do_not_break_port(pieces: list[bytes]) -> None:
    desk = Desk()
    for port in Port:
        plug = desk.plug(port)
        for piece in pieces:
            plug.send(piece)
    desk.run(0.004)
    assert desk.controller.state.mode == RobotMode.RUNNING


def test_number_of_clients_per_port_is_limited() -> None:
    robot = RtdeRobot(replace(EXACT, max_clients=3), START, T0, 7)
    assert [robot.connect(Port.RTDE, T0) is None for _ in range(4)] == [False] * 3 + [True]
    assert [robot.connect(Port.SCRIPT, T0) is None for _ in range(CLIENTS_MAX + 1)].count(True) == 1


# --- dashboard


def test_dashboard_answers_in_lines() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    assert board.got == b"Connected: Universal Robots Dashboard Server\n"
    requested = {
        "PolyscopeVersion": "URSoftware 5.12.0.1101319 (Feb 02 2022)",
        "get serial number": "20235500001",
        "get robot model": "UR10",
        "is in remote control": "true",
        "robotmode": "Robotmode: RUNNING",
        "safetystatus": "Safetystatus: NORMAL",
        "running": "Program running: false",
        "programState": "STOPPED <unnamed>",
        "play": "Failed to execute: play",
        "stop": "Stopped",
        "popup hello": "showing popup",
        "close popup": "closing popup",
        "power on": "Powering on",
        "brake release": "Brake releasing",
        "get loaded program": "No program loaded",
        "load polish.urp": "File not found: polish.urp",
        "load installation default.installation": "Loading installation: default.installation",
        "version": "5.12.0.0",
        "isProgramSaved": "true <unnamed>",
        "addToLog Robot mode: mine": "Added log message",
        "saveLog": "Log saved to disk",
        "get operational mode": "NONE",
        "set operational mode sideways": "Failed setting operational mode: sideways",
        "set operational mode manual": "Operational mode MANUAL is set",
        " Get  Operational Mode ": "MANUAL",
        "clear operational mode": "No longer controlling the operational mode.",
        "generate flight report": "Flight Report generated with id: 1",
        "generate flight report controller": "Flight Report generated with id: 2",
        "generate support file .": "Completed successfully: ./support.zip",
        "shutdown": "Shutting down",
        "getUserRole": "could not understand: 'getUserRole'",
        "setUserRole none": "could not understand: 'setUserRole none'",
        "loading": "could not understand: 'loading'",
        "dance": "could not understand: 'dance'",
        "quit": "Disconnected",
    }
    assert {command: board.line(command) for command in requested} == requested
    assert board.server.closing


def test_client_supports_cb3_without_remote_control() -> None:
    cb3 = replace(EXACT, cycle_ms=8.0, version="3.15.0.0", model="ur10")
    board = Desk(cb3).plug(Port.DASHBOARD)
    for command in ("is in remote control", "get operational mode", "version"):
        assert board.line(command) == f"could not understand: '{command}'"
    assert board.line("setUserRole OPERATOR") == "Setting user role: OPERATOR"
    assert board.line("getUserRole") == "OPERATOR"
    assert board.line("setUserRole king") == "Failed setting user role: king"
    pair = Pair(cb3, ClientProfile(cycle_ms=8.0))
    pair.pass_time(0.3)
    assert pair.fault == ""


def test_local_control_answers_queries_only() -> None:
    desk = Desk()
    fault = desk.inject("robot", "local-control", for_s=1.0)
    board = desk.plug(Port.DASHBOARD)
    assert "please switch robot to Remote Control mode" in board.line("play")
    assert board.line("is in remote control") == "false"
    desk.upload(program_text(50, 10.0, 2.0, 0.1))
    desk.run(0.1)
    assert desk.controller.player.runtime == Runtime.STOPPED
    assert desk.controller.counts["programs refused"] == 1
    desk.run(1.0)
    assert fault.ended_at is not None
    assert board.line("is in remote control") == "true"
    assert "reconnect to port 29999" in board.line("play")
    assert desk.plug(Port.DASHBOARD).line("play") == "Failed to execute: play"


def test_power_returns_step_by_step_after_emergency_stop() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    desk.upload(program_text(50, 10.0, 2.0, 0.1))
    desk.run(0.06)
    assert desk.controller.player.runtime == Runtime.PLAYING
    desk.inject("robot", "emergency-stop", for_s=1.0)
    assert desk.controller.player.runtime == Runtime.STOPPED
    assert board.line("safetystatus") == "Safetystatus: ROBOT_EMERGENCY_STOP"
    assert board.line("power on") == "Failed to execute: power on"
    desk.run(1.1)
    assert board.line("power on") == "Powering on"
    desk.run(2.1)
    assert board.line("robotmode") == "Robotmode: IDLE"
    assert board.line("brake release") == "Brake releasing"
    desk.run(2.1)
    assert board.line("robotmode") == "Robotmode: RUNNING"


def test_brake_release_powers_arm_first() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    assert board.line("power off") == "Powering off"
    assert board.line("brake release") == "Brake releasing"
    desk.run(2.1)
    assert board.line("robotmode") == "Robotmode: IDLE"
    desk.run(2.0)
    assert board.line("robotmode") == "Robotmode: RUNNING"
    board.line("power off")
    board.line("brake release")
    board.line("power off")
    desk.run(5.0)
    assert board.line("robotmode") == "Robotmode: POWER_OFF", "the second order counts"
    desk.inject("robot", "emergency-stop", for_s=1.0)
    assert board.line("brake release") == "Failed to execute: brake release"


def test_stored_program_is_loaded_played_paused_and_stopped() -> None:
    desk = Desk()
    desk.controller.player.stored = {"waits": b"def waits():\n  while True:\n    sync()\n  end\nend"}
    board = desk.plug(Port.DASHBOARD)
    assert board.line("load sub/waits.urp").startswith("Loading program: ")
    assert board.line("programState") == "STOPPED waits.urp"
    assert board.line("play") == "Starting program"
    desk.run(0.1)
    assert board.line("programState") == "PLAYING waits.urp"
    assert board.line("pause") == "Pausing program"
    assert board.line("programState") == "PAUSED waits.urp"
    assert board.line("play") == "Starting program"
    assert board.line("running") == "Program running: true"
    assert board.line("stop") == "Stopped"
    assert board.line("running") == "Program running: false"
    board.line("power off")
    assert board.line("play") == "Failed to execute: play"


def test_blocking_pop_up_waits_until_closed() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    desk.upload('def asks():\n  popup("continue?", blocking=True)\n  textmsg("gone on")\n  sleep(1)\nend\n')
    desk.run(0.5)
    messages = desk.controller.console.program_messages
    assert [saying.text for saying in messages] == ["asks", "continue?"]
    assert board.line("close popup") == "closing popup"
    desk.run(0.1)
    assert [saying.text for saying in messages] == ["asks", "continue?", "gone on"]


def test_pop_up_ends_with_its_program() -> None:
    desk = Desk()
    desk.upload('def asks():\n  popup("continue?", blocking=True)\nend\n')
    desk.run(0.2)
    assert desk.controller.console.popup_open
    desk.controller.player.stop(desk.controller.now)
    assert not desk.controller.console.popup_open


def test_late_process_does_not_count_as_silent_client() -> None:
    desk = Desk()
    desk.upload("def waits():\n  while True:\n    sync()\n  end\nend\n")
    desk.run(0.1)
    desk.controller.player.watch_input("input_int_register_0", 10.0, "stop", desk.controller.now)
    desk.run(0.02)
    desk.now += 1.0
    desk.controller.advance(desk.now)
    assert desk.controller.player.runtime == Runtime.PLAYING, "nothing could be heard in this second"
    desk.run(0.12)
    assert desk.controller.player.runtime == Runtime.STOPPED, "and nothing came behind it"


def test_protective_stop_stays_locked_for_five_seconds() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    desk.inject("robot", "protective-stop")
    desk.run(4.9)
    assert board.line("unlock protective stop").startswith("Cannot unlock protective stop until 5s")
    desk.run(0.2)
    assert board.line("unlock protective stop") == "Protective stop releasing"
    assert desk.controller.state.safety == SafetyMode.NORMAL


# --- the script port


def test_program_text_may_arrive_in_pieces() -> None:
    text = "# a comment\nsec other():\n  x = 1\nend\n" + program_text(50, 10.0, 2.0, 0.1)
    for size in (1, 7, 4096):
        desk = Desk()
        script = desk.plug(Port.SCRIPT)
        for at in range(0, len(text), size):
            script.send(text[at : at + size].encode())
        desk.run(0.06)
        assert desk.controller.player.program is not None
        assert desk.controller.player.program.name == "hil_bridge"
        assert desk.controller.counts["secondary programs"] == 1


@pytest.mark.parametrize("register", ["0", "0 +0"])
def test_user_program_runs(register: str) -> None:
    desk = Desk()
    desk.upload(
        f"def mine():\n  write_output_integer_register({register}, 1)\n  sleep(0.1)\n"
        f"  write_output_integer_register({register}, 2)\nend\n"
    )
    desk.run(0.1)
    assert (desk.controller.player.runtime, desk.controller.io.outputs) == (
        Runtime.PLAYING,
        {"output_int_register_0": 1},
    )
    desk.run(0.1)
    assert (desk.controller.player.runtime, desk.controller.io.outputs) == (
        Runtime.STOPPED,
        {"output_int_register_0": 2},
    )


# --- fields and cables


def test_client_requests_only_available_variables() -> None:
    desk = Desk()
    plug = desk.plug()
    assert outputs_of(plug, *OUTPUT_NAMES).types == EXPECTED[OUTPUT_NAMES]
    assert inputs_of(plug, *INPUT_NAMES).types == EXPECTED[INPUT_NAMES]


def test_cut_cable_blocks_every_port() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    cut = desk.inject("wire", "off", for_s=1.0)
    assert board.line("robotmode") == ""
    assert desk.plug(Port.DASHBOARD).got == b""
    assert cut.struck > 0
    desk.run(1.01)
    assert board.line("robotmode") == "Robotmode: RUNNING"


def test_slow_cable_delays_both_directions() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    desk.inject("wire", "late", ms=100.0)
    assert board.line("robotmode") == ""
    before = len(board.got)
    desk.run(0.196)
    assert len(board.got) == before
    desk.run(0.012)
    assert board.got[before:] == b"Robotmode: RUNNING\n"


def test_client_that_does_not_read_is_dropped_after_10_s() -> None:
    """Source: RTDE_Python_Client_Library, issue 6."""
    desk = Desk()
    plug = desk.plug()
    outputs_of(plug, "timestamp")
    plug.ask(packets.encode(Kind.START))
    full = [True]
    plug.server.spare(lambda: full[0])
    desk.run(9.0)
    assert plug.packets() == []
    full[0] = False
    desk.run(0.1)
    assert len(plug.packets()) == 50
    full[0] = True
    desk.run(9.9)
    assert not plug.server.closing
    desk.run(0.2)
    assert plug.server.closing
    assert desk.controller.counts["clients dropped, not reading"] == 1
