"""Tests of payload, zero and slow errors of actual_TCP_force of the emulated Universal Robot, in virtual time.

Figures of the payload: Universal Robots' forum, thread 2053. Zero at the start of a program:
Universal_Robots_ROS_Driver, issues 512 and 643.
"""

import math
from dataclasses import replace

import pytest

from emulators.arm.own_force import OwnForce
from emulators.devices.rtde import RtdeProfile
from emulators.devices.rtde.drives import own_errors
from protocol.geometry import Vector
from tests.emulation.exact_arm import EXACT
from tests.emulation.test_urscript_force import HOLD, Surface
from tests.emulation.test_urscript_motion import T0, Bench

E_SERIES = replace(EXACT, zero_at_start=False)
"""Settings without the zero that would hide the effect of a payload."""
CB3 = replace(EXACT, model="ur10", force_point="tcp", zero_at_start=False)


def bench_with_load(mass: float, centre: Vector, profile: RtdeProfile = E_SERIES) -> Bench:
    bench = Bench(profile)
    bench.robot.carry(mass, centre)
    return bench


def force(bench: Bench) -> tuple[float, ...]:
    bench.run(0.004)
    return bench.controller.snapshots[-1].force


def play(bench: Bench, line: str, seconds: float = 0.1) -> None:
    bench.send(f"{line}\n")
    bench.run(seconds)


def test_correct_payload_leaves_no_force() -> None:
    bench = bench_with_load(1.0, (0.1, 0.0, 0.0))
    assert force(bench) == pytest.approx((0.0,) * 6, abs=1e-12)
    assert bench.controller.force.payload == (1.0, 0.1, 0.0, 0.0)
    play(bench, "set_payload(1, [0.1, 0, 0])")
    assert force(bench) == pytest.approx((0.0,) * 6, abs=1e-12)


def test_unset_payload_appears_in_force() -> None:
    """The tool points down: x of the flange is base x, and y of the flange is opposite to base y."""
    bench = bench_with_load(1.0, (0.1, 0.0, 0.0))
    play(bench, "set_payload(0)")
    assert force(bench) == pytest.approx((0.0, 0.0, -9.82, 0.0, 0.982, 0.0), abs=1e-9)
    play(bench, "set_payload(2, [0.1, 0, 0])")
    assert force(bench) == pytest.approx((0.0, 0.0, 9.82, 0.0, -0.982, 0.0), abs=1e-9)


def test_payload_moment_on_cb3_is_about_tool() -> None:
    bench = bench_with_load(1.0, (0.1, 0.0, 0.0), CB3)
    play(bench, "set_tcp(p[0.1, 0, 0, 0, 0, 0])")
    play(bench, "set_payload(0)")
    assert force(bench) == pytest.approx((0.0, 0.0, -9.82, 0.0, 0.0, 0.0), abs=1e-9)


def test_wrong_centre_turns_with_flange() -> None:
    bench = bench_with_load(1.0, (0.1, 0.0, 0.0))
    play(bench, "set_payload(1, [0, 0, 0])")
    assert force(bench) == pytest.approx((0.0, 0.0, 0.0, 0.0, 0.982, 0.0), abs=1e-9)
    play(bench, "movej(pose_trans(get_actual_tcp_pose(), p[0,0,0,0,0,1.5707963267948966]), t=1)", 1.5)
    result = force(bench)
    assert abs(result[3]) == pytest.approx(0.982, abs=1e-6)
    assert result[4] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        ("1.0, [0, 0, 0]", (0.0, 0.0, 9.82, 0.0, 0.0, 0.0)),
        ("1.0, [0.1, 0, 0]", (0.0, 0.0, 9.82, 0.0, -0.982, 0.0)),
        ("1.0, [0, 0.1, 0]", (0.0, 0.0, 9.82, -0.982, 0.0, 0.0)),
        ("0, [0, 0, 0]", (0.0,) * 6),
    ],
)
def test_external_zeros_show_payload(payload: str, expected: tuple[float, ...]) -> None:
    """The flange's y axis is opposite to base y, so the third row has the opposite sign to the thread."""
    bench = bench_with_load(0.0, (0.0, 0.0, 0.0))
    bench.send(
        f"def mine():\n  set_tcp(p[0,0,0,0,0,0])\n  set_payload({payload})\n  ft_rtde_input_enable(True)\n"
        "  sleep(9)\nend\n"
    )
    bench.run(0.06)
    bench.controller.write_inputs(("external_force_torque",), {"external_force_torque": (0.0,) * 6})
    assert force(bench) == pytest.approx(expected, abs=1e-9)


def test_external_force_acts_at_tool() -> None:
    bench = bench_with_load(0.0, (0.0, 0.0, 0.0))
    bench.send("def mine():\n  set_tcp(p[0,0,0.2,0,0,0])\n  ft_rtde_input_enable(True)\n  sleep(9)\nend\n")
    bench.run(0.06)
    wrench = (3.0, 0.0, 0.0, 0.0, 0.6, 0.0)
    bench.controller.write_inputs(("external_force_torque",), {"external_force_torque": wrench})
    assert force(bench) == pytest.approx((3.0, 0.0, 0.0, 0.0, 0.0, 0.0), abs=1e-9)


