"""Judging a client that corrects axes, by the positions that its orders lead to."""

import pytest

from emulators.devices.rsi import RsiController, RsiProfile
from emulators.devices.rsi.correction import TOO_FAST
from emulators.seams import StartPose
from hil_bridge.lab.conform.robots.scenarios import Rules
from hil_bridge.lab.conform.robots.watching import RobotEvidence, ToolSample, Watch
from protocol.devices.rsi import SENSOR, Telegram, axis_tags, decode, encode, fixed

EPOCH = 100.0
STANDING = ToolSample((0.9, 0.0, 0.6), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def judgement_of(steps_deg: list[float]) -> RobotEvidence:
    """Return the judgement of a client that corrects axis 1 by these values, cycle by cycle."""
    profile = RsiProfile(mode="absolute", move_after_ms=0.0)
    robot = RsiController(profile, StartPose((0.9, 0.0, 0.6), (0.0, 1.0, 0.0, 0.0)), EPOCH)
    watch = Watch(EPOCH, Rules(), stops=False, from_start=False)
    robot.orders.listener = watch.receive
    for axis in [*steps_deg, steps_deg[-1]]:
        due = robot.endpoint.next_deadline()
        assert due is not None
        robot.endpoint.handle_deadline(due)
        watch.update(due, STANDING, robot.hindrance(due))
        for raw in robot.endpoint.data_to_send(due):
            texts = {**dict.fromkeys(axis_tags("AK"), "0"), "AK.A1": fixed(axis, 6)}
            answer = encode(Telegram(SENSOR, "ImFree", texts, decode(bytes(raw)).ipoc))
            robot.endpoint.receive([answer], due + 0.001)
    return watch.seen


def test_steady_axis_client_orders_small_steps() -> None:
    observed = judgement_of([0.1 * k for k in range(11)])
    assert observed.taken >= 10
    assert observed.own_stop == ""
    assert observed.leaps == 0
    # 0.1° at 0.9 m
    assert observed.largest_step_m == pytest.approx(0.00157, abs=1e-5)


def test_axis_leap_is_stopped_by_the_client() -> None:
    observed = judgement_of([0.0, 0.0, 5.0, 5.0])
    assert observed.own_stop == TOO_FAST
    assert observed.largest_step_m == pytest.approx(0.0785, abs=1e-3)
