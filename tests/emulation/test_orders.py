"""Tests of the reports of orders that emulated robots receive, accepted or not."""

import math
from collections.abc import Callable
from typing import Literal

import pytest

from emulators.devices.egm import EgmController, EgmProfile
from emulators.devices.rsi import RSI_FAULTS, RsiController, RsiProfile
from emulators.devices.rtde import RTDE_FAULTS, RtdeProfile, RtdeRobot, Server
from emulators.devices.rtde.rehearsal import DryHost
from emulators.devices.rtde.script_host import ControllerHost
from emulators.faults import Ledger
from emulators.orders import Act, Reach, ReceivedOrder, ReportingRobot
from emulators.seams import StartPose
from protocol.devices.egm import SensorMessage, encode_answer, to_wire
from protocol.devices.rsi import SENSOR, Telegram, encode
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import Kind, Types, inputs_request, types_answer
from protocol.devices.rtde.program import INPUT_NAMES, Command, program_text
from protocol.devices.rtde.wires import Port
from protocol.geometry import Pose, Vector
from tools.register_program import register_program

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
T0 = 100.0


def listening(robot: ReportingRobot) -> list[ReceivedOrder]:
    assert isinstance(robot, ReportingRobot)
    received: list[ReceivedOrder] = []
    robot.orders.listener = received.append
    return received


def place_of(order: ReceivedOrder) -> Vector:
    assert order.pose is not None
    return order.pose.position


# --- RTDE

UR_TARGET = (*(f"input_double_register_{number}" for number in range(11)), "input_int_register_0")


class Ur:
    """Emulated controller, a connection to its RTDE port with one input recipe, and its script port."""

    def __init__(self, names: tuple[str, ...], types: tuple[str, ...]) -> None:
        self.robot = RtdeRobot(RtdeProfile(), START, T0, 7)
        self.received = listening(self.robot)
        self.rtde, self.script, self.dashboard = (
            self.door(port) for port in (Port.RTDE, Port.SCRIPT, Port.DASHBOARD)
        )
        self.recipe = Recipe(1, names, types)
        self.now = T0
        self.rtde.receive(inputs_request(names), T0)
        assert self.rtde.data_to_send(T0) == types_answer(Kind.INPUTS, Types(1, types))

    def door(self, port: Port) -> Server:
        server = self.robot.connect(port, T0)
        assert server is not None
        return server

    def write(self, *values: float) -> ReceivedOrder:
        self.now += 0.1
        self.rtde.receive(self.recipe.pack(*values), self.now)
        self.robot.controller.advance(self.now + 0.01)  # the program that hears it has its cycles
        self.now += 0.01
        return self.received[-1]

    def upload(self, text: str) -> ReceivedOrder:
        self.script.receive(text.encode(), self.now)
        order = self.received[-1]
        self.now += 0.2
        self.robot.controller.advance(self.now)
        return order

    def inject(self, fault: str) -> None:
        ledger = Ledger(RTDE_FAULTS)
        ledger.attach("robot", self.robot.handlers["robot"])
        ledger.inject("robot", fault, self.now, {})


def test_servo_poses_are_reported_even_after_stop() -> None:
    ur = Ur(INPUT_NAMES, (*("DOUBLE",) * 9, "INT32", "INT32"))
    assert [order.act for order in ur.received] == [Act.CONTACT] * 3
    program = ur.upload(program_text(50, 1.0, 2.0, 0.03) + "\n")
    assert (program.act, program.taken, program.moves) == (Act.PROGRAM, True, False)
    pose = (0.9, -0.1, 0.599, math.pi, 0.0, 0.0)
    order = ur.write(*pose, 0.002, 0.1, 300.0, Command.SERVO, 1)
    assert (order.act, order.taken) == (Act.MOTION, True)
    assert place_of(order) == pytest.approx(pose[:3])
    assert order.reach == Reach(0.002, 1.5, 3.14)
    assert ur.robot.hindrance(ur.now) is None
    ur.inject("protective-stop")
    hindrance = ur.robot.hindrance(ur.now)
    assert hindrance is not None
    assert not hindrance.by_order
    assert not ur.write(*pose, 0.002, 0.1, 300.0, Command.SERVO, 2).taken
    count = len(ur.received)
    ur.write(*pose, 0.002, 0.1, 300.0, Command.IDLE, 2)
    assert len(ur.received) == count


def test_ur_rtde_commands_are_reported() -> None:
    ur = Ur(UR_TARGET, (*("DOUBLE",) * 11, "INT32"))
    ur.upload(register_program())
    servo = ur.write(0.9, -0.1, 0.599, math.pi, 0.0, 0.0, 0.0, 0.0, 0.002, 0.1, 300.0, 24)
    assert (servo.words, servo.taken) == ("servoj", True)
    assert place_of(servo) == pytest.approx((0.9, -0.1, 0.599))
    speed = ur.write(*(0.0,) * 11, 10)
    assert (speed.words, speed.pose, speed.moves) == ("speedl", None, False)
    count = len(ur.received)
    ur.write(*(0.0,) * 11, 16)  # servoStop
    assert len(ur.received) == count


