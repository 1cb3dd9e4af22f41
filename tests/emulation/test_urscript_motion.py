"""Tests of URScript on the emulated arm: motion in virtual time, contact, and hostile texts."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.rtde import RtdeProfile, RtdeRobot
from emulators.devices.rtde.urscript import Message
from emulators.seams import StartPose
from protocol.devices.rtde.states import Runtime, SafetyMode
from protocol.devices.rtde.wires import Port
from tests.emulation.exact_arm import exact_profile

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
T0 = 1000.25


NEW = exact_profile(version="5.21.0.0")
"""First version with all motions."""


class Bench:
    """Robot, a client of its script port, and the time."""

    def __init__(self, profile: RtdeProfile = NEW, start: StartPose = START, seed: int = 7) -> None:
        self.now = T0
        self.robot = RtdeRobot(profile, start, T0, seed)
        self.controller = self.robot.controller
        server = self.robot.connect(Port.SCRIPT, T0)
        assert server is not None
        self.port = server

    def send(self, text: str) -> None:
        self.port.receive(text.encode(), self.now)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.controller.period)):
            self.now += self.controller.period
            self.controller.advance(self.now)

    def messages(self, kind: Message) -> list[str]:
        return [str(saying) for saying in self.controller.console.program_messages if saying.message == kind]

    @property
    def place(self) -> tuple[float, float, float]:
        return self.controller.path.pose.position


def test_single_statement_moves_arm() -> None:
    bench = Bench()
    bench.send("movel(pose_add(get_actual_tcp_pose(), p[0, 0.05, 0, 0, 0, 0]), a=1, v=0.1)\n")
    bench.run(1.0)
    assert bench.place == pytest.approx((0.9, -0.05, 0.6), abs=1e-6)
    assert bench.controller.player.runtime == Runtime.STOPPED


@pytest.mark.parametrize("move", ["movej", "optimovej"])
def test_move_beyond_joint_range_ends_program(move: str) -> None:
    bench = Bench()
    before = bench.place
    bench.send(f"def mine():\n  {move}([-123, 0, 0, 0, 0, 0])\n  movej([0, -1.57, 1.57, 0, 0, 0])\nend\n")
    bench.run(0.5)
    assert bench.controller.player.runtime == Runtime.STOPPED
    assert bench.controller.state.safety == SafetyMode.NORMAL
    assert bench.messages(Message.RUNTIME) == [
        "runtime error in line 2: the end of this move is beyond a joint's range"
    ]
    assert bench.place == before
    bench.send("movej([6.28, -1.57, 1.57, 0, 0, 0], t=20)\n")
    bench.run(0.5)
    assert bench.controller.player.runtime == Runtime.PLAYING, "an end within the range"


def test_move_takes_requested_time() -> None:
    bench = Bench()
    bench.send("movel(pose_add(get_actual_tcp_pose(), p[0, 0.05, 0, 0, 0, 0]), t=1)\n")
    bench.run(0.95)
    assert bench.controller.player.runtime == Runtime.PLAYING
    bench.run(0.15)
    assert bench.controller.player.runtime == Runtime.STOPPED
    assert bench.place[1] == pytest.approx(-0.05, abs=1e-6)


@pytest.mark.parametrize(
    ("move", "least_s"),
    [
        ("movej([3, -1.4, -2, -1.3, 1.57, 0], t=0.1)", 0.95),
        ("movel(pose_add(get_actual_tcp_pose(), p[0, 0.6, 0, 0, 0, 0]), t=0.1)", 0.4),
        ("movel(pose_add(get_actual_tcp_pose(), p[0, 0, 0, 0, 0, 2.5]), a=99, v=99)", 0.75),
    ],
)
def test_move_in_too_short_time_takes_longer(move: str, least_s: float) -> None:
    """The limits are 3.14 rad/s of a joint and 1.5 m/s of the flange."""
    bench = Bench()
    bench.send(f"{move}\n")
    bench.run(0.05 + least_s)
    assert bench.controller.player.runtime == Runtime.PLAYING
    bench.run(2.0)
    assert bench.controller.state.safety == SafetyMode.NORMAL, bench.controller.state.stop_reason
    assert bench.controller.player.runtime == Runtime.STOPPED
    assert bench.controller.manipulator.still


def test_arc_passes_through_via_point() -> None:
    bench = Bench()
    bench.send(
        "def mine():\n  h = get_actual_tcp_pose()\n"
        "  movec(pose_add(h, p[0, 0.05, 0.05, 0, 0, 0]), pose_add(h, p[0, 0.1, 0, 0, 0, 0]), a=1, v=0.1)\nend\n"
    )
    distances = []
    for _ in range(200):
        bench.run(0.01)
        distances.append(math.dist(bench.place, (0.9, -0.05, 0.65)))
    assert min(distances) < 2e-3
    assert bench.place == pytest.approx((0.9, 0.0, 0.6), abs=1e-6)


def test_speed_lasts_its_time_then_stops() -> None:
    bench = Bench()
    bench.send("def mine():\n  speedl([0, 0, 0.05, 0, 0, 0], a=2, t=0.5)\n  stopl(2)\nend\n")
    bench.run(1.0)
    assert bench.place[2] == pytest.approx(0.625, abs=3e-3)
    assert bench.controller.manipulator.still


def test_pose_out_of_reach_ends_program() -> None:
    bench = Bench()
    bench.send("movej(p[9, 9, 9, 0, 0, 0])\n")
    bench.run(0.2)
    assert bench.place == pytest.approx((0.9, -0.1, 0.6), abs=1e-9)
    assert bench.messages(Message.RUNTIME) == ["runtime error in line 1: no joints hold this pose"]


def test_line_out_of_reach_causes_locked_stop() -> None:
    bench = Bench()
    bench.send("movel(p[9, 9, 9, 0, 0, 0])\n")
    while bench.controller.state.safety == SafetyMode.NORMAL:
        assert bench.now < T0 + 10.0
        bench.run(0.01)
    bench.send("set unlock protective stop\n")
    bench.run(5.1)
    assert bench.controller.state.safety == SafetyMode.PROTECTIVE_STOP, "the early order is not kept"
    assert bench.controller.counts["unlock refused"] == 1
    bench.send("set unlock protective stop\n")
    bench.run(0.1)
    assert bench.controller.state.safety == SafetyMode.NORMAL


def test_line_is_followed_until_it_leaves_workspace() -> None:
    """As ordered by a program that moves in a direction until contact."""
    bench = Bench()
    bench.send("movel(pose_add(get_actual_tcp_pose(), p[0, 0, 1000, 0, 0, 0]), a=0.5, v=0.05)\n")
    bench.run(2.0)
    assert bench.place == pytest.approx((0.9, -0.1, 0.695), abs=3e-3)
    assert bench.controller.state.safety == SafetyMode.NORMAL
    bench.run(30.0)
    assert bench.controller.state.safety == SafetyMode.PROTECTIVE_STOP
    assert 0.7 < bench.place[2] < 1.3


def test_program_that_never_waits_is_stopped() -> None:
    bench = Bench()
    bench.send("def mine():\n  while True:\n    x = 1\n  end\nend\n")
    bench.run(0.1)
    assert bench.controller.player.runtime == Runtime.STOPPED
    assert "infinite loop" in bench.messages(Message.RUNTIME)[0]


def test_servoc_thread_continues_at_goal() -> None:
    """A client's thread calls it forever; a later goal is also approached."""
    bench = Bench()
    bench.send(
        "def mine():\n  global goal = pose_add(get_actual_tcp_pose(), p[0, 0.02, 0, 0, 0, 0])\n"
        "  thread follow():\n    while True:\n      servoc(goal, a=1, v=0.1)\n    end\n  end\n"
        "  run follow()\n  sleep(1)\n  goal = pose_add(goal, p[0, 0.02, 0, 0, 0, 0])\n  sleep(1)\nend\n"
    )
    began = bench.place
    bench.run(0.9)
    assert bench.place == pytest.approx((began[0], began[1] + 0.02, began[2]), abs=1e-6)
    bench.run(0.9)
    assert bench.place == pytest.approx((began[0], began[1] + 0.04, began[2]), abs=1e-6)
    assert bench.messages(Message.RUNTIME) == []


