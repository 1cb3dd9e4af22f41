"""Leaps, turns and speeds of orders, judged by a robot's facts and the client's own rate."""

import math

import pytest

from emulators.orders import Act, Reach, ReceivedOrder
from hil_bridge.lab.conform.robots.judging import judge
from hil_bridge.lab.conform.robots.scenarios import Rules
from hil_bridge.lab.conform.robots.strides import Stride, Strides
from hil_bridge.lab.conform.robots.watching import RobotEvidence, ToolSample, Watch
from hil_bridge.lab.conform.verdict import Outcome
from protocol.geometry import Pose, turn_by

STREAM = Reach(0.004, 0.25, 1.0)
"""1 mm and 4 mrad per cycle."""
PLANNED = Reach(0.004, 0.02, 1.0, plans_own_path=True)
LEVEL = (1.0, 0.0, 0.0, 0.0)
TOOL = Pose((0.0, 0.0, 0.0), LEVEL)


def order(at: float, z: float, turn: float = 0.0, reach: Reach | None = STREAM) -> ReceivedOrder:
    pose = Pose((0.0, 0.0, z), turn_by((turn, 0.0, 0.0)))
    return ReceivedOrder(at, Act.MOTION, "pose", True, pose, reach=reach)


def path(orders: list[ReceivedOrder]) -> list[Stride]:
    """Return the strides of these orders, with a tool that is stationary at the start."""
    strides = Strides(0.05)
    return [strides.take(each, TOOL) for each in orders]


def steady(
    count: int, period: float, speed: float, reach: Reach = STREAM, turn: float = 0.0
) -> list[ReceivedOrder]:
    return [order(k * period, k * period * speed, turn, reach) for k in range(count)]


@pytest.mark.parametrize("period", [0.004, 0.02, 0.04])
def test_steady_path_of_any_rate_has_no_leap(period: float) -> None:
    strides = path(steady(100, period, 0.1))
    assert not any(stride.leaps or stride.turns for stride in strides)
    assert strides[-1].speed_m_s == pytest.approx(0.1)


@pytest.mark.parametrize("sent", [(0.2, 0.4, 0.8, -0.4), (0.8, -0.4, 0.2, 0.4), (-0.4, 0.2, 0.4, 0.8)])
def test_quaternion_in_wrong_order_is_named(
    sent: tuple[float, float, float, float],
) -> None:
    tool = Pose((0.0, 0.0, 0.0), (-0.4, 0.2, 0.4, 0.8))
    stride = Strides(0.05).take(
        ReceivedOrder(0.0, Act.MOTION, "pose", True, Pose(tool.position, sent), reach=STREAM), tool
    )
    assert stride.turns == stride.w_misplaced == (sent != tool.quaternion)
    observed = RobotEvidence(
        contact_at=0.1, moved_at=0.3, turns=1, largest_turn_rad=stride.turn_rad, w_misplaced=True, exit_code=0
    )
    assert (
        "the w of its quaternion seems to be at the wrong end" in judge("nominal", observed, Rules()).reason
    )
    assert not path([order(0.0, 0.0), order(0.004, 0.0, 2.0)])[-1].w_misplaced, "a different kind of turn"


@pytest.mark.parametrize("period", [0.004, 0.02])
@pytest.mark.parametrize("reach", [STREAM, PLANNED])
def test_leap_of_18_mm_after_gap_is_reported_by_default(period: float, reach: Reach) -> None:
    orders = steady(50, period, 0.018, reach)
    last = orders[-1]
    assert last.pose is not None
    strides = path([*orders, order(last.at + 1.0, last.pose.position[2] + 0.018, 0.0, reach)])
    assert [stride.leaps for stride in strides] == [False] * 50 + [True]


def test_client_resuming_after_gap_does_not_leap() -> None:
    orders = steady(50, 0.004, 0.02)
    assert not path([*orders, order(3.0, 50 * 0.004 * 0.02)])[-1].leaps
    assert not path([*orders, order(3.0, 0.0)])[-1].leaps  # where the tool is


def test_step_after_short_computer_pause_is_no_leap() -> None:
    orders = steady(50, 0.004, 0.2)
    late = 49 * 0.004 + 0.03
    assert not path([*orders, order(late, late * 0.2)])[-1].leaps
    assert path([*orders, order(late, late * 0.2 + 0.004)])[-1].leaps


def test_first_order_is_judged_from_tool_position() -> None:
    assert path([order(0.0, 0.03)])[0].leaps
    turned = path([order(0.0, 0.0, math.radians(120.0))])[0]
    assert turned.turns
    assert turned.turn_rad == pytest.approx(math.radians(120.0))
    assert not path([order(0.0, 0.001, 0.01)])[0].leaps