OWN = """def own():
  while True:
    if read_input_integer_register(0) == 1:
      q = get_inverse_kin(p[read_input_float_register(0), -0.1, 0.6, 3.141592653589793, 0, 0])
      servoj(q, t=0.002, lookahead_time=0.1, gain=300)
    elif read_input_integer_register(0) == 2:
      speedl([0, 0, read_input_float_register(0), 0, 0, 0], 0.5, 0.002)
    else:
      sync()
    end
  end
end
"""


def own_program() -> Ur:
    ur = Ur(("input_double_register_0", "input_int_register_0"), ("DOUBLE", "INT32"))
    assert not ur.upload(OWN).moves
    return ur


def test_program_motions_are_reported_even_after_stop() -> None:
    ur = own_program()
    servo = ur.write(0.899, 1)
    assert (servo.act, servo.words, servo.taken) == (Act.MOTION, "servoj", True)
    assert place_of(servo) == pytest.approx((0.899, -0.1, 0.6), abs=1e-6)
    speed = ur.write(0.01, 2)
    assert (speed.words, speed.taken, speed.moves) == ("speedl", True, True)
    assert not ur.write(0.0, 2).moves
    ur.inject("protective-stop")
    for _ in range(2):
        behind = ur.write(0.898, 1)
        assert (behind.words, behind.taken) == ("servoj", False)
        assert place_of(behind) == pytest.approx((0.898, -0.1, 0.6), abs=1e-6)


def test_silent_or_idle_client_after_stop_orders_nothing() -> None:
    ur = own_program()
    ur.write(0.01, 2)
    ur.inject("protective-stop")
    count = len(ur.received)
    ur.robot.controller.advance(ur.now + 1.0)
    ur.now += 1.0
    ur.write(0.01, 0)
    ur.write(0.01, 0)
    assert len(ur.received) == count


def test_continuing_motion_is_reported_once() -> None:
    ur = own_program()
    ur.write(0.01, 2)
    count = len(ur.received)
    ur.robot.controller.advance(ur.now + 1.0)
    assert len(ur.received) == count


def test_rehearsal_has_no_effect() -> None:
    ur = Ur(("input_int_register_0",), ("INT32",))
    ur.upload(
        "def own():\n  while read_input_integer_register(0) < 3:\n    sync()\n  end\n"
        "  write_output_integer_register(1, 5)\n  set_standard_digital_out(1, True)\n  zero_ftsensor()\n"
        "  set_tcp(p[0, 0, 0.3, 0, 0, 0])\n  set_payload(3)\n"
        '  textmsg("behind")\n  movej([0, 0, 0, 0, 0, 0])\n  x = 1 / 0\nend\n'
    )
    ur.inject("protective-stop")
    controller = ur.robot.controller
    before = (
        controller.io.outputs,
        controller.manipulator.tcp,
        controller.force.payload,
        controller.force.zeros,
        controller.arm.joints,
    )
    assert ur.write(3).words == "move in joints"
    assert before == (
        controller.io.outputs,
        controller.manipulator.tcp,
        controller.force.payload,
        controller.force.zeros,
        controller.arm.joints,
    )
    assert not [
        saying for saying in controller.console.program_messages if saying.text == "behind" or saying.line
    ]


READS = {
    "popup_open", "clock", "flags", "random", "read_register", "read_integer", "read_digital", "read_analog", "output",
    "joints", "target", "speeds", "target_speeds", "tcp", "payload", "forward", "solve", "damping", "gain_scaling",
    "speed_scaling",
    "steps_since_contact", "joints_before",
}  # fmt: skip


def test_rehearsal_prevents_every_robot_action() -> None:
    """A new action of the host fails here until the rehearsal leaves it out, or it is known to be read-only."""
    public = {name for name in vars(ControllerHost) if not name.startswith("_")}
    assert public - {*vars(DryHost)} == READS


def test_program_moves_are_reported_at_start() -> None:
    ur = Ur(("input_int_register_0",), ("INT32",))
    ur.upload(
        "def mine():\n  movel(pose_add(get_actual_tcp_pose(), p[0, 0, 0.01, 0, 0, 0]), a=1, v=0.1)\nend\n"
    )
    moves = [order for order in ur.received if order.act is Act.MOTION]
    assert [(order.words, order.taken) for order in moves] == [("move along a line", True)]
    assert place_of(moves[0]) == pytest.approx((0.9, -0.1, 0.61), abs=1e-3)
    ur.inject("protective-stop")
    ur.write(1)
    assert [order for order in ur.received if order.act is Act.MOTION] == moves


