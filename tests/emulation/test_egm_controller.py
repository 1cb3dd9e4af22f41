"""Tests of the emulated EGM controller, cycle by cycle on a simulated clock: its messages and its motion."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.egm import EgmArmProfile, EgmController, EgmProfile, State
from emulators.devices.egm.guided import ArmJoints
from emulators.seams import StartPose
from protocol.devices.egm import (
    Answer,
    Guidance,
    Motors,
    PathCorrection,
    PoseMm,
    Rapid,
    SensorMessage,
    decode_robot,
    encode_answer,
)
from protocol.geometry import Pose
from protocol.marks import settings as settings_of
from tests.emulation.egm_line import AT_ONCE, CYCLE, DOWN, START, T0, Line, measured, planned, states, to

# --- what it sends


def test_first_datagram_is_number_0() -> None:
    line = Line().cycles(4)
    assert [(one.seqno, one.tm_ms) for one in line.received] == [(0, 1000), (1, 1004), (2, 1008), (3, 1012)]
    assert states(line.received[0]) == (Motors.ON, Guidance.STOPPED, Rapid.RUNNING)
    assert {states(one) for one in line.received[1:]} == {(Motors.ON, Guidance.RUNNING, Rapid.RUNNING)}
    assert measured(line.received[0]) == planned(line.received[0]) == START


def test_datagram_has_fields_that_clients_require() -> None:
    """Without any one of these, abb_libegm does not answer at all."""
    one = Line().cycles(2).last
    for place in (one.feedback, one.planned):
        assert place is not None
        assert len(place.joints_deg) == 6
        assert place.pose is not None
        assert place.time_us is not None
    assert one.converged is False
    assert len(one.force) == 6


def test_fields_match_version() -> None:
    oldest, older, new = (Line(rw=version).cycles(1).last for version in ("6.06", "6.10", "7"))
    for one in (oldest, older, new):
        assert one.force == (0.0,) * 6
    assert [
        one.feedback is not None and one.feedback.time_us is not None for one in (oldest, older, new)
    ] == [
        False,
        True,
        True,
    ]
    assert [one.utilization_percent is not None for one in (oldest, older, new)] == [False, True, True]
    assert [(one.move_index, one.force_control) for one in (older, new)] == [(None, None), (0, False)]


def test_joints_match_pose() -> None:
    one = Line().cycles(1).last
    assert one.feedback is not None
    a, b, c, d, e, f = map(math.radians, one.feedback.joints_deg)
    pose = ArmJoints(EgmProfile(), 0.2).pose((a, b, c, d, e, f))
    assert pose.position == pytest.approx((0.9, -0.1, 0.6))
    assert abs(sum(p * q for p, q in zip(pose.quaternion, DOWN, strict=True))) == pytest.approx(1.0)


def test_sample_rate_of_8_ms_sends_every_second_cycle() -> None:
    line = Line(sample_ms=8.0).cycles(10)
    assert [one.tm_ms for one in line.received] == [1000, 1008, 1016, 1024, 1032]
    with pytest.raises(ValueError, match="multiple of cycle_ms"):
        EgmProfile(sample_ms=6.0)


def test_missed_cycles_are_not_sent_in_a_burst() -> None:
    line = Line().cycles(2)
    line.robot.endpoint.handle_deadline(T0 + 10 * CYCLE)
    assert [decode_robot(one).tm_ms for one in line.robot.endpoint.data_to_send(T0 + 10 * CYCLE)] == [1040]
    assert line.robot.counters["cycles missed"] == 8


def test_start_out_of_reach_is_refused() -> None:
    with pytest.raises(ValueError, match="no joints of the arm hold the start pose"):
        EgmController(EgmProfile(), StartPose((5.0, 0.0, 0.5), DOWN), T0, 7)


# --- the law of motion: specification of EGM, section 4


def test_control_law_matches_specification() -> None:
    line = Line(**AT_ONCE)
    line.cycles(5, lambda received: [to(z=-2.0)])
    assert line.z(4) == pytest.approx([0.0, -0.04, -0.0792, -0.117616])
    line.cycles(247, lambda received: [to(z=-2.0)])
    assert line.z() == pytest.approx([-1.98719], abs=1e-6)  # after 250 cycles 498.012810 of 500


def test_low_pass_matches_specification() -> None:
    line = Line(**{**AT_ONCE, "lp_hz": 20.0}).cycles(5, lambda received: [to(z=-2.0)])
    assert line.z(4) == pytest.approx([0.0, -0.015803, -0.041041, -0.071787], abs=1e-6)


def test_reference_acts_after_delay_and_ramp() -> None:
    line = Line(lp_hz=0.0, ramp_in_s=0.0).cycles(1)
    line.cycles(8, lambda received: [to(z=-2.0)])
    assert [height != 0.0 for height in line.z(8)] == [False] * 6 + [
        True
    ] * 2  # 1 cycle to be taken, 4 of delay
    slow, quick = Line(ramp_in_s=0.5), Line(ramp_in_s=0.0)
    for one in (slow, quick):
        one.streams(0.1, to(z=-2.0))
    assert -0.1 < slow.z()[0] < 0.0
    assert quick.z()[0] < -0.4


@pytest.mark.parametrize(("speed", "behind"), [((), 4.4), ((20.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.4)])
def test_moving_reference_lag_is_speed_over_gain(speed: tuple[float, ...], behind: float) -> None:
    """20 mm/s at k = 5: 4 mm, and 0.4 mm for the delay of 5 cycles; with the speed in the message only the delay
    remains.
    """
    line = Line()
    for k in range(500):
        line.answers(to(x=20.0 * CYCLE * k, speed=speed))
    assert 20.0 * CYCLE * 499 - (planned(line.last).position_mm[0] - 900.0) == pytest.approx(behind, abs=0.01)
    lag = planned(line.last).position_mm[0] - measured(line.last).position_mm[0]
    assert lag == pytest.approx(20.0 * (0.02 + CYCLE / 2.0), abs=0.01)  # of the loop and its steps


def test_orientation_reaches_target_for_either_sign() -> None:
    half = math.radians(2.0) / 2.0
    turned = PoseMm(START.position_mm, (0.0, math.cos(half), math.sin(half), 0.0))
    line = Line(**AT_ONCE).streams(2.0, SensorMessage(0, 0, turned))
    assert planned(line.last).quaternion == pytest.approx(turned.quaternion, abs=1e-6)
    other_sign = PoseMm(START.position_mm, (0.0, -math.cos(half), -math.sin(half), 0.0))
    before = planned(line.last).quaternion
    line.streams(0.1, SensorMessage(0, 0, other_sign))
    assert planned(line.last).quaternion == pytest.approx(before, abs=1e-5)


def test_reference_alone_clears_speed() -> None:
    ahead = (0.0, 0.0, -10.0, 0.0, 0.0, 0.0)
    line = Line(**AT_ONCE, pos_corr_gain=0.0).streams(0.1, SensorMessage(0, speed=ahead))
    position = line.z()[0]
    assert position == pytest.approx(-10.0 * 0.092, abs=0.05)
    assert Line(**AT_ONCE).streams(0.1, SensorMessage(0, speed=(0.0, 0.0, -10.0))).z()[0] == pytest.approx(
        position
    )
    assert line.streams(0.1, to()).z()[0] == pytest.approx(position, abs=0.1)
    sticky = Line(**AT_ONCE, pos_corr_gain=0.0, speed_ref_sticky=True)
    assert sticky.streams(0.1, SensorMessage(0, speed=ahead)).streams(0.1, to()).z()[0] < position - 0.9


def test_distant_reference_is_approached_at_maximum_speed() -> None:
    line = Line(**AT_ONCE).streams(0.2, to(x=-200.0))
    heights = [planned(one).position_mm[0] for one in line.received[-10:]]
    assert np.diff(heights) == pytest.approx([-1.0] * 9)  # 250 mm/s
    assert line.last.utilization_percent is not None
    assert line.last.utilization_percent > 250.0


def test_window_may_act_as_limit() -> None:
    assert Line(**AT_ONCE, minmax_clamps=True).streams(2.0, to(z=-5.0)).z() == [-1.0]


def test_path_is_independent_of_reads() -> None:
    read, unread = Line(), Line()
    for k in range(100):
        for line in (read, unread):
            line.answers(to(z=-0.05 * k))
        read.robot.path.trajectory(np.array([read.now - 0.01, read.now]))
    times = np.array([T0 + 0.1, T0 + 0.39])
    np.testing.assert_array_equal(read.robot.path.trajectory(times), unread.robot.path.trajectory(times))


def test_begun_at_reports_start_of_motion() -> None:
    line = Line(**AT_ONCE).cycles(2, lambda received: [to(z=-1.0)])
    assert line.robot.targets.accepted == 2
    assert line.robot.targets.begun_at(1) == pytest.approx(
        T0 + 2 * CYCLE
    )  # taken with cycle 1, its set point one later
    assert line.robot.targets.begun_at(2) is None
    line.inject("robot", "program-restarted")
    assert math.isnan(line.robot.targets.begun_at(2) or 0.0)


# --- the queue


def test_each_cycle_takes_one_queued_message() -> None:
    line = Line(**AT_ONCE).cycles(2)
    line.send(to(z=-1.0), to(z=-2.0), to(z=-3.0))
    line.cycles(4)
    heights = [0.0, *line.z(3)]
    requested = [heights[k] + (heights[k + 1] - heights[k]) / (5.0 * CYCLE) for k in range(3)]
    assert requested == pytest.approx([-1.0, -2.0, -3.0])


def test_newest_only_queue_takes_newest_message() -> None:
    line = Line(**AT_ONCE, rx_queue="latest").cycles(2)
    line.send(to(z=-1.0), to(z=-2.0), to(z=-3.0))
    line.cycles(2)
    assert line.z() == pytest.approx([-3.0 * 5.0 * CYCLE])
    assert [math.isnan(line.robot.targets.begun_at(k) or 0.0) for k in (1, 2, 3)] == [True, True, False]


def test_cycles_without_message_are_counted() -> None:
    line = Line().cycles(2, lambda received: [to()]).cycles(10)
    assert line.robot.counters["cycles without a message"] == 9  # the first of the ten finds the last one


def test_full_queue_drops_newest_messages() -> None:
    line = Line(rx_queue_len=3).cycles(2)
    line.send(*(to(z=-float(k)) for k in range(5)))
    assert (line.robot.targets.accepted, line.robot.counters["queue full"]) == (3, 2)


@pytest.mark.parametrize(("check", "accepted"), [("ignore", 3), ("drop_old", 2)])
def test_message_with_old_number_may_be_dropped(check: str, accepted: int) -> None:
    line = Line(seqno_check=check).cycles(2)
    line.send(to()._replace(seqno=5), to()._replace(seqno=4), to()._replace(seqno=7))
    assert line.robot.targets.accepted == accepted
    line.send(to()._replace(seqno=0))  # restarts
    assert line.robot.targets.accepted == accepted + 1


# --- invalid messages


UNUSABLE: dict[str, Answer | bytes] = {
    "empty": b"",
    "noise": b"\xff\x01\x02",
    "cut off": encode_answer(to())[:-1],
    "from a robot": bytes.fromhex("0a0608001000" + "1802"),
    "another mode": PathCorrection(0, 0, (0.0, 1.0, 0.0), 4),
    "five joints": SensorMessage(0, joints_deg=(0.0,) * 5),
    "seven joints": SensorMessage(0, joints_deg=(0.0,) * 7),
    "two speeds": SensorMessage(0, speed=(1.0, 1.0)),
    "no orientation": SensorMessage(0, pose=PoseMm(START.position_mm, (0.0, 1.1, 0.0, 0.0))),
    "not a number": encode_answer(to()).replace(
        b"\x00\x00\x00\x00\x00\x20\x8c\x40", b"\x00" * 6 + b"\xf8\x7f"
    ),
}


@pytest.mark.parametrize("message", UNUSABLE.values(), ids=UNUSABLE)
def test_unusable_message_does_not_extend_timeout(
    message: Answer | bytes,
) -> None:
    line = Line().streams(1.2, message)
    assert line.robot.targets.accepted == 0
    assert line.robot.counters["unusable"] > 200
    assert line.robot.receiver.unusable
    assert line.robot.session.state is State.TIMED_OUT
    assert Line(bad_refreshes_timeout=True).streams(1.2, message).robot.session.state is State.GUIDING


def test_empty_message_only_extends_timeout() -> None:
    line = Line().streams(1.2, SensorMessage(0))
    assert (line.robot.session.state, line.robot.targets.accepted) == (State.GUIDING, 0)


@given(st.lists(st.binary(max_size=90) | st.sampled_from([encode_answer(to(z=-1.0))]), max_size=8))
def test_arbitrary_datagrams_raise_nothing(data: list[bytes]) -> None:
    line = Line().cycles(1)
    line.robot.endpoint.receive(data, line.now)
    line.cycles(2)


any_number = st.floats(allow_nan=False, allow_infinity=False)
six = st.tuples(*[any_number] * 6)
three = st.tuples(*[any_number] * 3)
orientations = st.sampled_from([DOWN, (1.0, 0.0, 0.0, 0.0), (0.6, 0.0, 0.8, 0.0)])
any_answer = st.builds(
    SensorMessage,
    seqno=st.integers(0, 9),
    tm_ms=st.none(),
    pose=st.none() | st.builds(PoseMm, three, orientations),
    joints_deg=st.just(()) | six,
    speed=st.just(()) | three | six,
    joint_speed_deg_s=st.just(()) | six,
    digital=st.none(),
    dnum=st.just(()),
) | st.builds(PathCorrection, st.just(0), st.none(), three, st.integers(0, 99))


@pytest.mark.parametrize("mode", ["pose", "joint", "path"])
@settings(max_examples=40)
@given(messages=st.lists(any_answer, min_size=1, max_size=4))
def test_arbitrary_numbers_keep_speed_limit(mode: str, messages: list[Answer]) -> None:
    line = Line(mode=mode, **AT_ONCE).cycles(2)
    line.send(*messages)
    line.cycles(8)
    heights = [planned(one).position_mm for one in line.received]
    assert all(math.isfinite(part) for place in heights for part in place)
    steps = [math.dist(before, after) for before, after in pairwise(heights)]
    assert max(steps) < 10.0 if mode == "joint" else max(steps) < 1.0 + 1e-6


# --- the other modes


def _ramp_in_joints(k: float) -> tuple[list[float], float]:
    """Return the lag of a joint behind a ramp, cycle by cycle from its start, and its speed, degrees and degrees/s."""
    line, speed = Line(mode="joint", k=k).cycles(1), 40.0
    assert line.last.feedback is not None
    joints = line.last.feedback.joints_deg
    line.streams(0.6, SensorMessage(0, joints_deg=joints))
    behind = []
    for count in range(1, 500):
        line.answers(SensorMessage(0, joints_deg=(joints[0] + speed * count * CYCLE, *joints[1:])))
        assert line.last.feedback is not None
        behind.append(speed * count * CYCLE - (line.last.feedback.joints_deg[0] - joints[0]))
    return behind, speed


def test_joint_ramp_matches_virtual_controller() -> None:
    """There: poles of 134 and 19 ms, a dead time of 19 ms, and 32 ms to the first motion; its gain is unknown."""
    behind, speed = _ramp_in_joints(k=1.0 / 0.134)
    assert behind[-1] / speed == pytest.approx(0.134 + 0.019 + 0.019, abs=0.008)
    still = [abs(late - speed * count * CYCLE) < 1e-4 for count, late in enumerate(behind, 1)]
    assert still.index(False) * CYCLE == pytest.approx(0.032, abs=CYCLE)
    behind, speed = _ramp_in_joints(k=5.0)
    assert behind[-1] / speed == pytest.approx(0.2 + 0.042, abs=0.005), "with the usual gain"


@pytest.mark.parametrize(("lp_hz", "lowest", "highest"), [(20.0, 0.040, 0.050), (5.0, 0.070, 0.080)])
def test_speed_delay_matches_real_robot(lp_hz: float, lowest: float, highest: float) -> None:
    """70 to 80 ms, and 40 to 50 ms after tuning; the bandwidths are unknown."""
    line, still = Line(pos_corr_gain=0.0, lp_hz=lp_hz), to(speed=(0.0,) * 6)
    line.streams(0.6, still).streams(1.0, to(speed=(20.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    behind_mm = 20.0 * (1.0 - CYCLE) - (measured(line.last).position_mm[0] - 900.0)
    assert lowest < behind_mm / 20.0 < highest


def test_joint_guidance_moves_joints() -> None:
    line = Line(mode="joint", **AT_ONCE).cycles(1)
    assert line.last.feedback is not None
    joints = line.last.feedback.joints_deg
    goal = (joints[0] + 2.0, *joints[1:])
    line.streams(3.0, SensorMessage(0, joints_deg=goal))
    assert line.last.planned is not None
    assert line.last.planned.joints_deg == pytest.approx(goal, abs=1e-4)
    x, y, _ = measured(line.last).position_mm
    turned = math.degrees(math.atan2(y, x) - math.atan2(-100.0, 900.0))
    assert turned == pytest.approx(2.0, abs=1e-3)
    assert line.last.converged


def test_joint_speed_is_limited_by_program() -> None:
    line = Line(mode="joint", max_speed_dev_deg=1.0, **AT_ONCE).cycles(1)
    assert line.last.planned is not None
    joints = line.last.planned.joints_deg
    line.streams(0.5, SensorMessage(0, joints_deg=(joints[0] + 20.0, *joints[1:])))
    turned = [one.planned.joints_deg[0] for one in line.received[-20:] if one.planned]
    assert np.diff(turned) == pytest.approx([0.004] * 19)


def test_joint_guidance_ignores_poses() -> None:
    line = Line(mode="joint", **AT_ONCE).streams(0.4, to(z=-50.0))
    assert planned(line.last).position_mm == pytest.approx(START.position_mm)
    speed = (0.0, 0.0, 0.0, 0.0, 0.0, 10.0)
    before = line.last.planned
    line.streams(0.4, SensorMessage(0, joint_speed_deg_s=speed))
    after = line.last.planned
    assert before is not None
    assert after is not None
    assert after.joints_deg[5] - before.joints_deg[5] == pytest.approx(3.9, abs=0.1)


def test_path_correction_uses_path_frame() -> None:
    """The tool points down and the path runs along x: y of the path is base y, and z of the path is base z."""
    line = Line(mode="path", sample_ms=48.0, path_speed_mm_s=10.0).cycles(1)
    line.cycles(250, lambda received: [PathCorrection(0, 0, (7.0, 1.25, -0.5), 48)] if received else [])
    x, y, z = planned(line.last).position_mm
    assert x - 900.0 == pytest.approx(10.0 * 0.96, abs=0.1)
    assert (y + 100.0, z - 600.0) == pytest.approx((1.25, -0.5))
    line.streams(30.0, PathCorrection(0, 0, (0.0, 0.0, 0.0), 48))
    assert planned(line.last).position_mm == pytest.approx((1100.0, -100.0, 600.0))


def test_correction_speed_is_limited() -> None:
    line = Line(mode="path", path_corr_mm_s=20.0, ref_delay_cycles=0).cycles(2)
    line.streams(0.1, PathCorrection(0, 0, (0.0, 50.0, 0.0), 4))
    sides = [planned(one).position_mm[1] for one in line.received[-10:]]
    assert np.abs(np.diff(sides)) == pytest.approx([0.08] * 9)


def test_invalid_profile_names_setting() -> None:
    for wrong, message in (
        ({"k": 21.0}, "k must be at most 20"),
        ({"tm_start": 0}, "tm_start must be at least 1"),
    ):
        with pytest.raises(ValueError, match=message):
            EgmProfile(**wrong)
    with pytest.raises(ValueError, match="damping_ratio must be more than 0"):
        EgmArmProfile(damping_ratio=0.0)


def test_true_state_has_joints() -> None:
    line = Line().cycles(1)
    joints = line.robot.joints_holding(Pose((0.9, -0.1, 0.6), DOWN), line.now)
    assert joints == pytest.approx(line.robot.motion.joints)


def test_page_lists_every_setting() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "egm.md").read_text(encoding="utf-8")
    names = [one.name for profile in (EgmProfile(), EgmArmProfile()) for one in settings_of(profile)]
    assert [name for name in names if f"`{name}`" not in page] == []