def test_planned_move_to_start_is_no_leap() -> None:
    strides = path(
        [order(0.0, 0.1, 0.0, PLANNED), *[order(0.1 * k, 0.1 + 1e-3 * k, 0.0, PLANNED) for k in range(1, 30)]]
    )
    assert not any(stride.leaps for stride in strides)
    strides = path(steady(30, 0.1, 0.01, PLANNED, turn=2.0))
    assert sum(stride.turns for stride in strides) == 1
    assert max(stride.turn_rad for stride in strides) == pytest.approx(2.0)


def test_planned_move_allows_any_step() -> None:
    assert not path([order(0.0, 0.5, 2.0, None), order(5.0, 0.0, 0.0, None)])[-1].leaps


def test_order_above_robot_speed_is_reported() -> None:
    fast = ReceivedOrder(0.0, Act.MOTION, "speed", True, reach=STREAM, speed=(20.0, 0.0))
    assert Strides(0.05).take(fast, TOOL).rushes
    assert not Strides(0.05).take(fast._replace(speed=(0.2, 0.0)), TOOL).rushes
    assert Strides(0.05).take(fast._replace(speed=(0.0, 2.0)), TOOL).rushes


def watched(orders: list[ReceivedOrder]) -> RobotEvidence:
    watch = Watch(0.0, Rules(), stops=False, from_start=False)
    watch.update(0.0, ToolSample((0.0, 0.0, 0.0), LEVEL, (0.0, 0.0, 0.0)), None)
    for each in orders:
        watch.receive(each)
    watch.seen.moved_at, watch.seen.exit_code = 0.1, 0
    return watch.seen


def test_each_violation_reports_figure_and_rule() -> None:
    leap = watched([*steady(50, 0.004, 0.02), order(1.0, 0.03)])
    assert "1 of its orders leap, by up to 26.1 mm" in judge("nominal", leap, Rules()).reason
    assert judge("nominal", leap, Rules(max_step_mm=30.0)).outcome is Outcome.PASSED
    turn = watched([order(0.0, 0.0, math.radians(120.0))])
    assert (
        "1 of its orders rotate the tool abruptly, by up to 120.0°" in judge("nominal", turn, Rules()).reason
    )
    assert judge("nominal", turn, Rules(max_turn_deg=130.0)).outcome is Outcome.PASSED
    assert (
        "a rotation of 120.00° between two orders" in judge("nominal", turn, Rules(max_turn_deg=10.0)).reason
    )
    rush = watched([ReceivedOrder(0.0, Act.MOTION, "speed", True, reach=STREAM, speed=(20.0, 0.0))])
    assert "exceed the robot's speed, with up to 20000 mm/s" in judge("nominal", rush, Rules()).reason
    assert rush.largest_speed_m_s == pytest.approx(20.0)


def test_instant_full_speed_is_not_a_path() -> None:
    watch = Watch(0.0, Rules(), stops=False, from_start=False)
    watch.receive(order(0.0, 0.0))
    for k, speed in enumerate((0.0, 0.0, 0.2, -0.2)):
        watch.update(0.01 * k, ToolSample((0.0, 0.0, 0.0), LEVEL, (0.0, 0.0, speed)), None)
    watch.seen.moved_at = 0.1
    reason = judge("nominal", watch.seen, Rules()).reason
    assert (
        "the tool's speed changed by 400 mm/s within 50 ms, more than the robot's top speed of 250" in reason
    )
    assert judge("nominal", watch.seen, Rules(speed_up_s=0.0)).outcome is Outcome.PASSED


def test_many_wire_violations_fail() -> None:
    orders = steady(50, 0.004, 0.02)
    few = [each._replace(breach="number 1" if k < 3 else "") for k, each in enumerate(orders)]
    assert judge("nominal", watched(few), Rules()).outcome is Outcome.PASSED
    many = watched([each._replace(breach="number 1") for each in orders])
    assert (
        "50 of its 50 orders violate the protocol, such as number 1" in judge("nominal", many, Rules()).reason
    )


def test_unsupported_scenario_is_skipped_with_reason() -> None:
    watch = Watch(0.0, Rules(), stops=False, from_start=False)
    watch.receive(ReceivedOrder(1.0, Act.REFUSED, "joints, but EGM runs in mode pose", False))
    observed = watch.seen
    observed.exit_code, observed.ended_at = 1, 2.0
    verdict = judge("nominal", observed, Rules())
    assert verdict.outcome is Outcome.SKIPPED
    assert "this emulated robot does not support: joints, but EGM runs in mode pose" in verdict.reason
    observed.exit_code = -11
    assert judge("nominal", observed, Rules()).outcome is Outcome.FAILED
    observed.exit_code = 1
    watch.receive(order(2.0, 0.01))  # an accepted order moved the tool, so it is judged
    observed.moved_at = 2.0
    assert judge("nominal", observed, Rules()).outcome is Outcome.FAILED
