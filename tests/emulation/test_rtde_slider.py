"""Tests that the speed slider of the emulated Universal Robot affects every motion, in virtual time."""

import math
from typing import Any

import pytest

from emulators.devices.rtde.panel import RTDE_CONTROLS
from protocol.devices.rtde import packets
from protocol.devices.rtde.packets import Kind
from tests.emulation.rtde_desk import Desk, outputs_of, values_of
from tests.emulation.test_urscript_motion import Bench

HERE = "get_actual_tcp_pose()"
MOVES = {
    "movej": "movej(pose_add(here, p[0,0.06,0,0,0,0]), a=1.4, v=0.1)",
    "movel": "movel(pose_add(here, p[0,0.06,0,0,0,0]), a=1.2, v=0.1)",
    "movep": "movep(pose_add(here, p[0,0.06,0,0,0,0]), a=1.2, v=0.1)",
    "movec": "movec(pose_add(here, p[0.02,0.03,0,0,0,0]), pose_add(here, p[0,0.06,0,0,0,0]), a=1.2, v=0.1)",
    "optimovel": "optimovel(pose_add(here, p[0,0.06,0,0,0,0]), a=0.3, v=0.1)",
    "optimovej": "optimovej(get_inverse_kin(pose_add(here, p[0,0.06,0,0,0,0])), a=0.3, v=0.05)",
}


def duration(move: str, slider: float) -> float:
    """Return the time for which a program of this move plays, s."""
    bench = Bench()
    bench.controller.io.slider = slider
    bench.send(f"def mine():\n  here = {HERE}\n  {move}\nend\n")
    bench.run(0.1)
    begin = bench.now
    while bench.controller.player.program is not None:
        bench.run(bench.controller.period)
    assert bench.place == pytest.approx((0.9, -0.04, 0.6), abs=1e-4)
    return bench.now - begin


@pytest.mark.sweep
@pytest.mark.parametrize("move", MOVES.values(), ids=MOVES)
def test_slider_stretches_every_planned_move(move: str) -> None:
    begun = 0.05
    """Of the 0.1 s before the measured time the program has played so long, s."""
    complete, quarter = duration(move, 1.0) + begun, duration(move, 0.25) + begun
    assert quarter == pytest.approx(4.0 * complete, abs=0.02)


def test_slider_at_0_pauses_move() -> None:
    bench = Bench()
    bench.send(f"movel(pose_add({HERE}, p[0,0.06,0,0,0,0]), a=1.2, v=0.1)\n")
    bench.run(0.4)
    bench.controller.io.slider = 0.0
    bench.run(0.02)
    stopped_at = bench.place
    bench.run(1.0)
    assert bench.place == pytest.approx(stopped_at, abs=1e-9)
    assert -0.08 < stopped_at[1] < -0.05
    bench.controller.io.slider = 0.5
    bench.run(1.0)
    assert bench.place == pytest.approx((0.9, -0.04, 0.6), abs=1e-6)


@pytest.mark.parametrize("by", ["panel", "fault", "input"])
def test_slider_acts_for_every_client(by: str) -> None:
    desk = Desk()
    desk.upload(f"movel(pose_add({HERE}, p[0,0.06,0,0,0,0]), a=1.2, v=0.1)\n")
    plug = desk.plug()
    recipe = outputs_of(plug, "speed_scaling", "target_speed_fraction")
    desk.run(0.3)
    _put_down(desk, by)
    desk.run(0.02)
    stopped_at = desk.place
    desk.run(0.3)
    assert desk.place == pytest.approx(stopped_at, abs=1e-9)
    plug.send(packets.encode(Kind.START))
    plug.packets()
    desk.run(0.02)
    assert values_of(plug, recipe)[-1] == {"speed_scaling": 0.0, "target_speed_fraction": 0.0}


def _put_down(desk: Desk, by: str) -> None:
    if by == "panel":
        control: Any = RTDE_CONTROLS.controls["speed"]
        control.turn(desk.robot, 0.0, desk.now)
    elif by == "fault":
        desk.inject("robot", "slider", percent=0.0, for_s=60.0)
    else:
        desk.controller.write_inputs(
            ("speed_slider_mask", "speed_slider_fraction"),
            {"speed_slider_mask": 1, "speed_slider_fraction": 0.0},
        )


def test_joint_speed_is_scaled_by_slider() -> None:
    bench = Bench()
    bench.controller.io.slider = 0.25
    bench.send("speedj([0, 0, 0, 0, 0, 0.4], a=2, t=1)\n")
    bench.run(0.5)
    assert bench.controller.arm.speeds[5] == pytest.approx(0.1)
    bench.controller.io.slider = 0.0
    bench.run(0.2)
    assert bench.controller.arm.speeds[5] == 0.0


def test_speedj_without_time_ends_at_scaled_speed() -> None:
    bench = Bench()
    bench.controller.io.slider = 0.5
    bench.send("def mine():\n  speedj([0, 0, 0, 0, 0, 0.4], a=2)\n  stopj(2)\nend\n")
    bench.run(0.5)
    assert bench.controller.player.program is None
    assert math.isclose(max(map(abs, bench.controller.arm.speeds)), 0.0)