def test_wrong_payload_makes_force_mode_drift() -> None:
    bench = bench_with_load(1.0, (0.0, 0.0, 0.0))
    free = HOLD.replace("-10", "0")
    bench.send(f"def mine():\n  {free}\n  sleep(9)\nend\n")
    bench.run(0.5)
    assert bench.place[2] == pytest.approx(0.6, abs=1e-6)
    bench.send(f"def mine():\n  set_payload(0)\n  {free}\n  sleep(9)\nend\n")
    bench.run(0.5)
    before = bench.place[2]
    bench.run(1.0)
    gained = 1.0 - math.exp(-EXACT.cycle_ms / EXACT.force_mode_lag_ms)
    kept = (1.0 - EXACT.force_mode_damping) * (1.0 - gained)
    speed = EXACT.force_mode_gain_mm_s_n * 9.82e-3 * gained / (1.0 - kept)
    assert before - bench.place[2] == pytest.approx(speed, rel=1e-3)


@pytest.mark.parametrize(("zeroes", "reported"), [(True, 0.0), (False, 10.0)])
def test_program_started_in_contact_shows_zero(zeroes: bool, reported: float) -> None:
    """The surface pushes with 10 N before the program starts, and no longer afterwards."""
    bench = Surface(5e3, replace(EXACT, zero_at_start=False))
    play(bench, "movel(pose_add(get_actual_tcp_pose(), p[0,0,-0.004,0,0,0]), t=0.5)", 1.0)
    assert force(bench)[2] == pytest.approx(10.0, abs=0.01)
    bench.controller.profile = replace(bench.controller.profile, zero_at_start=zeroes)
    play(bench, "sleep(0.5)", 0.3)
    assert force(bench)[2] == pytest.approx(reported, abs=0.01)
    play(bench, "sync()", 0.3)
    bench.send("movel(pose_add(get_actual_tcp_pose(), p[0,0,0.02,0,0,0]), t=0.5)\n")
    bench.run(1.0)
    assert force(bench)[2] == pytest.approx(reported - 10.0, abs=0.01)


@pytest.mark.parametrize(("model", "zeroes", "axes"), [("ur10e", True, "flange"), ("ur10", False, "flange")])
def test_generations_have_different_zero(model: str, zeroes: bool, axes: str) -> None:
    profile = RtdeProfile(model=model)  # type: ignore[arg-type]
    assert (profile.zero_at_start, profile.force_offset_axes) == (zeroes, axes)


def test_zero_at_start_removes_offset_in_every_orientation() -> None:
    bench = Bench(replace(EXACT, force_offset_n=4.5))
    before = force(bench)
    assert max(map(abs, before)) > 0.5
    turn = "movej(pose_trans(get_actual_tcp_pose(), p[0,0,0,0,0,1.5]), t=1)"
    play(bench, turn, 0.5)
    assert force(bench) == pytest.approx((0.0,) * 6, abs=1e-9)
    bench.run(1.0)
    assert force(bench) == pytest.approx((0.0,) * 6, abs=1e-9)


def test_offset_turns_with_flange() -> None:
    bench = Bench(replace(EXACT, force_offset_n=4.5, zero_at_start=False))
    before = force(bench)
    play(bench, "movej(pose_trans(get_actual_tcp_pose(), p[0,0,0,0,0,1.5707963267948966]), t=1)", 1.5)
    x, y, z = force(bench)[:3]
    assert z == pytest.approx(before[2], abs=1e-6)
    assert sorted((abs(x), abs(y))) == pytest.approx(sorted(map(abs, before[1::-1])), abs=1e-6)
    assert (x, y) != pytest.approx(before[:2], abs=0.1)


def test_nan_force_is_not_zeroed() -> None:
    bench = Bench(EXACT)
    injection = bench.robot.handlers["witness"]["nan"]
    assert injection is not None
    bench.controller.force.own.level = (float("nan"),) * 6
    bench.controller.force._weights = ((float("nan"),) * 6,) * 2
    bench.controller.zero_force()
    assert bench.controller.force.zeros == ((0.0,) * 6,) * 2


def test_warm_up_changes_zero() -> None:
    sensor = OwnForce(own_errors(replace(EXACT, force_warm_up_n=4.0)), 7)
    assert sensor.at(T0)[:3] == (0.0, 0.0, 0.0)
    after, late = (sensor.at(T0 + seconds)[:3] for seconds in (300.0, 3000.0))
    assert 1.0 < max(map(abs, late)) < 4.0
    assert after == pytest.approx([0.9502 * part for part in late], rel=1e-3)
    assert OwnForce(own_errors(EXACT), 7).at(T0 + 300.0)[:3] == (0.0, 0.0, 0.0)


def test_contact_creeps_if_set() -> None:
    bench = Surface(5e3, replace(EXACT, force_creep_share=0.02, force_creep_s=5.0, zero_at_start=False))
    play(bench, "movel(pose_add(get_actual_tcp_pose(), p[0,0,-0.004,0,0,0]), t=0.1)", 0.3)
    early = force(bench)[2]
    bench.run(25.0)
    assert force(bench)[2] - early == pytest.approx(0.2, abs=0.02)