def test_secondary_program_runs_in_parallel_without_motion() -> None:
    bench = Bench()
    bench.send("def mine():\n  sleep(1)\nend\n")
    bench.run(0.1)
    bench.send("sec side():\n  set_digital_out(1, True)\nend\nsec moves():\n  stopl(1)\nend\n")
    assert bench.controller.io.outputs["actual_digital_output_bits"] == 2
    assert bench.controller.player.runtime == Runtime.PLAYING
    assert "must not move" in bench.messages(Message.RUNTIME)[0]


def test_move_continues_until_contact() -> None:
    """A surface of 20 kN/m at 0.58 m; the program stops at 10 N of its own force estimate."""
    bench = Bench()

    def contact(at: float) -> tuple[float, float, float]:
        return 0.0, 0.0, max(0.0, (0.58 - bench.place[2]) * 20e3)

    bench.robot.feel(contact)
    bench.send(
        "def touch():\n  zero_ftsensor()\n"
        "  thread down():\n    movel(pose_add(get_actual_tcp_pose(), p[0, 0, -0.1, 0, 0, 0]), a=1, v=0.005)\n  end\n"
        "  h = run down()\n  while get_tcp_force()[2] < 10:\n    sync()\n  end\n  kill h\n  stopl(5)\n"
        '  textmsg("contact")\nend\n'
    )
    bench.run(6.0)
    assert bench.messages(Message.TEXT) == ["contact"]
    assert 0.5793 < bench.place[2] < 0.5795


WORDS = (
    "def f():", "thread t():", "end", "while True:", "if x:", "else:", "x = 1", "x = [x, x]", "x[0] = x", "run t()",
    "join 1", "kill 2", "f()", "return f()", "x = make_list(4000, 1.5)", "x = x * x", "s = str_cat(s, s)", "s = \"a\"",
    "sync()", "movel(x)", "textmsg(x)", "x = pow(9, 999)", "(" * 80, "halt", "x.append(x)", "$", "p[1,2,3,4,5,6]",
)  # fmt: skip


@settings(max_examples=60, deadline=4000)
@given(st.lists(st.sampled_from(WORDS), max_size=25))
def test_arbitrary_text_does_not_break_controller(words: list[str]) -> None:
    bench = Bench(RtdeProfile(script_steps=2000, start_delay_ms=2.0))
    bench.send("def mine():\n  x = 1\n  " + "\n  ".join(words) + "\nend\n")
    bench.run(0.02)
    assert all(map(math.isfinite, bench.controller.arm.joints))


@settings(max_examples=60, deadline=4000)
@given(st.binary(max_size=200))
def test_arbitrary_bytes_do_not_break_script_port(data: bytes) -> None:
    bench = Bench()
    bench.port.receive(data + b"\n", bench.now)
    bench.run(0.01)
