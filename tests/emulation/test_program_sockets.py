"""Tests of connections that a program opens: its end of them in virtual time, with the faults of their wire.

The program is ours: like external control, it connects to a server and follows the servo targets it receives each
cycle.
"""

import struct
from typing import Any

import pytest

from emulators.devices.rtde import RTDE_FAULTS, RtdeRobot, Server
from emulators.devices.rtde.program_socket import ENOUGH, UNREAD_MAX, ProgramSocket
from emulators.devices.rtde.urscript import Message
from emulators.devices.rtde.urscript.limits import READS_MAX
from emulators.faults import Ledger
from emulators.seams import StartPose
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.wires import Port
from tests.emulation.exact_arm import exact_profile

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
T0, DT = 1000.25, 0.002
STREAMED = """def streamed():
  if not socket_open("127.0.0.1", 50001, "reverse"):
    textmsg("no server")
    halt
  end
  q = get_actual_joint_positions()
  timeout = 0
  while True:
    given = socket_read_binary_integer(8, "reverse", timeout)
    if given[0] != 8 or given[8] == -2:
      textmsg("ended with ", given[0])
      stopj(4)
      halt
    end
    timeout = given[1] / 1000.0
    servoj([given[2] / 1000000.0, q[1], q[2], q[3], q[4], q[5]], t=0.002, lookahead_time=0.03, gain=2000)
  end
end
"""


MOVED = "movel(pose_add(get_actual_tcp_pose(), p[0, 0.2, 0, 0, 0, 0]), a=0.5, v=0.1)\n"


class Ear:
    """External server, the controller with a program connected to it, and the time."""

    def __init__(self, text: str, opens_after: int = 0) -> None:
        """The server accepts a connection after some cycles."""
        self.now = T0
        profile = exact_profile(start_delay_ms=0.0)
        self.robot = RtdeRobot(profile, START, T0, 7)
        self.controller = self.robot.controller
        self.ledger = Ledger(RTDE_FAULTS)
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)
        self.ends: list[tuple[Server, ProgramSocket]] = []
        self.requests: list[tuple[str, int]] = []
        self.received = b""
        self._opens_after = opens_after
        self.controller.console.open_socket = self._open
        self._text = text

    def _open(self, host: str, port: int) -> ProgramSocket:
        self.requests.append((host, port))
        self.ends.append(self.robot.connect_program(self.now))
        return self.ends[-1][1]

    def play(self) -> "Ear":
        port = self.robot.connect(Port.SCRIPT, self.now)
        assert port is not None
        port.receive(self._text.encode(), self.now)
        return self.run(2)

    def run(self, cycles: int) -> "Ear":
        for _ in range(cycles):
            self.now += DT
            self.ledger.handle_deadline(self.now)
            for server, inner in self.ends:
                server.handle_deadline(self.now)
                self.received += server.data_to_send(self.now)
                if inner.opening and self._opens_after <= 0:
                    inner.opened()
            self.controller.advance(self.now)
            self._opens_after -= 1
        return self

    def send(self, data: bytes) -> None:
        self.ends[-1][0].receive(data, self.now)

    def stream(self, cycles: int, joint: float, timeout_ms: int = 20, mode: int = 1) -> "Ear":
        """Send a message in each cycle."""
        for _ in range(cycles):
            self.send(message(joint, timeout_ms, mode))
            self.run(1)
        return self

    def messages(self, kind: Message = Message.TEXT) -> list[str]:
        return [str(each) for each in self.controller.console.program_messages if each.message == kind]

    def inject(self, name: str, on: str = "program-wire", **how: Any) -> None:
        self.ledger.inject(on, name, self.now, how)

    @property
    def plays(self) -> bool:
        return self.controller.player.runtime == Runtime.PLAYING


def message(joint: float, timeout_ms: int = 20, mode: int = 1) -> bytes:
    return struct.pack(">8i", timeout_ms, round(joint * 1e6), 0, 0, 0, 0, 0, mode)


@pytest.fixture
def ear() -> Ear:
    """Return a server with a program that follows its targets, with the first target."""
    ear = Ear(STREAMED).play().run(3)
    assert ear.requests == [("127.0.0.1", 50001)]
    return ear


def base(ear: Ear) -> float:
    return ear.controller.arm.joints[0]


def test_program_servos_to_targets_of_server(ear: Ear) -> None:
    start = base(ear)
    ear.run(500)
    assert ear.plays, "the first read waits for ever"
    for step in range(100):
        ear.stream(1, start + step * 1e-4)
    ear.stream(100, start + 0.01)
    assert base(ear) == pytest.approx(start + 0.01, abs=1e-5)
    ear.stream(1, start, mode=-2)
    ear.run(5)
    assert ear.messages() == ["ended with 8"]
    assert ear.ends[0][0].closing, "the connection ends with the program"


def test_missing_message_stops_arm(ear: Ear) -> None:
    ear.stream(10, base(ear), timeout_ms=20)
    ear.run(9)
    assert ear.plays
    ear.run(20)
    assert ear.messages() == ["ended with 0"]
    assert ear.controller.manipulator.still


def test_fragmented_messages_keep_their_order(ear: Ear) -> None:
    start = base(ear)
    data = message(start, 20) + message(start, -2, -2)
    for byte in data[:-1]:
        ear.send(bytes((byte,)))
    ear.run(3)
    assert ear.plays
    ear.send(data[-1:])
    ear.run(3)
    assert ear.messages() == ["ended with 8"]


def test_server_disconnect_ends_read_at_once(ear: Ear) -> None:
    ear.stream(3, base(ear), timeout_ms=0)
    ear.run(100)
    assert ear.plays
    ear.ends[0][0].close(ear.now)
    ear.run(3)
    assert ear.messages() == ["ended with 0"]


