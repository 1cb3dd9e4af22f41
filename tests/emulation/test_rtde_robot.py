"""The emulated controller of Universal Robots at its ports, without a wire: packets, programs, refusals and faults."""

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from emulators.devices.rtde import RTDE_FAULTS, RtdeProfile, RtdeRobot
from emulators.devices.rtde.arm import JointArm, Servo
from emulators.devices.rtde.connection import Connection
from emulators.devices.rtde.kinematics import ARMS, USUAL, flange, nearest, solutions
from emulators.devices.rtde.robot import CLIENTS_MAX
from emulators.faults import Ledger
from emulators.seams import StartPose
from protocol.devices.rtde import packets
from protocol.devices.rtde.client import EXPECTED, OUTPUT_NAMES, RtdeClient
from protocol.devices.rtde.fields import Recipe, Value
from protocol.devices.rtde.packets import Kind, Packet, Reader, Types
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.program import INPUT_NAMES, force_program_text, program_text
from protocol.devices.rtde.rotation import six_of
from protocol.devices.rtde.states import RobotMode, Runtime, SafetyMode
from protocol.devices.rtde.wires import CLIENT_PORTS, Piece, Port
from protocol.endpoint import Trouble
from protocol.geometry import Pose, towards
from protocol.robot import ReportReceived, RobotReport, StreamLost
from tests.emulation.exact_arm import EXACT
from tools.register_program import register_program

T0 = 1000.25
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
DT = 0.002
CONTROL = register_program()


class Plug:
    """A client's end of one connection: what it sends arrives at once, what it gets is kept."""

    def __init__(self, desk: "Desk", port: Port) -> None:
        server = desk.robot.connect(port, desk.now)
        assert server is not None
        self.server, self._desk = server, desk
        self.got = b""
        self._reader = Reader()
        self.take()

    def send(self, data: bytes) -> None:
        self.server.receive(data, self._desk.now)
        self.take()

    def take(self) -> None:
        data = self.server.data_to_send(self._desk.now)
        self.got += data
        self._reader.feed(data)

    def packets(self) -> list[Packet]:
        found = []
        while (packet := self._reader.next_packet()) is not None:
            found.append(packet)
        return found

    def ask(self, packet: bytes) -> Packet:
        self.send(packet)
        return self.packets()[-1]

    def line(self, command: str) -> str:
        before = len(self.got)
        self.send(f"{command}\n".encode())
        return self.got[before:].decode().removesuffix("\n")


class Desk:
    """A controller, the plugs in it, and the time."""

    def __init__(self, profile: RtdeProfile = EXACT, start: StartPose = START) -> None:
        self.now = T0
        self.robot = RtdeRobot(profile, start, T0, 7)
        self.controller = self.robot.controller
        self.plugs: list[Plug] = []
        self.ledger = Ledger(RTDE_FAULTS)
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)

    def plug(self, port: Port = Port.RTDE, version: int | None = packets.PROTOCOL_VERSION) -> Plug:
        """A connection; that of RTDE asks for a version of the protocol, or, as a first client, for none."""
        plug = Plug(self, port)
        self.plugs.append(plug)
        if port is Port.RTDE and version is not None:
            plug.send(packets.version_request(version))
            plug.packets()
            plug.got = b""
        return plug

    def unplug(self, plug: Plug, port: Port = Port.RTDE) -> None:
        self.plugs.remove(plug)
        self.robot.leave(port, plug.server, self.now)

    def run(self, seconds: float, each: Callable[[], object] = lambda: None) -> None:
        """Let time pass, cycle by cycle; `each` acts behind every cycle."""
        for _ in range(round(seconds / self.controller.period)):
            self.now += self.controller.period
            self.controller.advance(self.now)
            for plug in self.plugs:
                due = plug.server.next_deadline()
                if due is not None and due <= self.now + 1e-9:
                    plug.server.handle_deadline(self.now)
                plug.take()
            self.ledger.handle_deadline(self.now)
            each()

    def upload(self, text: str) -> None:
        script = self.plug(Port.SCRIPT)
        script.send(text.encode())
        self.plugs.remove(script)

    def inject(self, on: str, fault: str, **values: object) -> Any:
        return self.ledger.inject(on, fault, self.now, values)

    @property
    def place(self) -> tuple[float, float, float]:
        return self.controller.path.pose.position


def outputs_of(plug: Plug, *names: str, rate: float = 500.0) -> Recipe:
    answer = packets.read_types(plug.ask(packets.outputs_request(names, rate)).payload)
    assert answer.recipe == 1
    return Recipe(1, names, answer.types)


def inputs_of(plug: Plug, *names: str) -> Recipe:
    answer = packets.read_types(plug.ask(packets.inputs_request(names)).payload)
    return Recipe(answer.recipe, names, answer.types)


def values_of(plug: Plug, recipe: Recipe) -> list[dict[str, Value]]:
    return [recipe.values(recipe.unpack(p.payload)) for p in plug.packets() if p.kind == Kind.DATA]


# --- packets


def test_versions_are_answered() -> None:
    plug = Desk().plug()
    assert plug.ask(packets.version_request(2)) == Packet(Kind.VERSION, b"\x01")
    assert plug.ask(packets.version_request(1)) == Packet(Kind.VERSION, b"\x01")
    for unknown in (0, 3):
        assert plug.ask(packets.version_request(unknown)) == Packet(Kind.VERSION, b"\x00")
    answer = plug.ask(packets.encode(Kind.CONTROLLER_VERSION))
    assert packets.read_controller_version(answer.payload) == (5, 12, 0, 0)


