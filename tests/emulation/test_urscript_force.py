"""Tests of force mode, freedrive and contact of the emulated Universal Robot on an elastic surface."""

import math

import pytest

from emulators.devices.rtde import RtdeProfile
from emulators.devices.rtde.contact import BEGIN_SHARE
from emulators.devices.rtde.urscript import Message
from emulators.seams import StartPose
from protocol.devices.rtde.states import Runtime, SafetyMode
from protocol.geometry import Vector
from tests.emulation.exact_arm import EXACT
from tests.emulation.test_urscript_motion import START, T0, Bench

SURFACE_Z = 0.598
"""Height of the surface, m: 2 mm below the tool at the usual start."""
T_PUSHED = T0 + 0.3
"""Time at which a push by hand ends, s."""
T_PLAYS = T0 + 0.1
"""Time at which the push begins: a program that starts is zeroed, and does not detect an earlier push."""
HOLD = "force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,-10,0,0,0], 2, [0.1,0.1,0.1,0.2,0.2,0.2])"


class Surface(Bench):
    """Bench 2 mm above a surface that pushes along base z."""

    def __init__(
        self, stiffness_n_m: float, profile: RtdeProfile = EXACT, start: StartPose = START, seed: int = 7
    ) -> None:
        super().__init__(profile, start, seed)
        self.stiffness, self.height = stiffness_n_m, start.position[2] - 0.002
        self.robot.feel(self.contact)

    def contact(self, at: float) -> Vector:
        return 0.0, 0.0, self.force

    @property
    def force(self) -> float:
        """Return the present force of the surface, N."""
        return max(0.0, (self.height - self.place[2]) * self.stiffness)

    def forces(self, seconds: float) -> list[float]:
        result = []
        for _ in range(round(seconds / self.controller.period)):
            self.run(self.controller.period)
            result.append(self.force)
        return result


@pytest.mark.parametrize(("stiffness_n_m", "settling_s"), [(5e3, 4.0), (50e3, 1.5)])
def test_force_mode_holds_force(stiffness_n_m: float, settling_s: float) -> None:
    """The peak is below that of the mass of 65 kg after 2 mm of acceleration, on the spring without damping."""
    bench = Surface(stiffness_n_m)
    bench.send(f"def hold():\n  zero_ftsensor()\n  {HOLD}\n  sleep(30)\nend\n")
    complete = bench.forces(settling_s)
    forces = bench.forces(1.0)
    mean = sum(forces) / len(forces)
    rms = math.sqrt(sum((force - mean) ** 2 for force in forces) / len(forces))
    print(f"\n{stiffness_n_m:g} N/m: mean {mean:.3f} N, RMS {rms:.3f} N, peak {max(complete):.3f} N")
    assert mean == pytest.approx(10.0, abs=0.05)
    assert rms < 0.05
    assert max(complete) < 10.0 + math.sqrt(10.0**2 + 2.0 * 10.0 * 2e-3 * stiffness_n_m)


def test_compliant_axis_speed_is_limited() -> None:
    bench = Surface(5e3)
    slow = HOLD.replace("0.1,0.1,0.1", "0.1,0.1,0.002")
    bench.send(f"def hold():\n  {slow}\n  sleep(9)\nend\n")
    bench.run(0.1)
    before = bench.place[2]
    bench.run(0.1)
    assert before - bench.place[2] == pytest.approx(0.0002, rel=1e-3)


def test_line_continues_while_force_is_held() -> None:
    """Perpendicular to the force the line is kept; along it the program's own motion has no effect."""
    bench = Surface(20e3)
    bench.send(
        f"def wipe():\n  {HOLD}\n  sleep(2)\n  here = get_actual_tcp_pose()\n"
        "  movel(pose_add(here, p[0,0.05,0.02,0,0,0]), a=1, v=0.05)\n  sleep(0.5)\nend\n"
    )
    bench.run(2.2)
    forces = bench.forces(0.8)
    bench.run(0.5)
    x, y, _ = bench.place
    assert (x, y) == pytest.approx((0.9, -0.05), abs=1e-4)
    assert forces == pytest.approx([10.0] * len(forces), abs=0.2)


