"""Tests of the axis channel of the emulated KUKA controller, driven by a small client of axis corrections."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from emulators.devices.rsi import RSI_CONTROLS, RSI_FAULTS, RsiController, RsiProfile
from emulators.devices.rsi.arm import OUT_OF_REACH
from emulators.devices.rsi.correction import AXES_TOO_FAR, TOO_FAST
from emulators.devices.rsi.session import State
from emulators.faults import Ledger
from emulators.orders import Act, ReceivedOrder
from emulators.seams import StartPose
from protocol.devices.rsi import SENSOR, Telegram, axis_tags, decode, encode, fixed, numbers, pose_tags
from protocol.devices.rsi.angles import pose_of
from protocol.devices.rsi.arm import MODELS, KukaArm
from protocol.geometry import rotate
from protocol.kinematics import Joints

T0 = 1000.0
START = StartPose((0.9, 0.1, 0.7), (0.0, 1.0, 0.0, 0.0))
SEND = ("DEF_RIst", "DEF_RSol", "DEF_AIPos", "DEF_ASPos", "DEF_Delay")
PLACES: tuple[Joints, ...] = (
    (0.0, -90.0, 90.0, 0.0, 0.0, 0.0),
    (0.0, -90.0, 90.0, 0.0, 90.0, 0.0),
    (20.0, -70.0, 110.0, 15.0, 40.0, -30.0),
    (-75.0, -40.0, 60.0, -100.0, -55.0, 200.0),
)


class AxisClient:
    """Client like the public drivers: it answers each telegram with corrections of the axes."""

    def __init__(self, element: str = "AK", **settings: Any) -> None:
        profile = RsiProfile(
            **{"mode": "absolute", "send": SEND, "move_after_ms": 0.0, "restart_s": 0.0, **settings}
        )
        self.robot = RsiController(profile, START, T0)
        self.ledger = Ledger(RSI_FAULTS)
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)
        self.element, self.now = element, T0

    def listen(self) -> Telegram | None:
        """Return the next telegram; None if nothing is sent."""
        due = self.robot.endpoint.next_deadline()
        assert due is not None
        self.now = due
        self.robot.endpoint.handle_deadline(due)
        sent = [decode(bytes(raw)) for raw in self.robot.endpoint.data_to_send(due)]
        return sent[0] if sent else None

    def answer(self, ipoc: int, axes: Sequence[float], **more: str) -> None:
        texts = {tag: fixed(value, 6) for tag, value in zip(axis_tags(self.element), axes, strict=True)}
        raw = encode(Telegram(SENSOR, "ImFree", {**texts, **more}, ipoc))
        self.robot.endpoint.receive([raw], self.now + 0.001)

    def cycle(self, axes: Sequence[float], **more: str) -> Telegram:
        telegram = self.listen()
        assert telegram is not None, self.robot.error
        self.answer(telegram.ipoc, axes, **more)
        return telegram

    def go(self, axes: Sequence[float], cycles: int) -> Telegram:
        """Move there from zero at constant speed, then wait until the arm has arrived."""
        for k in range(1, cycles + 1):
            self.cycle([k / cycles * axis for axis in axes])
        for _ in range(100):
            telegram = self.cycle(axes)
        return telegram


def axes_in(telegram: Telegram, element: str) -> list[float]:
    axes = numbers(telegram.values, axis_tags(element))
    assert axes is not None
    return axes


def test_poses_match_joint_chain_of_public_model() -> None:
    """The chain is written as in kuka_kr16_support: a position and an axis of each joint, then the flange."""
    chain = (
        ((0.0, 0.0, 0.675), (0, 0, -1)),
        ((0.26, 0.0, 0.0), (0, 1, 0)),
        ((0.68, 0.0, 0.0), (0, 1, 0)),
        ((0.67, 0.0, -0.035), (-1, 0, 0)),
        ((0.0, 0.0, 0.0), (0, 1, 0)),
        ((0.0, 0.0, 0.0), (-1, 0, 0)),
    )
    arm = KukaArm("kr16-2", 0.1)
    for axes in PLACES:
        place, turn = np.zeros(3), np.eye(3)
        for (offset, axis), angle in zip(chain, axes, strict=True):
            place = place + turn @ np.array(offset)
            turn = turn @ _turn(axis, math.radians(angle))
        place = place + turn @ np.array((0.158 + 0.1, 0.0, 0.0))
        turn = turn @ _turn((0, 1, 0), math.pi / 2)
        pose = arm.pose(axes)
        assert pose.position == pytest.approx(place, abs=1e-9)
        for column, unit in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
            assert rotate(pose.quaternion, unit) == pytest.approx(turn[:, column], abs=1e-9)


def _turn(axis: tuple[int, int, int], angle: float) -> Any:
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=float)
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def test_pose_to_axes_is_inverse() -> None:
    arm = KukaArm("kr16-2", 0.1)
    for axes in PLACES[1:]:
        near: Joints = tuple(axis + 3.0 for axis in axes)  # type: ignore[assignment]
        assert arm.holding(arm.pose(axes), near) == pytest.approx(axes, abs=1e-6)


def test_three_axes_follow_ten_degrees_and_back() -> None:
    client = AxisClient()
    first = client.cycle((0.0,) * 6)
    start = axes_in(first, "ASPos")
    arm = KukaArm("kr16-2", 0.0)
    reported: list[list[float]] = []
    expected: list[list[float]] = []
    for k in range(500):
        angle = 10.0 * math.sin(2.0 * math.pi * k / 500)
        correction = (angle, -angle, angle, 0.0, 0.0, 0.0)
        telegram = client.cycle(correction)
        reported.append(axes_in(telegram, "AIPos"))
        expected.append([at + by for at, by in zip(start, correction, strict=True)])
        assert axes_in(telegram, "ASPos") == start
        a, b, c, d, e, f = reported[-1]
        actual = numbers(telegram.values, pose_tags("RIst"))
        assert actual is not None
        assert arm.pose((a, b, c, d, e, f)).position == pytest.approx(pose_of(actual).position, abs=1e-5)
    # The lag of the model: 8 ms of transport, 2 / 60 s of the loops, the cycle that takes an answer, and one more.
    lag = round((0.008 + 2.0 / 60.0) / 0.004) + 1
    behind = np.array(reported[lag + 60 :]) - np.array(expected[60 : 500 - lag])
    assert np.abs(behind[:, :3]).max() < 0.25
    assert (
        np.abs(behind[:, :3]).max()
        < np.abs(np.array(reported[60:]) - np.array(expected[60:]))[:, :3].max() / 2
    )
    assert np.ptp(np.array(reported)[:, :3], axis=0) == pytest.approx([20.0] * 3, abs=0.2)
    assert client.robot.late == 0


def test_relative_axis_corrections_add_up() -> None:
    client = AxisClient(mode="relative")
    start = axes_in(client.cycle((0.0,) * 6), "ASPos")
    for _ in range(100):
        client.cycle((0.02, 0.0, -0.01, 0.0, 0.0, 0.0))
    for _ in range(100):
        telegram = client.cycle((0.0,) * 6)
    changes = [now - then for now, then in zip(axes_in(telegram, "AIPos"), start, strict=True)]
    assert changes == pytest.approx([2.0, 0.0, -1.0, 0.0, 0.0, 0.0], abs=2e-3)


def test_axis_limit_cuts_silently() -> None:
    client = AxisClient(lim_axis_deg=(90.0, 5.0, 90.0, 90.0, 90.0, 90.0))
    start = axes_in(client.cycle((0.0,) * 6), "ASPos")
    changes = np.array(axes_in(client.go((8.0, 8.0, 0.0, 0.0, 0.0, 0.0), 100), "AIPos")) - start
    assert changes[:2] == pytest.approx([8.0, 5.0], abs=2e-3)
    assert client.robot.state is State.MOVECORR
    displayed = RSI_CONTROLS.rows(RSI_CONTROLS.state(client.robot, client.now))
    assert displayed["of the axes"].split() == ["8.000", "5.000", *["0.000"] * 4, "°"]


def test_axes_may_be_cut_at_range_limits() -> None:
    """Source: ROS_SetAxisCorrLimits of kroshu/kuka-external-control-sdk: limits are the range limits minus the actual
    axis.
    """
    client = AxisClient(axis_ends="cut")
    start = axes_in(client.cycle((0.0,) * 6), "ASPos")
    end, travel = MODELS["kr16-2"].highest_deg[4], 85.0
    assert start[4] + travel > end + 1.0
    last = axes_in(client.go((0.0, 0.0, 0.0, 0.0, travel, 0.0), 400), "AIPos")
    assert last[4] == pytest.approx(end, abs=2e-3)
    assert client.robot.state is State.MOVECORR


def test_axis_monitor_ends_rsi() -> None:
    client = AxisClient(mon_axis_deg=(90.0, 90.0, 6.0, 90.0, 90.0, 90.0))
    client.go((8.0, 0.0, 6.0, 0.0, 0.0, 0.0), 100)
    client.cycle((8.0, 0.0, 6.001, 0.0, 0.0, 0.0))
    assert client.listen() is None
    assert client.robot.error == AXES_TOO_FAR
    hindrance = client.robot.hindrance(client.now)
    assert hindrance is not None
    assert hindrance.by_order


def test_axis_jump_stops_by_correction() -> None:
    step = MODELS["kr16-2"].axis_speeds_deg_s[0] * 0.004
    client = AxisClient()
    client.cycle((0.0,) * 6)
    client.cycle((step, 0.0, 0.0, 0.0, 0.0, 0.0))
    client.cycle((2.001 * step, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert client.listen() is None
    assert client.robot.error == TOO_FAST


def test_correction_beyond_axis_range_stops_robot() -> None:
    client = AxisClient(restart_s=1.0)
    start = axes_in(client.cycle((0.0,) * 6), "ASPos")
    beyond = MODELS["kr16-2"].highest_deg[2] - start[2] + 0.01
    assert 1.0 < beyond < 85.0
    for k in range(1, 201):
        telegram = client.listen()
        if telegram is None:
            break
        client.answer(telegram.ipoc, (0.0, 0.0, k / 200 * beyond, 0.0, 0.0, 0.0))
    else:
        assert client.listen() is None
    assert client.robot.error == OUT_OF_REACH
    for _ in range(260):
        telegram = client.listen()
    assert telegram is not None
    assert axes_in(telegram, "ASPos")[2] > start[2] + beyond / 2


def test_pose_out_of_reach_stops_robot() -> None:
    client = AxisClient(lim_mm=3000.0, mon_mm=3000.0, max_step_mm=10.0)
    for k in range(1, 300):
        telegram = client.listen()
        if telegram is None:
            break
        texts = dict.fromkeys(pose_tags("RKorr"), "0") | {"RKorr.X": fixed(5.0 * k, 6)}
        raw = encode(Telegram(SENSOR, "ImFree", texts, telegram.ipoc))
        client.robot.endpoint.receive([raw], client.now + 0.001)
    assert client.robot.error == OUT_OF_REACH


def test_both_axis_tags_act_and_others_are_reported() -> None:
    client = AxisClient("AKorr")
    reply = client.go((3.0, 0.0, 0.0, 0.0, 0.0, 0.0), 50)
    start = axes_in(reply, "ASPos")
    assert axes_in(reply, "AIPos")[0] - start[0] == pytest.approx(3.0, abs=2e-3)
    assert not client.robot.unmodelled.things
    client.cycle((3.0, 0.0, 0.0, 0.0, 0.0, 0.0), **{"EK.E1": "1", "AK.A1": "3.1"})
    assert [thing.thing for thing in client.robot.unmodelled.things] == ["tag EK.E1"]
    for _ in range(100):
        reply = client.cycle((3.0, 0.0, 0.0, 0.0, 0.0, 0.0), **{"AK.A1": "3.1"})
    assert axes_in(reply, "AIPos")[0] - start[0] == pytest.approx(3.1, abs=2e-3)


def test_tool_force_appears_in_axis_torques() -> None:
    """A push of 10 N upwards: its torque at axis 2 is given by its lever arm; at axis 1 it is zero."""
    client = AxisClient(send=("DEF_AIPos", *axis_tags("GearTorque"), "OvPro.R", "ProgStatus.R", "DEF_MACur"))
    client.robot.feel(lambda at: (0.0, 0.0, 10.0))
    telegram = client.cycle((0.0,) * 6)
    torques = axes_in(telegram, "GearTorque")
    lever = math.hypot(0.9, 0.1) - 0.26
    assert torques[0] == pytest.approx(0.0, abs=1e-3)
    assert torques[1] == pytest.approx(-10.0 * lever, abs=2e-3)
    assert telegram.values["OvPro.R"] == "100"
    assert telegram.values["ProgStatus.R"] == "3"
    assert axes_in(telegram, "MACur") == [0.0] * 6


def test_axis_orders_are_reported_as_poses() -> None:
    client = AxisClient()
    received: list[ReceivedOrder] = []
    client.robot.orders.listener = received.append
    start = axes_in(client.cycle((0.0,) * 6), "ASPos")
    client.cycle((0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert [order.act for order in received] == [Act.MOTION] * 2
    a, *rest = start
    b, c, d, e, f = rest
    begin, end = (order.pose for order in received)
    assert begin is not None
    assert end is not None
    assert begin.position == pytest.approx(START.position, abs=1e-9)
    place = KukaArm("kr16-2", 0.0).pose((a + 0.1, b, c, d, e, f)).position
    assert end.position == pytest.approx(place, abs=1e-6)
    assert end.position != pytest.approx(START.position, abs=1e-4)
    assert received[1].reach is not None
    assert 0.0 < received[1].reach.speed_m_s * received[1].reach.cycle_s < 0.25


@pytest.mark.parametrize("fault", ["nan", "missing", "offset"])
def test_pose_faults_apply_to_axes(fault: str) -> None:
    client = AxisClient()
    healthy = axes_in(client.cycle((0.0,) * 6), "AIPos")
    values = {"y_mm": 50.0} if fault == "offset" else {}
    client.ledger.inject("pose", fault, client.now, values)
    reported = client.cycle((0.0,) * 6).values
    if fault == "missing":
        assert "AIPos.A1" not in reported
        assert "ASPos.A1" in reported
    elif fault == "nan":
        assert reported["AIPos.A1"] == "NaN"
    else:
        assert abs(float(reported["AIPos.A1"]) - healthy[0]) > 2.0


def test_lost_answer_keeps_axes() -> None:
    client = AxisClient()
    before = client.go((4.0, 0.0, 0.0, 0.0, 0.0, 0.0), 50)
    for _ in range(50):
        after = client.listen()
    assert after is not None
    assert axes_in(after, "AIPos") == pytest.approx(axes_in(before, "AIPos"), abs=1e-3)
    assert int(after.values["Delay.D"]) >= 49
