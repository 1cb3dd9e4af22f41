"""Suites for robots, and tests of the arm in closed loop and of its two ends without a wire."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from toy_robot.emulator import Arm
from toy_robot.room import ROBOT
from toy_robot.wire import REPORT, TARGET, ArmClient

import hil_bridge
from emulators.arm.followed import FollowedProfile
from emulators.orders import Act, ReceivedOrder
from emulators.seams import StartPose
from hil_bridge.testing import RobotCase
from hil_bridge.testing.robot_clients import *  # noqa: F403
from hil_bridge.testing.robot_emulators import *  # noqa: F403
from protocol.robot import ReportReceived

START = StartPose((0.9, 0.0, 0.6), (0.0, 1.0, 0.0, 0.0))

NEAR = {"start_position_mm": [900.0, -100.0, 593.0]}  # just above the surface


@pytest.fixture
def robot_client() -> RobotCase:
    return RobotCase(ROBOT, stop=("robot", "emergency-stop"), numbered=True)


@pytest.fixture
def robot_emulator() -> RobotCase:
    return RobotCase(ROBOT)


def test_the_loop_closes_over_the_arm() -> None:
    result = hil_bridge.simulate(
        {"robot": {"emulated": "toyarm"}, "run": {"duration_s": 1.0}, "cell": NEAR}, seed=7
    )
    assert result.outcome == "completed", result.text
    assert abs(result.figures.force_mean_steady_n - 10.0) < 0.5


@pytest.mark.parametrize(
    ("fault", "words"), [("mute", "sent nothing for 0.5 s"), ("emergency-stop", "it is stopped; release it")]
)
def test_an_arm_that_fails_ends_the_run(fault: str, words: str) -> None:
    failing = {"on": "robot", "fault": fault, "phase": "track", "after_s": 0.2}
    site = {"robot": {"emulated": "toyarm"}, "run": {"duration_s": 1.0}, "cell": NEAR}
    result = hil_bridge.simulate(site, faults=[failing], seed=7)
    assert result.outcome == "stopped"
    assert words in result.text


def test_client_and_arm_understand_each_other() -> None:
    client, arm = ArmClient(0.0), Arm(FollowedProfile(), START, 0.0)
    client.handle_deadline(0.0)
    arm.receive(client.data_to_send(0.0), 0.0)
    arm.handle_deadline(0.0)
    client.receive(arm.data_to_send(0.0), 0.0)
    event = client.next_event()
    assert isinstance(event, ReportReceived)
    assert event.report.pose.position == START.position
    client.target(event.report.pose._replace(position=(0.9, 0.0, 0.599)), 0.001)
    arm.receive(client.data_to_send(0.001), 0.001)
    assert arm.targets.accepted == 1


def test_a_client_that_looks_at_the_stop_passes(hil_conform: Callable[..., Any]) -> None:
    client = [sys.executable, str(Path(__file__).with_name("client.py")), "{host}", "{port}"]
    hil_conform("toyarm", client, "stopped", react_s=2.0, watch_s=3.0, start_s=30.0)


def test_orders_are_told_to_a_judge() -> None:
    arm = Arm(FollowedProfile(), START, 0.0)
    received: list[ReceivedOrder] = []
    arm.orders.listener = received.append
    arm.receive([TARGET.pack(b"AT", 0, *START.position, *START.quaternion)], 0.001)
    arm.receive([TARGET.pack(b"AT", 0, *START.position, float("nan"), 0.0, 0.0, 0.0)], 0.002)
    assert [(order.act, order.taken) for order in received] == [(Act.MOTION, True), (Act.UNREADABLE, False)]
    assert arm.hindrance(0.003) is None


def test_what_is_no_report_is_ignored() -> None:
    client = ArmClient(0.0)
    client.receive([b"", b"AR", bytes(REPORT.size), b"AR" + bytes(REPORT.size)], 0.0)
    assert client.next_event() is None