def test_force_mode_ends_with_program() -> None:
    bench = Surface(5e3)
    bench.send(f"def hold():\n  {HOLD}\n  sleep(0.3)\nend\n")
    bench.run(0.6)
    assert bench.controller.player.runtime == Runtime.STOPPED
    assert not bench.controller.compliance.on
    before = bench.place
    bench.run(0.5)
    assert bench.place == before


def test_force_mode_is_inactive_while_paused() -> None:
    bench = Surface(5e3)
    bench.send(f"def hold():\n  {HOLD}\n  sleep(9)\nend\n")
    bench.run(0.2)
    bench.controller.player.pause()
    bench.run(0.1)
    before = bench.place
    bench.run(0.5)
    assert bench.place == before
    bench.controller.play()
    bench.run(0.5)
    assert bench.place[2] < before[2] - 1e-3


def test_protective_stop_applies_in_force_mode() -> None:
    bench = Surface(5e3)
    bench.send(f"def hold():\n  {HOLD}\n  sleep(9)\nend\n")
    bench.run(0.2)
    bench.controller.protective_stop("a test")
    before = bench.place
    bench.run(0.5)
    assert bench.place == pytest.approx(before, abs=1e-4), "no more than the braking distance"
    assert bench.controller.arm.motion == (0.0,) * 6


def test_too_fast_force_mode_is_stopped() -> None:
    bench = Bench(RtdeProfile(max_tcp_speed_mm_s=20.0, force_offset_n=0.0))
    bench.send(
        "def rush():\n  force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,100,0,0,0], 2, [1,1,1,1,1,1])\n  sleep(9)\nend\n"
    )
    bench.run(0.3)
    assert bench.controller.state.safety == SafetyMode.PROTECTIVE_STOP
    assert bench.controller.state.stop_reason == "the tool is too fast"


def test_force_mode_leaving_workspace_is_stopped() -> None:
    bench = Bench()
    bench.send(
        "def away():\n  force_mode(p[0,0,0,0,0,0], [1,0,0,0,0,0], [900,0,0,0,0,0], 2, [1,1,1,1,1,1])\n  sleep(9)\nend\n"
    )
    bench.run(4.0)
    assert bench.controller.state.safety == SafetyMode.PROTECTIVE_STOP
    assert bench.controller.player.runtime == Runtime.PAUSED


def test_damping_reduces_speed_without_force() -> None:
    """0 keeps the speed, 1 stops it in one cycle, as in the manual."""
    distances = []
    for damping in (0.0, 0.1, 1.0):
        bench = Bench()
        bench.robot.feel(lambda at: (0.0, 0.0, 20.0 if T_PLAYS < at < T_PUSHED else 0.0))
        bench.send(
            f"def float():\n  force_mode_set_damping({damping})\n"
            "  force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,0,0,0,0], 2, [1,1,1,1,1,1])\n  sleep(9)\nend\n"
        )
        bench.run(0.5)
        before = bench.place[2]
        bench.run(0.2)
        distances.append(bench.place[2] - before)
    assert distances[0] > 5e-5
    assert distances[0] > distances[1] >= distances[2]
    assert distances[2] == pytest.approx(0.0, abs=1e-9)


def test_gain_scaling_scales_speed() -> None:
    heights = []
    for scaling in (0.5, 2.0):
        bench = Bench()
        bench.send(f"def hold():\n  force_mode_set_gain_scaling({scaling})\n  {HOLD}\n  sleep(9)\nend\n")
        bench.run(0.2)
        before = bench.place[2]
        bench.run(0.1)
        heights.append(before - bench.place[2])
    assert heights[0] > 1e-3
    assert heights[1] == pytest.approx(4.0 * heights[0], rel=1e-3)


def test_type_1_frame_points_from_tool_to_origin() -> None:
    """The origin is 0.3 m from the tool along base x: its y axis is then base x."""
    bench = Bench()
    bench.send(
        "def point():\n"
        "  force_mode(p[1.2,-0.1,0.6,0,0,0], [0,1,0,0,0,0], [0,10,0,0,0,0], 1, [1,1,1,1,1,1])\n  sleep(9)\nend\n"
    )
    bench.run(0.5)
    x, y, z = bench.place
    assert x > 0.9 + 1e-3
    assert (y, z) == pytest.approx((-0.1, 0.6), abs=1e-6)