def test_data_before_disconnect_is_read(ear: Ear) -> None:
    ear.send(message(base(ear), 0))
    ear.send(message(base(ear), 0, -2))
    ear.ends[0][0].close(ear.now)
    ear.run(6)
    assert ear.messages() == ["ended with 8"]


def test_unresponsive_server_times_out_after_2_s() -> None:
    ear = Ear(STREAMED, opens_after=10_000).play()
    ear.run(990)
    assert ear.plays
    ear.run(20)
    assert ear.messages() == ["no server"]
    assert ear.ends[0][0].closing


def test_stopped_program_closes_connections(ear: Ear) -> None:
    ear.controller.player.stop(ear.controller.now)
    assert ear.ends[0][0].closing


def test_endless_server_data_does_not_exhaust_memory(ear: Ear) -> None:
    ear.stream(1, base(ear), timeout_ms=0)
    ear.inject("program-paused", on="robot")
    ear.run(2)
    for _ in range(3):
        ear.send(bytes(UNREAD_MAX // 2))
    assert ear.ends[0][0].closing
    assert ear.controller.counts["sockets of programs closed, too much unread"] == 1


def test_unread_data_holds_server_back(ear: Ear) -> None:
    start = base(ear)
    states: list[bool] = []
    ear.ends[0][1].hold = states.append
    count = ENOUGH // 32 + 10
    ear.send(message(start) * (count - 1) + message(start, mode=-2))
    assert states == [True]
    ear.run(5)
    assert states == [True]
    ear.run(10)
    assert states == [True, False]
    ear.run(count)
    assert ear.messages() == ["ended with 8"], "no message was lost"


def test_number_of_reads_per_cycle_is_limited() -> None:
    text = (
        'def reader():\n  socket_open("127.0.0.1", 50001, "pc")\n  n = 0\n  while True:\n'
        '    socket_read_binary_integer(1, "pc", 0)\n    n = n + 1\n'
        "    write_output_integer_register(0, n)\n  end\nend\n"
    )
    ear = Ear(text).play().run(3)
    ear.send(bytes(4 * 1000))
    numbers = [ear.run(1).controller.io.outputs.get("output_int_register_0") for _ in range(5)]
    assert numbers == [READS_MAX * count + 1 for count in range(1, 6)], "one has begun before"
    ear.run(200)
    assert ear.plays
    assert ear.controller.io.outputs["output_int_register_0"] == 1000


# --- faults


def test_late_messages_stop_program_with_shorter_timeout(ear: Ear) -> None:
    ear.stream(10, base(ear), timeout_ms=20)
    ear.inject("late", ms=15.0)
    ear.stream(40, base(ear), timeout_ms=20)
    assert ear.plays
    ear.inject("late", ms=30.0)
    ear.stream(40, base(ear), timeout_ms=20)
    assert ear.messages() == ["ended with 0"]


@pytest.mark.parametrize("fault", ["off", "deaf"])
@pytest.mark.parametrize("target", ["program-wire", "wire"])
def test_cut_wire_stops_program(ear: Ear, fault: str, target: str) -> None:
    ear.stream(10, base(ear), timeout_ms=20)
    ear.inject(fault, on=target)
    ear.stream(20, base(ear), timeout_ms=20)
    assert ear.messages() == ["ended with 0"]
    assert ear.controller.manipulator.still


def test_closed_connection_ends_read_and_can_reopen(ear: Ear) -> None:
    ear.stream(10, base(ear), timeout_ms=0)
    ear.inject("dropped")
    ear.run(2)
    assert ear.messages() == ["ended with 0"]
    assert ear.ledger.injections[0].struck == 1
    ear.run(200)
    assert ear.controller.manipulator.still
    ear.play().run(3).stream(5, base(ear))
    assert ear.plays


def test_fault_during_motion_stops_arm_in_place() -> None:
    """The move continues from there, along its line, when the program is played again."""
    for fault in ("protective-stop", "program-paused", "program-stopped"):
        ear = Ear(MOVED).play().run(300)
        ear.inject(fault, on="robot")
        ear.run(200)
        stopped_at = ear.controller.arm.joints
        ear.run(300)
        assert ear.controller.manipulator.still
        assert ear.controller.arm.joints == stopped_at
        ear.run(2000)
        ear.controller.state.unlock(ear.controller.now)
        ear.controller.play()
        ear.run(20)
        assert ear.controller.path.pose.position[2] == pytest.approx(0.6, abs=1e-3)
        ear.run(1500)
        went_on = ear.controller.path.pose.position[1] == pytest.approx(0.1, abs=1e-3)
        assert went_on is (fault != "program-stopped")


def test_half_message_shifts_all_following_data(ear: Ear) -> None:
    """The first half of one message, and of the next one its first half: the target is invalid, and the arm stops."""
    ear.stream(10, base(ear), timeout_ms=20)
    ear.inject("malformed", count=1)
    ear.stream(2, base(ear), timeout_ms=20, mode=1)
    ear.stream(40, 2.0, timeout_ms=20)
    assert not ear.plays
    assert ear.ledger.injections[0].struck == 1


def test_program_wire_fault_affects_program_connections_only() -> None:
    ear = Ear(STREAMED).play().run(3)
    dashboard = ear.robot.connect(Port.DASHBOARD, ear.now)
    assert dashboard is not None
    dashboard.data_to_send(ear.now)
    ear.inject("off")
    ear.run(1)
    dashboard.receive(b"running\n", ear.now)
    assert dashboard.data_to_send(ear.now) == b"Program running: true\n"
    ear.inject("off", on="wire")
    ear.run(1)
    dashboard.receive(b"running\n", ear.now)
    assert dashboard.data_to_send(ear.now) == b""
