"""Position loops of six joints behind a delay."""

import pytest

from emulators.arm.joint_loops import STILL, JointLoops
from emulators.arm.loops import PositionLoop

CYCLE_S, DELAY_CYCLES = 0.004, 3
LOOP = PositionLoop(60.0, 1.0)
GOAL = (1.0, -2.0, 0.5, 0.0, 3.0, -1.0)


def test_step_follows_the_closed_form_after_the_delay() -> None:
    loops = JointLoops(STILL, LOOP, DELAY_CYCLES * CYCLE_S, CYCLE_S)
    for cycle in range(1, 40):
        joints = loops.follow(GOAL, False)
        remaining, _ = LOOP.response(max(0, cycle - DELAY_CYCLES) * CYCLE_S)
        assert joints == pytest.approx([goal * (1.0 - remaining) for goal in GOAL], abs=1e-12)


def test_loops_come_to_rest_exactly_at_the_goal() -> None:
    loops = JointLoops(STILL, LOOP, 0.0, CYCLE_S)
    for _ in range(200):
        loops.follow(GOAL, False)
    assert (loops.joints, loops.rates) == (GOAL, STILL)


def test_shorter_delay_waits_until_the_arm_is_still() -> None:
    loops = JointLoops(STILL, LOOP, CYCLE_S, CYCLE_S)
    loops.delay(4 * CYCLE_S)
    for _ in range(10):
        loops.follow(GOAL, False)
    assert loops.delay_s == pytest.approx(5 * CYCLE_S)
    loops.delay(0.0)
    loops.follow(GOAL, False)
    assert loops.delay_s == pytest.approx(5 * CYCLE_S)
    for _ in range(10):
        loops.follow(GOAL, True)
    assert loops.delay_s == pytest.approx(CYCLE_S)


def test_rest_discards_the_delayed_set_points() -> None:
    loops = JointLoops(STILL, LOOP, 2 * CYCLE_S, CYCLE_S)
    loops.follow(GOAL, False)
    loops.rest(STILL)
    assert [loops.follow(STILL, False) for _ in range(3)] == [STILL] * 3