def test_type_3_frame_follows_motion_of_tool() -> None:
    bench = Bench()
    bench.send(
        "def follow():\n  force_mode(p[0,0,0,0,0,0], [0,1,0,0,0,0], [0,10,0,0,0,0], 3, [1,1,1,1,1,1])\n  sleep(0.5)\n"
        "  movel(pose_add(get_actual_tcp_pose(), p[0,0.05,0,0,0,0]), a=1, v=0.05)\n  sleep(9)\nend\n"
    )
    bench.run(0.5)
    assert bench.place == pytest.approx((0.9, -0.1, 0.6), abs=1e-9)
    bench.run(1.5)
    x, y, _ = bench.place
    assert x < 0.9 - 1e-3
    assert y == pytest.approx(-0.05, abs=1e-3)


def test_freedrive_follows_hand() -> None:
    bench = Bench()
    bench.robot.feel(lambda at: (30.0 if T_PLAYS < at < T_PUSHED else 0.0, 0.0, 0.0))
    bench.send("def free():\n  freedrive_mode()\n  sleep(9)\nend\n")
    bench.run(0.5)
    after_push = bench.place
    assert after_push[0] > 0.9 + 1e-3
    bench.run(0.5)
    assert bench.place == pytest.approx(after_push, abs=1e-9)


@pytest.mark.parametrize("stiffness_n_m", [5e3, 50e3])
def test_move_until_contact_ends_at_surface(stiffness_n_m: float) -> None:
    """The retraction leads to the position before contact, except for the distance within the force's delay."""
    bench = Surface(stiffness_n_m)
    bench.send(
        "def touch():\n  zero_ftsensor()\n  while True:\n"
        "    steps = tool_contact(direction=get_actual_tcp_speed())\n"
        "    if steps <= 0:\n      speedl([0,0,-0.005,0,0,0], 0.5, t=get_steptime())\n"
        "    else:\n      before = get_actual_joint_positions_history(steps)\n      stopl(3)\n      movel(before)\n"
        '      textmsg("contact ", steps)\n      break\n    end\n  end\nend\n'
    )
    deepest = max(bench.forces(3.0)) / stiffness_n_m
    assert bench.messages(Message.TEXT)[0].startswith("contact ")
    delay = (EXACT.force_lag_ms + 8.0 + 3 * EXACT.cycle_ms) * 1e-3
    depth = SURFACE_Z - bench.place[2]
    print(f"\n{stiffness_n_m:g} N/m: deepest {deepest * 1e3:.3f} mm, end {depth * 1e3:.3f} mm")
    assert abs(depth) < 0.005 * delay + BEGIN_SHARE * EXACT.tool_contact_n / stiffness_n_m + 1e-5
    assert deepest < 3.0 * EXACT.tool_contact_n / stiffness_n_m + 0.005 * 2.0 * delay


def test_contact_from_other_side_is_ignored() -> None:
    bench = Surface(50e3)
    bench.send(
        "def touch():\n  n = 0\n  while n == 0:\n    n = tool_contact(direction=[0,0,1,0,0,0])\n"
        "    speedl([0,0,-0.005,0,0,0], 0.5, t=get_steptime())\n  end\nend\n"
    )
    bench.run(0.7)
    assert bench.controller.player.runtime == Runtime.PLAYING
    assert bench.force > 3.0 * EXACT.tool_contact_n


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "force_mode(p[0,0,0,0,0,0], [1,0,0,0,0,0], [0,0,0,0,0,0], 4, [1,1,1,1,1,1])",
            "must be 1, 2 or 3, got 4",
        ),
        ("force_mode_set_damping(2)", "the damping of force mode must be from 0 to 1"),
        ("force_mode_set_gain_scaling(2.5)", "the gain scaling of force mode must be from 0 to 2"),
        ("tool_contact([0,0,0,0,0,0], -1)", "a force threshold must be at least 0"),
        ("get_actual_joint_positions_history(-1)", "the number of history steps must be at least 0"),
    ],
)
def test_value_out_of_range_ends_program(line: str, message: str) -> None:
    bench = Bench()
    bench.send(line + "\n")
    bench.run(0.1)
    assert message in bench.messages(Message.RUNTIME)[0]