def test_unknown_program_and_release_are_reported() -> None:
    ur = Ur(("input_int_register_0",), ("INT32",))
    assert ur.upload("def mine():\n  q = [0, 0, 0, 0, 0, 0]\n  movej(q)\nend\n").moves
    ur.inject("protective-stop")
    assert not ur.upload("def mine():\n  q = [0, 0, 0, 0, 0, 0]\n  movej(q)\nend\n").taken
    ur.dashboard.receive(b"unlock protective stop\n", ur.now)
    assert (ur.received[-1].act, ur.received[-1].words) == (Act.RELEASE, "dashboard: unlock protective stop")
    ur.rtde.receive(b"\x00\x05\xff\r\n", ur.now)
    assert ur.received[-1].act is Act.UNREADABLE


# --- EGM and RSI


def test_egm_reports_poses_speeds_and_unreadable_data() -> None:
    robot = EgmController(EgmProfile(), START, T0, 7)
    received = listening(robot)
    robot.handle_deadline(T0 + 0.1)
    place = Pose((0.9, -0.1, 0.59), START.quaternion)
    robot.receive([encode_answer(SensorMessage(1, 5, to_wire(place)))], T0 + 0.1)
    robot.receive([encode_answer(SensorMessage(2, 5, speed=(0.0, 0.0, 3.0)))], T0 + 0.1)
    robot.receive([encode_answer(SensorMessage(3, 5, speed=(0.0, 0.0, 0.0)))], T0 + 0.1)
    robot.receive([b"\xff"], T0 + 0.1)
    assert [(order.act, order.moves) for order in received] == [
        (Act.MOTION, True), (Act.MOTION, True), (Act.MOTION, False), (Act.UNREADABLE, True)
    ]  # fmt: skip
    assert place_of(received[0]) == pytest.approx(place.position)
    robot.handle_deadline(T0 + 2.0)  # its time-out
    assert robot.hindrance(T0 + 2.0) is not None
    robot.receive([encode_answer(SensorMessage(9, 5, to_wire(place)))], T0 + 2.0)
    assert not received[-1].taken


@pytest.mark.parametrize(("mode", "second"), [("relative", 0.6 - 2e-4), ("absolute", 0.6 - 1e-4)])
def test_rsi_reports_sum_of_corrections(mode: Literal["relative", "absolute"], second: float) -> None:
    robot = RsiController(RsiProfile(mode=mode), START, T0)
    received = listening(robot)
    answer: Callable[[float], bytes] = lambda z: encode(  # noqa: E731
        Telegram(SENSOR, RsiProfile().sentype, {"RKorr.X": "0", "RKorr.Y": "0", "RKorr.Z": f"{z}"}, 1)
    )
    ledger = Ledger(RSI_FAULTS)
    ledger.attach("robot", robot.handlers["robot"])
    ledger.inject("robot", "emergency-stop", T0, {})
    robot.receive([answer(-0.1), answer(-0.1), b"<Sen"], T0)
    assert [order.act for order in received] == [Act.MOTION, Act.MOTION, Act.UNREADABLE]
    assert place_of(received[1]) == pytest.approx((0.9, -0.1, second))
    assert not received[1].taken
    hindrance = robot.hindrance(T0)
    assert hindrance is not None
    assert not hindrance.by_order


def test_unsupported_orders_are_reported_as_refused() -> None:
    ur = Ur(("input_int_register_0",), ("INT32",))
    ur.rtde.receive(inputs_request(("input_of_tomorrow",)), T0)
    assert (ur.received[-1].act, ur.received[-1].words) == (Act.REFUSED, "variable input_of_tomorrow")
    ur.upload("def mine():\n  rg_grip(1)\nend\n")
    assert (Act.REFUSED, "URScript rg_grip(), which is not known here") in [
        (o.act, o.words) for o in ur.received
    ]
    ur.upload("def mine(:\n")
    ur.upload("end\n")
    assert ur.received[-1].act is Act.UNREADABLE
    robot = EgmController(EgmProfile(), START, T0, 7)
    received = listening(robot)
    robot.receive([encode_answer(SensorMessage(1, 5, joints_deg=(0.0,) * 6))], T0)
    assert (received[0].act, received[0].words) == (
        Act.REFUSED,
        "joints, but EGM runs in mode pose, see cell.egm.mode",
    )
    rsi = RsiController(RsiProfile(), START, T0)
    received = listening(rsi)
    rsi.receive([encode(Telegram(SENSOR, "ImFree", {"EKorr.E1": "0.1"}, 1))], T0)
    assert (received[0].act, received[0].words.partition(",")[0]) == (Act.REFUSED, "tag EKorr.E1")