@pytest.mark.parametrize("version", [None, 1])
def test_version_1_has_no_rate_and_no_recipe_of_outputs(version: int | None) -> None:
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
    (words,) = [packet.payload for packet in plug.packets() if packet.kind == Kind.TEXT]
    assert words == b"\x01unknown type of packet 255"


def test_an_unknown_output_makes_no_recipe_and_so_no_start() -> None:
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
def test_data_comes_in_each_so_manieth_cycle_behind_the_answer(rate: float, every: int) -> None:
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


def test_a_process_that_is_late_tells_the_state_of_the_cycle_that_is_due() -> None:
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


def test_a_cb3_has_another_cycle() -> None:
    desk = Desk(replace(EXACT, cycle_ms=8.0, version="3.15.0.0", model="ur10"))
    plug = desk.plug()
    recipe = outputs_of(plug, "timestamp", rate=125.0)
    plug.ask(packets.encode(Kind.START))
    desk.run(0.8)
    assert len(values_of(plug, recipe)) == 100


def test_an_input_of_another_connection_is_in_use_until_that_one_leaves() -> None:
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


def test_inputs_are_read_back_and_outlive_their_connection() -> None:
    desk = Desk()
    writer, reader = desk.plug(), desk.plug()
    recipe = inputs_of(writer, "input_int_register_5", "input_double_register_6", "external_force_torque")
    writer.send(recipe.pack(-3, 2.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    desk.unplug(writer)
    shown = outputs_of(reader, "input_int_register_5", "input_double_register_6", "actual_TCP_force")
    reader.ask(packets.encode(Kind.START))
    desk.run(0.01)
    last = values_of(reader, shown)[-1]
    assert (last["input_int_register_5"], last["input_double_register_6"]) == (-3, 2.5)
    assert last["actual_TCP_force"] == (0.0,) * 6, "the input is not enabled"


@pytest.mark.parametrize(("what", "closes"), [("ignore", False), ("close", True)])
def test_a_data_packet_of_another_recipe_or_length_has_no_effect(what: Any, closes: bool) -> None:
    desk = Desk(replace(EXACT, bad_input=what))
    plug = desk.plug()
    recipe = inputs_of(plug, "input_int_register_0")
    for payload in (b"", b"\x09\x00\x00\x00\x01", recipe.pack(1)[3:] + b"\x00"):
        plug.send(packets.encode(Kind.DATA, payload))
    assert desk.controller.inputs == {}
    assert desk.controller.counts["bad inputs"] == (1 if closes else 3)
    assert plug.server.closing == closes


def test_a_size_below_a_header_closes_and_an_unknown_type_does_not() -> None:
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
def test_no_bytes_upset_a_port(pieces: list[bytes]) -> None:
    desk = Desk()
    for port in Port:
        plug = desk.plug(port)
        for piece in pieces:
            plug.send(piece)
    desk.run(0.004)
    assert desk.controller.mode == RobotMode.RUNNING


def test_each_port_takes_so_many_clients_and_no_more() -> None:
    robot = RtdeRobot(replace(EXACT, max_clients=3), START, T0, 7)
    assert [robot.connect(Port.RTDE, T0) is None for _ in range(4)] == [False] * 3 + [True]
    assert [robot.connect(Port.SCRIPT, T0) is None for _ in range(CLIENTS_MAX + 1)].count(True) == 1


# --- dashboard


def test_the_dashboard_answers_in_lines() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    assert board.got == b"Connected: Universal Robots Dashboard Server\n"
    asked = {
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
    assert {command: board.line(command) for command in asked} == asked
    assert board.server.closing


def test_a_cb3_knows_no_remote_control_and_our_client_goes_on() -> None:
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


def test_local_control_takes_no_program_and_no_command_but_answers_questions() -> None:
    desk = Desk()
    fault = desk.inject("robot", "local-control", for_s=1.0)
    board = desk.plug(Port.DASHBOARD)
    assert "please switch robot to Remote Control mode" in board.line("play")
    assert board.line("is in remote control") == "false"
    desk.upload(program_text(50, 10.0, 2.0, 0.1))
    desk.run(0.1)
    assert desk.controller.runtime == Runtime.STOPPED
    assert desk.controller.counts["programs refused"] == 1
    desk.run(1.0)
    assert fault.ended_at is not None
    assert board.line("is in remote control") == "true"
    assert "reconnect to port 29999" in board.line("play")
    assert desk.plug(Port.DASHBOARD).line("play") == "Failed to execute: play"


def test_power_goes_with_the_emergency_stop_and_comes_back_step_by_step() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    desk.upload(program_text(50, 10.0, 2.0, 0.1))
    desk.run(0.06)
    assert desk.controller.runtime == Runtime.PLAYING
    desk.inject("robot", "emergency-stop", for_s=1.0)
    assert desk.controller.runtime == Runtime.STOPPED
    assert board.line("safetystatus") == "Safetystatus: ROBOT_EMERGENCY_STOP"
    assert board.line("power on") == "Failed to execute: power on"
    desk.run(1.1)
    assert board.line("power on") == "Powering on"
    desk.run(2.1)
    assert board.line("robotmode") == "Robotmode: IDLE"
    assert board.line("brake release") == "Brake releasing"
    desk.run(2.1)
    assert board.line("robotmode") == "Robotmode: RUNNING"


def test_brakes_released_from_power_off_power_the_arm_first() -> None:
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


def test_a_stored_program_is_loaded_played_paused_and_stopped() -> None:
    desk = Desk()
    desk.controller.programs = {"waits": b"def waits():\n  while True:\n    sync()\n  end\nend"}
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


def test_a_pop_up_that_blocks_waits_until_it_is_closed() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    desk.upload('def asks():\n  popup("go on?", blocking=True)\n  textmsg("gone on")\n  sleep(1)\nend\n')
    desk.run(0.5)
    said = desk.controller.console.sayings
    assert [saying.text for saying in said] == ["asks", "go on?"]
    assert board.line("close popup") == "closing popup"
    desk.run(0.1)
    assert [saying.text for saying in said] == ["asks", "go on?", "gone on"]


def test_a_pop_up_ends_with_its_program() -> None:
    desk = Desk()
    desk.upload('def asks():\n  popup("go on?", blocking=True)\nend\n')
    desk.run(0.2)
    assert desk.controller.console.popup_open
    desk.controller.stop_program()
    assert not desk.controller.console.popup_open


def test_a_process_that_was_late_is_no_silent_client() -> None:
    desk = Desk()
    desk.upload("def waits():\n  while True:\n    sync()\n  end\nend\n")
    desk.run(0.1)
    desk.controller.watch_input("input_int_register_0", 10.0, "stop")
    desk.run(0.02)
    desk.now += 1.0
    desk.controller.advance(desk.now)
    assert desk.controller.runtime == Runtime.PLAYING, "nothing could be heard in this second"
    desk.run(0.12)
    assert desk.controller.runtime == Runtime.STOPPED, "and nothing came behind it"


def test_a_protective_stop_is_not_unlocked_within_five_seconds() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    desk.inject("robot", "protective-stop")
    desk.run(4.9)
    assert board.line("unlock protective stop").startswith("Cannot unlock protective stop until 5s")
    desk.run(0.2)
    assert board.line("unlock protective stop") == "Protective stop releasing"
    assert desk.controller.safety == SafetyMode.NORMAL


# --- the script port


def test_a_program_is_found_however_its_text_comes() -> None:
    text = "# a comment\nsec other():\n  x = 1\nend\n" + program_text(50, 10.0, 2.0, 0.1)
    for size in (1, 7, 4096):
        desk = Desk()
        script = desk.plug(Port.SCRIPT)
        for at in range(0, len(text), size):
            script.send(text[at : at + size].encode())
        desk.run(0.06)
        assert desk.controller.program is not None
        assert desk.controller.program.name == "hil_bridge"
        assert desk.controller.counts["secondary programs"] == 1


@pytest.mark.parametrize("register", ["0", "0 +0"])
def test_a_program_of_a_user_runs(register: str) -> None:
    desk = Desk()
    desk.upload(
        f"def mine():\n  write_output_integer_register({register}, 1)\n  sleep(0.1)\n"
        f"  write_output_integer_register({register}, 2)\nend\n"
    )
    desk.run(0.1)
    assert (desk.controller.runtime, desk.controller.outputs) == (
        Runtime.PLAYING,
        {"output_int_register_0": 1},
    )
    desk.run(0.1)
    assert (desk.controller.runtime, desk.controller.outputs) == (
        Runtime.STOPPED,
        {"output_int_register_0": 2},
    )


# --- our program with our client


class Pair(Desk):
    """Our client at the controller's three ports."""

    def __init__(self, profile: RtdeProfile = EXACT, client: ClientProfile | None = None) -> None:
        super().__init__(profile)
        self.profile = client or ClientProfile()
        self.ports = {port: self.plug(port) for port in CLIENT_PORTS}
        self.client = RtdeClient(self.profile, self.now)
        self.reports: list[RobotReport] = []
        self.lost: list[str] = []
        self.goal: Pose | None = None
        self.speed = 0.1
        self.set_point: Pose | None = None
        self.sent: list[bytes] = []
        self.exchange()

    def exchange(self) -> None:
        for _ in range(10):
            for port, plug in self.ports.items():
                if plug.got:
                    data, plug.got = plug.got, b""
                    self.client.receive((Piece(port, data),), self.now)
                self._events()
            pieces = self.client.data_to_send(self.now)
            if not pieces:
                return
            for piece in pieces:
                self.sent.append(piece.data)
                self.ports[piece.port].send(piece.data)

    def _events(self) -> None:
        while (event := self.client.next_event()) is not None:
            match event:
                case ReportReceived(report=report):
                    self.reports.append(report)
                    if self.goal is None or self.set_point is None:
                        self.client.hold(self.now)
                    else:
                        self.set_point = towards(self.set_point, self.goal, self.speed * DT, 0.35 * DT)
                        self.client.target(self.set_point, self.now)
                case StreamLost(text=text, remedy=remedy):
                    self.lost.append(str(Trouble(text, remedy)))

    def step(self) -> None:
        due = self.client.next_deadline()
        if due is not None and due <= self.now:
            self.client.handle_deadline(self.now)
            self._events()
        self.exchange()

    def pass_time(self, seconds: float) -> None:
        self.run(seconds, self.step)

    def begin(self, dx: float = 0.0, dz: float = 0.0) -> None:
        pose = self.reports[-1].pose
        x, y, z = pose.position
        self.set_point, self.goal = pose, Pose((x + dx, y, z + dz), pose.quaternion)
        self.client.begin(pose)

    def end(self) -> None:
        self.goal = None
        self.client.end()
        self.exchange()

    @property
    def fault(self) -> str:
        report = self.reports[-1]
        return str(Trouble(report.fault, report.remedy))


def ready(profile: RtdeProfile = EXACT, client: ClientProfile | None = None) -> Pair:
    pair = Pair(profile, client)
    pair.pass_time(0.2)
    assert pair.reports, pair.lost
    return pair


def test_our_client_comes_to_its_stream_and_is_answered_each_cycle() -> None:
    pair = ready()
    assert not pair.lost
    assert pair.controller.program is not None
    assert pair.fault == ""
    before = len(pair.reports)
    pair.pass_time(0.1)
    assert len(pair.reports) - before == 50
    assert np.diff([report.sequence for report in pair.reports]).tolist() == [1] * (len(pair.reports) - 1)
    assert pair.reports[-1].pose.position == pytest.approx(START.position, abs=1e-9)
    assert pair.reports[-1].received_at - pair.reports[-1].pose_at == pytest.approx(DT)


def test_the_first_package_orders_nothing_and_goes_before_the_program() -> None:
    pair = Pair()
    pair.controller.inputs = {"input_int_register_24": 1, "input_int_register_25": 9}
    pair.pass_time(0.2)
    recipe = Recipe(1, INPUT_NAMES, EXPECTED[INPUT_NAMES])
    upload = next(number for number, data in enumerate(pair.sent) if data.startswith(b"def hil_bridge"))
    command, sequence = recipe.unpack(pair.sent[upload - 1][3:])[9:]
    assert (command, sequence) == (0, 100_001)
    assert pair.place == pytest.approx(START.position, abs=1e-9)


def test_the_arm_follows_within_the_models_lag_and_stands_after_the_end() -> None:
    pair = ready()
    pair.begin(dx=-0.05)
    pair.pass_time(0.4)
    assert pair.set_point is not None
    lag = pair.place[0] - pair.set_point.position[0]
    assert lag == pytest.approx(0.1 * (0.03 + DT), abs=0.0006)
    pair.end()
    pair.pass_time(0.2)
    stood = pair.place
    assert stood == pytest.approx(pair.set_point.position, abs=3e-5)
    assert pair.controller.outputs["output_int_register_24"] == 1
    pair.pass_time(0.5)
    assert pair.place == stood
    assert pair.fault == ""
    pair.begin(dz=-0.01)
    pair.pass_time(0.5)
    assert pair.place[2] == pytest.approx(0.59, abs=2e-5)


def test_a_client_that_falls_silent_leaves_the_arm_standing_and_the_program_stopped() -> None:
    pair = ready()
    pair.begin(dx=-0.2)
    pair.pass_time(0.3)
    pair.run(0.2)  # the client's process is gone; its connection stands
    assert pair.controller.runtime == Runtime.STOPPED
    assert pair.controller.counts["watchdog stop"] == 1
    stood = pair.place
    pair.run(1.0)
    assert pair.place == stood
    assert 0.0 < START.position[0] - stood[0] < 0.06


def test_targets_that_stop_while_packages_go_on_make_the_program_brake() -> None:
    pair = ready()
    pair.begin(dx=-0.2)
    pair.pass_time(0.3)
    writer = pair.client._inputs
    assert writer is not None
    last = pair.sent[-1]
    for _ in range(80):
        pair.run(DT)
        pair.ports[Port.RTDE].send(last)
    assert pair.controller.outputs["output_int_register_24"] == 3
    assert pair.controller.runtime == Runtime.PLAYING
    pair.exchange()
    assert "no new target for too long" in pair.reports[-1].fault


def test_the_program_of_another_client_takes_the_robot_away_and_that_is_told() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.upload(CONTROL)
    pair.pass_time(0.3)
    assert pair.controller.program is not None
    assert pair.controller.program.name == "rtde_control"
    assert pair.fault == "our program was stopped, and another may play; begin again"
    stood = pair.place
    pair.pass_time(0.3)
    assert pair.place == stood


def test_a_farewell_ends_the_program() -> None:
    pair = ready()
    for piece in pair.client.farewell():
        pair.ports[piece.port].send(piece.data)
    pair.run(0.1)
    assert pair.controller.runtime == Runtime.STOPPED
    assert pair.controller.outputs["output_int_register_24"] == 5


def test_a_fault_behind_a_movement_lets_the_arm_settle_no_more() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.2)
    pair.end()
    pair.inject("robot", "slider", percent=50.0)
    pair.pass_time(0.01)
    assert struct.unpack(">i", pair.sent[-1][-8:-4])[0] == 0


STOPS = [
    ("robot", "protective-stop", {}, "protective stop; see its cause"),
    ("robot", "emergency-stop", {}, "emergency stop; release it"),
    ("robot", "safeguard-stop", {}, "safeguard stop; close"),
    ("robot", "program-stopped", {}, "our program is stopped"),
    ("robot", "program-paused", {}, "our program is paused"),
    ("robot", "motors-off", {}, "'power off'; power it on"),
    ("robot", "slider", {"percent": 40.0}, "speed slider stands at 40 %"),
    ("pose", "nan", {}, "it reports the position (nan, nan, nan)"),
]


@pytest.mark.parametrize(("on", "fault", "values", "words"), STOPS, ids=[stop[1] for stop in STOPS])
def test_a_stop_is_told_and_nothing_is_ordered_after_it(
    on: str, fault: str, values: dict[str, object], words: str
) -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    injection = pair.inject(on, fault, **values)
    pair.pass_time(0.1)
    assert words in pair.fault
    assert "\n" not in pair.fault
    assert injection.struck >= 1
    stood = pair.place
    pair.pass_time(0.3)
    assert pair.place == stood
    command = struct.unpack(">i", pair.sent[-1][-8:-4])[0]
    assert command == 0


# robot_mode, safety_mode, safety_status_bits, robot_status_bits, runtime_state
SEEN = [
    (None, (7, 1, 0x001, 3, 2)),
    ("program-stopped", (7, 1, 0x001, 1, 1)),
    ("program-paused", (7, 1, 0x001, 1, 4)),
    ("protective-stop", (7, 3, 0x404, 1, 4)),
    ("safeguard-stop", (7, 5, 0x410, 1, 4)),
    ("emergency-stop", (3, 7, 0x4C0, 0, 1)),
    ("motors-off", (3, 1, 0x001, 0, 1)),
]


@pytest.mark.parametrize(("fault", "seen"), SEEN, ids=[str(fault) for fault, _ in SEEN])
def test_each_stop_is_seen_by_clients_as_the_specification_has_it(
    fault: str | None, seen: tuple[int, ...]
) -> None:
    desk = Desk()
    reader = desk.plug()
    names = ("robot_mode", "safety_mode", "safety_status_bits", "robot_status_bits", "runtime_state")
    shown = outputs_of(reader, *names)
    reader.ask(packets.encode(Kind.START))
    desk.upload(CONTROL)
    desk.run(0.06)
    if fault is not None:
        desk.inject("robot", fault)
    desk.run(0.01)
    assert tuple(values_of(reader, shown)[-1].values()) == seen


def test_a_protective_stop_may_end_the_program() -> None:
    desk = Desk(replace(EXACT, on_protective_stop="stopped"))
    desk.upload(CONTROL)
    desk.run(0.06)
    desk.inject("robot", "protective-stop")
    assert (desk.controller.runtime, desk.controller.program) == (Runtime.STOPPED, None)


def test_a_program_that_is_played_again_finds_no_old_order() -> None:
    pair = ready()
    board = pair.plug(Port.DASHBOARD)
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.inject("robot", "protective-stop")
    pair.pass_time(5.1)
    stood = pair.place
    assert board.line("unlock protective stop") == "Protective stop releasing"
    assert board.line("play") == "Starting program"
    pair.pass_time(0.5)
    assert pair.controller.runtime == Runtime.PLAYING
    assert pair.place == stood
    assert pair.fault == ""


def test_the_drop_of_all_connections_closes_them_and_the_arm_brakes() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.inject("wire", "dropped")
    assert pair.ports[Port.RTDE].server.closing
    pair.run(0.3)
    assert pair.controller.runtime == Runtime.STOPPED
    assert pair.controller.still


def test_a_mute_robot_ends_the_movement_within_a_tenth_of_a_second() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.inject("wire", "mute", for_s=1.0)
    pair.pass_time(0.098)
    assert not pair.lost
    pair.pass_time(0.006)
    assert "nothing came for 100 ms" in pair.lost[0]


def test_a_deaf_robot_stops_its_program() -> None:
    pair = ready()
    pair.begin(dx=-0.1)
    pair.pass_time(0.1)
    pair.inject("wire", "deaf")
    pair.pass_time(0.3)
    assert "our program is stopped" in pair.fault


def test_late_and_lost_packets_keep_their_order_and_their_numbers() -> None:
    pair = ready()
    pair.inject("wire", "late", ms=20.0, for_s=0.1, way="from")
    pair.inject("wire", "lost", probability=1.0, count=3, way="from")
    count = len(pair.reports)
    pair.pass_time(0.3)
    new = pair.reports[count:]
    assert len(new) == 147
    steps = np.diff([report.sequence for report in pair.reports[count - 1 :]]).tolist()
    assert sorted(steps) == [1] * 146 + [4]


def test_pose_faults_tell_another_place() -> None:
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


def test_every_fault_has_a_handler() -> None:
    handlers = Desk().robot.handlers
    assert {on: set(faults) for on, faults in RTDE_FAULTS.items()} == {
        on: set(found) for on, found in handlers.items()
    }


@pytest.mark.parametrize(
    ("profile", "act", "words"),
    [
        (replace(EXACT, remote_control=False), None, "switch it to Remote Control"),
        (EXACT, ("robot", "motors-off"), "power it on"),
        (EXACT, ("robot", "protective-stop"), "PROTECTIVE_STOP"),
        (EXACT, ("robot", "in-use"), "another client holds its input registers"),
        (EXACT, ("wire", "mute"), "its dashboard does not answer"),
    ],
)
def test_a_robot_that_is_not_ready_is_told_in_one_line(
    profile: RtdeProfile, act: tuple[str, str] | None, words: str
) -> None:
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
    assert words in fresh.lost[0]
    assert not fresh.reports


def test_a_robot_that_answers_and_sends_no_data_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Connection, "_sends", False)
    pair = Pair(EXACT)
    pair.pass_time(3.0)
    assert "it sends no data" in pair.lost[0]


def test_a_jump_of_the_target_is_a_protective_stop() -> None:
    pair = ready(client=ClientProfile(joint_step_rad=0.3))
    pair.begin()
    pair.speed = 1e3
    assert pair.set_point is not None
    x, y, z = pair.set_point.position
    pair.goal = Pose((x - 0.06, y, z), pair.set_point.quaternion)
    pair.pass_time(0.02)
    assert pair.controller.counts["protective stop: a sudden change of the target"] == 1
    assert "protective stop" in pair.fault


def test_a_target_that_no_joints_hold_is_refused() -> None:
    pair = ready()
    pair.begin()
    pair.speed, pair.goal = 1e9, Pose((5.0, 0.0, 0.5), START.quaternion)
    pair.pass_time(0.1)
    assert next(report.fault for report in pair.reports if report.fault).startswith("no joints near")
    assert pair.place == pytest.approx(START.position, abs=1e-9)
    assert pair.controller.safety == SafetyMode.NORMAL


def test_at_the_end_of_its_reach_the_arm_does_not_swing_to_another_posture() -> None:
    pair = ready()
    pair.begin(dx=0.4, dz=0.3)
    pair.pass_time(4.0)
    assert next(report.fault for report in pair.reports if report.fault).startswith("no joints near")
    assert pair.controller.safety == SafetyMode.NORMAL
    assert max(abs(a - b) for a, b in zip(pair.controller.arm.joints, USUAL, strict=True)) < 2.5
    assert pair.controller.still


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_target_that_is_no_number_is_a_protective_stop(bad: float) -> None:
    pair = ready()
    recipe = Recipe(1, INPUT_NAMES, EXPECTED[INPUT_NAMES])
    pair.run(DT)
    pair.ports[Port.RTDE].send(recipe.pack(bad, 0, 0, 0, 3, 0, 0.002, 0.1, 300.0, 1, 5))
    pair.run(DT)
    assert pair.controller.counts["protective stop: a target that is no number"] == 1


def test_too_fast_a_tool_is_a_protective_stop() -> None:
    desk = Desk()
    client = desk.plug()
    recipe = inputs_of(client, "input_int_register_0", *(f"input_double_register_{n}" for n in range(8)))
    desk.upload(CONTROL)
    desk.run(0.06)
    client.send(recipe.pack(9, 3.3, 0, 0, 0, 0, 0, 40.0, 0.0))
    desk.run(0.3)
    assert [name for name in desk.controller.counts if "fast" in name]
    assert desk.controller.runtime == Runtime.PAUSED


# --- ur_rtde's program by its registers


class UrClient:
    """Commands to ur_rtde's control program, as its library sends them."""

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self.plug = desk.plug()
        self.recipe = inputs_of(
            self.plug,
            "input_int_register_0",
            *(f"input_double_register_{n}" for n in range(12)),
            "input_int_register_1",
        )
        desk.upload(CONTROL)
        desk.run(0.06)

    def command(self, number: int, values: Sequence[float] = (), flag: int = 0) -> None:
        laid = [*values, *[0.0] * (12 - len(values))]
        self.plug.send(self.recipe.pack(number, *laid, flag))

    def do(self, number: int, values: Sequence[float] = (), flag: int = 0, seconds: float = 0.01) -> None:
        self.command(number, values, flag)
        self.desk.run(seconds)
        assert self.desk.controller.outputs["output_int_register_0"] == 2
        self.command(0)
        self.desk.run(2 * DT)
        assert self.desk.controller.outputs["output_int_register_0"] == 1

    @property
    def told(self) -> list[float]:
        out = self.desk.controller.outputs
        return [float(out.get(f"output_double_register_{n}", 0.0)) for n in range(6)]  # type: ignore[arg-type]


def test_a_servo_of_ur_rtde_is_followed_until_it_is_stopped() -> None:
    desk = Desk()
    ur = UrClient(desk)
    six = list(six_of(Pose(START.position, START.quaternion)))
    for step in range(500):
        six[0] = 0.9 - 0.04 * step / 500.0
        ur.command(24, [*six, 0.0, 0.0, 0.002, 0.1, 300.0])
        desk.run(DT)
    assert desk.place[0] - six[0] == pytest.approx(0.04 * 0.1, abs=4e-4)
    assert desk.controller.outputs["output_int_register_0"] == 1
    desk.run(1.0)
    assert desk.place[0] == pytest.approx(six[0], abs=1e-6), "the last target is repeated for ever"
    ur.do(16, [10.0], seconds=0.1)
    assert desk.controller.still
    ur.command(255)
    desk.run(2 * DT)
    assert desk.controller.runtime == Runtime.STOPPED


def test_moves_questions_and_settings_of_ur_rtde() -> None:
    desk = Desk()
    ur = UrClient(desk)
    six = list(six_of(Pose(START.position, START.quaternion)))
    ur.do(3, [six[0] - 0.05, *six[1:], 0.25, 1.2], seconds=1.0)
    assert desk.place == pytest.approx((0.85, -0.1, 0.6), abs=1e-9)
    ur.do(46, six)
    joints = ur.told
    ur.do(1, [*joints, 1.0, 1.4], seconds=1.0)
    assert desk.place == pytest.approx(START.position, abs=1e-6)
    ur.do(44, [*joints, 0.0, 0.0, 0.2])
    assert ur.told[:3] == pytest.approx(START.position, abs=1e-6)
    ur.do(44, joints)
    assert ur.told[:3] == pytest.approx((0.9, -0.1, 0.8), abs=1e-6)
    ur.do(40)
    assert ur.told == [0.0, 0.0, 0.2, 0.0, 0.0, 0.0]
    ur.do(29, [0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    ur.do(43)
    assert ur.told[2] == pytest.approx(0.7, abs=1e-6)
    ur.do(60, [9.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert desk.controller.outputs.get("output_int_register_1", 0) == 0
    ur.do(47)
    assert desk.controller.outputs["output_int_register_1"] == 1
    ur.do(19)  # one that has no effect here


def test_a_move_beside_other_commands_tells_that_it_runs() -> None:
    desk = Desk()
    ur = UrClient(desk)
    six = list(six_of(Pose(START.position, START.quaternion)))
    ur.do(3, [six[0] - 0.05, *six[1:], 0.1, 1.0], flag=1)
    running = desk.controller.outputs["output_int_register_2"]
    assert int(running) & 1 << 15  # type: ignore[arg-type]
    ur.do(33, [2.0], seconds=0.3)
    assert desk.controller.still
    assert not int(desk.controller.outputs["output_int_register_2"]) & 1 << 15  # type: ignore[arg-type]
    assert 0.85 < desk.place[0] < 0.9


def test_a_pose_out_of_reach_ends_ur_rtdes_program() -> None:
    desk = Desk()
    ur = UrClient(desk)
    ur.command(24, [9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.002, 0.1, 300.0])
    desk.run(0.02)
    assert (desk.controller.runtime, desk.controller.safety) == (Runtime.STOPPED, SafetyMode.NORMAL)


def test_ur_rtdes_watchdog_stops_its_program() -> None:
    desk = Desk()
    ur = UrClient(desk)
    ur.do(35, [10.0])
    desk.run(0.09)
    assert desk.controller.runtime == Runtime.PLAYING
    desk.run(0.02)
    assert desk.controller.runtime == Runtime.STOPPED


UNSHRUNK = (Phase.explicit, Phase.generate)
"""A failing example is told as it is: to shrink it takes minutes."""
WILD = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 1e-300, 5e-324, 1e300, -1.7e308, math.inf, -math.inf, math.nan]),
    st.floats(-4.0, 4.0),
)


@given(
    st.lists(st.tuples(st.integers(-2, 75), st.lists(WILD, min_size=12, max_size=12)), max_size=3),
    st.sampled_from([1, 0, -5]),
)
@settings(max_examples=100, phases=UNSHRUNK)
def test_no_command_of_ur_rtde_upsets_the_controller(
    commands: list[tuple[int, list[float]]], flag: int
) -> None:
    desk = Desk()
    ur = UrClient(desk)
    for number, values in commands:
        ur.command(number, values, flag)
        desk.run(0.02)
        ur.command(0)
        desk.run(0.004)
    assert all(map(math.isfinite, desk.place))


@given(st.lists(WILD, min_size=9, max_size=9), st.integers(0, 3))
@settings(max_examples=100, phases=UNSHRUNK)
def test_no_input_of_our_program_upsets_the_controller(values: list[float], command: int) -> None:
    desk = Desk()
    plug = desk.plug()
    recipe = inputs_of(plug, *INPUT_NAMES)
    desk.upload(program_text(50, 10.0, 2.0, 0.1))
    desk.run(0.06)
    for sequence in range(5):
        plug.send(recipe.pack(*values, command, sequence))
        desk.run(0.004)
    assert all(map(math.isfinite, desk.place))


# --- external forces


def test_an_external_force_comes_out_along_the_base_axes() -> None:
    desk = Desk()
    feeder, reader = desk.plug(), desk.plug()
    recipe = inputs_of(feeder, "external_force_torque")
    desk.upload(force_program_text(hold=True))
    desk.run(0.06)
    shown = outputs_of(reader, "actual_TCP_force", "ft_raw_wrench", "tcp_force_scalar")
    reader.ask(packets.encode(Kind.START))
    for _ in range(10):
        feeder.send(recipe.pack(1.0, 2.0, -12.5, 0.1, 0.2, 0.3))
        desk.run(DT)
    last = values_of(reader, shown)[-1]
    assert last["actual_TCP_force"] == pytest.approx((1.0, -2.0, 12.5, 0.1, -0.2, -0.3), abs=1e-9)
    assert last["ft_raw_wrench"] == (1.0, 2.0, -12.5, 0.1, 0.2, 0.3)
    desk.run(0.2)
    assert desk.controller.runtime == Runtime.PAUSED, "the stream has stopped"
    feeder.send(recipe.pack(0.0, 0.0, -300.0, 0.0, 0.0, 0.0))
    desk.run(2 * DT)
    assert desk.controller.counts["protective stop: the force is too large"] == 1
    feeder.send(recipe.pack(math.nan, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert desk.controller.inputs["external_force_torque"] == (0.0, 0.0, -300.0, 0.0, 0.0, 0.0)


def test_a_pure_force_at_the_tip_has_no_moment_about_the_tip() -> None:
    desk = Desk(replace(EXACT, force_point="tcp"))
    feeder, reader = desk.plug(), desk.plug()
    recipe = inputs_of(feeder, "external_force_torque")
    desk.upload(force_program_text(hold=False))
    desk.run(0.06)
    shown = outputs_of(reader, "actual_TCP_force")
    reader.ask(packets.encode(Kind.START))
    force, arm = (3.0, 4.0, -5.0), (0.0, 0.0, 0.2)
    moment = np.cross(arm, force).tolist()
    feeder.send(recipe.pack(*force, *moment))
    desk.run(2 * DT)
    assert values_of(reader, shown)[-1]["actual_TCP_force"] == pytest.approx(
        (3.0, -4.0, 5.0, 0, 0, 0), abs=1e-9
    )


# --- arm and kinematics


def test_the_guides_lengths_give_poses_worked_out_elsewhere() -> None:
    arm = ARMS["ur5e"]
    pose = six_of(flange(arm, (0.1, -1.2, 1.6, -1.9, -1.5, 0.3)))
    assert pose == pytest.approx((-0.590618, -0.200310, 0.299733, 2.358483, 1.923433, 0.030280), abs=1e-6)
    assert six_of(flange(arm, (0.0,) * 6)) == pytest.approx((-0.8172, -0.2329, 0.0628, math.pi / 2, 0, 0))


@given(st.sampled_from(sorted(ARMS)), st.tuples(*[st.floats(-3.0, 3.0)] * 6))
def test_every_solution_holds_the_pose(model: str, joints: tuple[float, ...]) -> None:
    arm = ARMS[model]
    a, b, c, d, e, f = joints
    near = (a, b, c, d, e, f)
    pose = flange(arm, near)
    for found in solutions(arm, pose, near):
        again = flange(arm, found)
        assert math.dist(again.position, pose.position) < 1e-6
        dot = sum(p * q for p, q in zip(again.quaternion, pose.quaternion, strict=True))
        assert abs(dot) == pytest.approx(1.0, abs=1e-9)
    assert nearest(arm, Pose((9.0, 0.0, 0.0), pose.quaternion), USUAL) is None


@given(
    st.sampled_from(sorted(ARMS)),
    st.tuples(*[st.floats(-3.0, 3.0)] * 6),
    st.tuples(*[st.floats(-1.2, 1.2)] * 6),
)
def test_the_nearest_solution_is_the_nearest_of_all(
    model: str, joints: tuple[float, ...], way: tuple[float, ...]
) -> None:
    arm = ARMS[model]
    a, b, c, d, e, f = (joint + part**5 for joint, part in zip(joints, way, strict=True))
    near = (a, b, c, d, e, f)
    pose = flange(arm, joints)
    found = nearest(arm, pose, near)
    distances = [math.dist(each, near) for each in solutions(arm, pose, near)]
    assert (found is None) == (not distances)
    assert found is None or math.dist(found, near) == min(distances)


# Times and places that the specification's model gives: 20, 50, 100, 200 and 400 ms after a step of 1.
STEPS = [
    (0.10, 300.0, (0.0548, 0.2388, 0.5711, 0.9231, 1.0028)),
    (0.03, 300.0, (0.0619, 0.3183, 0.9097, 1.4157, 0.8353)),
    (0.03, 2000.0, (0.2928, 0.8388, 1.0472, 0.9979, 1.0000)),
    (0.20, 300.0, (0.0466, 0.1704, 0.3652, 0.6324, 0.8769)),
]


@pytest.mark.parametrize(("lookahead", "gain", "places"), STEPS)
def test_servoj_answers_a_step_as_the_model_says(
    lookahead: float, gain: float, places: tuple[float, ...]
) -> None:
    arm = JointArm((0.0,) * 6, DT, 1.0, 4.0)
    at = []
    for _ in range(200):
        arm.take(Servo((1.0,) * 6, lookahead, gain, 1))
        arm.step(1.0)
        at.append(arm.joints[0])
    assert [at[round(ms / 2) - 1] for ms in (20, 50, 100, 200, 400)] == pytest.approx(places, abs=1e-4)


def test_a_start_out_of_reach_is_refused() -> None:
    with pytest.raises(ValueError, match="a ur5e cannot hold its tool at the start"):
        RtdeRobot(replace(EXACT, model="ur5e"), START, T0, 7)


def test_the_path_is_the_same_however_it_is_read() -> None:
    def path(read: bool) -> list[list[float]]:
        pair = ready(RtdeProfile())
        pair.begin(dx=-0.05)

        def look() -> None:
            pair.step()
            if read:
                pair.robot.path.trajectory(np.linspace(pair.now - 0.02, pair.now, 7))

        pair.run(0.3, look)
        times = np.arange(T0, pair.now, 0.0007)
        places, speeds = pair.robot.path.trajectory(times)
        assert np.abs(np.diff(places, axis=0)).max() < 0.2 * 0.0007
        assert sum(part.stop - part.start for part, _ in pair.robot.path.orientations(times)) == len(times)
        return [*places.tolist(), *speeds.tolist()]

    assert path(True) == path(False)


def test_the_client_asks_for_nothing_that_the_controller_has_not() -> None:
    desk = Desk()
    plug = desk.plug()
    assert outputs_of(plug, *OUTPUT_NAMES).types == EXPECTED[OUTPUT_NAMES]
    assert inputs_of(plug, *INPUT_NAMES).types == EXPECTED[INPUT_NAMES]


def test_a_cut_cable_carries_nothing_to_any_port_nor_to_a_connection_that_comes() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    cut = desk.inject("wire", "off", for_s=1.0)
    assert board.line("robotmode") == ""
    assert desk.plug(Port.DASHBOARD).got == b""
    assert cut.struck > 0
    desk.run(1.01)
    assert board.line("robotmode") == "Robotmode: RUNNING"


def test_a_slow_cable_carries_everything_both_ways_late() -> None:
    desk = Desk()
    board = desk.plug(Port.DASHBOARD)
    desk.inject("wire", "late", ms=100.0)
    assert board.line("robotmode") == ""
    before = len(board.got)
    desk.run(0.196)
    assert len(board.got) == before
    desk.run(0.012)
    assert board.got[before:] == b"Robotmode: RUNNING\n"
