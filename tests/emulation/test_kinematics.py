"""Tests of joints and poses of the arm, the lines that it can follow, and their speed; checked by plane geometry."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from emulators.arm.loops import ServoProfile
from emulators.arm.waypoints import Waypoint, WaypointArm
from emulators.arm.work_area import OutsideWorkArea, WorkArea
from emulators.devices.s3 import S3Controller, S3Profile, S3Profiles
from emulators.seams import StartPose
from protocol.geometry import Pose
from protocol.kinematics import Arm, Joints, Route
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

T0 = 99.5
TOOL = 0.2
DOWN = (0.0, 1.0, 0.0, 0.0)
START = (0.9, -0.1, 0.6)
RANGES = (180.0, 100.0, 60.0, 200.0, 120.0, 200.0)
SPEEDS = (115.0, 115.0, 115.0, 280.0, 300.0, 300.0)
REACH = 0.15 + TOOL
EVERYWHERE = S3Profile(axis_ranges_deg=(180.0,) * 6)
AT_ONCE = 1000.0
SIN_60 = math.sin(math.pi / 3.0)


def degrees(*angles: float) -> Joints:
    a, b, c, d, e, f = map(math.radians, angles)
    return a, b, c, d, e, f


def tool_frame(quaternion: tuple[float, ...]) -> np.ndarray:
    w, x, y, z = quaternion
    return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix())


@pytest.mark.parametrize(
    ("joints", "position", "approach", "tool_x"),
    [
        ((0, 0, 0, 0, 0, 0), (0.85 + REACH, 0.0, 0.78 + 0.71 + 0.125), (1, 0, 0), (0, 0, 1)),
        ((90, 0, 0, 0, 0, 0), (0.0, 0.85 + REACH, 0.78 + 0.71 + 0.125), (0, 1, 0), (0, 0, 1)),
        # The linkage keeps the forearm level while the upper arm lies down.
        ((0, 90, 0, 0, 0, 0), (0.71 + 0.85 + REACH, 0.0, 0.78 + 0.125), (1, 0, 0), (0, 0, 1)),
        (
            (0, 0, 60, 0, 30, 0),
            (0.425 + 0.125 * SIN_60, 0.0, 1.49 + 0.0625 - 0.85 * SIN_60 - REACH),
            (0, 0, -1),
            (1, 0, 0),
        ),
        ((0, 0, 0, 0, 90, 0), (0.85, 0.0, 0.78 + 0.71 + 0.125 - REACH), (0, 0, -1), (1, 0, 0)),
        ((0, 0, 0, 90, 90, 0), (0.85, REACH, 0.78 + 0.71 + 0.125), (0, 1, 0), (1, 0, 0)),
        ((0, 0, 0, 0, 0, 90), (0.85 + REACH, 0.0, 0.78 + 0.71 + 0.125), (1, 0, 0), (0, -1, 0)),
    ],
)
def test_forward_kinematics_is_plane_geometry(
    joints: tuple[float, ...],
    position: tuple[float, ...],
    approach: tuple[float, ...],
    tool_x: tuple[float, ...],
) -> None:
    at, quaternion = Arm(S3Profile(), TOOL).pose(degrees(*joints))
    frame = tool_frame(quaternion)
    np.testing.assert_allclose(at, position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(frame[:, 2], approach, rtol=0, atol=1e-12)
    np.testing.assert_allclose(frame[:, 0], tool_x, rtol=0, atol=1e-12)


def test_axis_3_may_be_relative_to_upper_arm() -> None:
    riding = Arm(S3Profile(axis_3_against="upper_arm"), TOOL)
    level = Arm(S3Profile(), TOOL)
    at, quaternion = level.pose(degrees(10, 30, 45, 20, 40, 50))
    position, turned = riding.pose(degrees(10, 30, 15, 20, 40, 50))
    assert (*position, *turned) == pytest.approx((*at, *quaternion))
    assert riding.nearest(at, quaternion, (0.0,) * 6) == pytest.approx(degrees(10, 30, 15, 20, 40, 50))


@settings(max_examples=150, deadline=None)
@given(st.tuples(*(st.floats(-reach, reach) for reach in RANGES)), st.sampled_from(["horizon", "upper_arm"]))
def test_every_posture_holds_pose_within_ranges(angles: tuple[float, ...], against: str) -> None:
    arm = Arm(S3Profile(axis_3_against=against), TOOL)  # type: ignore[arg-type]
    joints = degrees(*angles)
    position, quaternion = arm.pose(joints)
    postures = list(arm.postures(position, quaternion, joints))
    for posture in postures:
        at, turned = arm.pose(posture)
        # A wrist straighter than the wire's quaternions can tell gives way by up to 0.2 mrad.
        assert math.dist(at, position) < 1e-4
        assert abs(sum(p * q for p, q in zip(turned, quaternion, strict=True))) > 1.0 - 1e-7
        assert all(abs(math.degrees(a)) <= r + 1e-6 for a, r in zip(posture, RANGES, strict=True))
    if abs(math.sin(joints[4])) > 1e-3 and math.dist(position, (0.0, 0.0, position[2])) > 1e-3:
        worst = min(max(abs(p - q) for p, q in zip(posture, joints, strict=True)) for posture in postures)
        assert worst < 1e-5, "the joints that made the pose are among those that hold it"


def test_all_eight_branches_are_found() -> None:
    arm = Arm(EVERYWHERE, TOOL)
    joints = degrees(30, 20, 25, 40, 50, 60)
    postures = list(arm.postures(*arm.pose(joints), joints))
    assert len({tuple(round(angle, 6) for angle in posture) for posture in postures}) == 8
    assert sum(arm.bend(posture) > 0.0 for posture in postures) == 4
    assert sum(posture[4] > 0.0 for posture in postures) == 4
    assert sum(abs(posture[0] - joints[0]) < 1e-9 for posture in postures) == 4


@settings(max_examples=200, deadline=None)
@given(
    st.tuples(*(st.floats(-reach, reach) for reach in RANGES)),
    st.tuples(*(st.floats(-1.5, 1.5) for _ in RANGES)),
    st.sampled_from(["horizon", "upper_arm"]),
)
def test_nearest_posture_is_minimal(
    angles: tuple[float, ...], displacement: tuple[float, ...], against: str
) -> None:
    profile = S3Profile(axis_3_against=against)  # type: ignore[arg-type]
    arm = Arm(profile, TOOL)
    pose, near = (
        arm.pose(degrees(*angles)),
        degrees(*(a + b**5 for a, b in zip(angles, displacement, strict=True))),
    )

    def effort(posture: Joints) -> float:
        displacements = zip(near, posture, profile.axis_speeds_deg_s, strict=True)
        return sum(((q - p) / speed) ** 2 for p, q, speed in displacements)

    nearest = arm.nearest(*pose, near)
    efforts = [effort(posture) for posture in arm.postures(*pose, near)]
    assert (nearest is None) == (not efforts)
    if nearest is not None:
        assert effort(nearest) == min(efforts)


@pytest.mark.parametrize("fourth", [-170.0, -10.0, 10.0, 170.0])
def test_wrist_flip_with_least_motion_is_chosen(fourth: float) -> None:
    arm = Arm(S3Profile(), TOOL)
    for fifth in (-40.0, 40.0):
        joints = degrees(5, 10, 20, fourth, fifth, 15)
        assert arm.nearest(*arm.pose(joints), joints) == pytest.approx(joints, abs=1e-9)


def test_nearest_equivalent_angle_in_range_is_taken() -> None:
    arm = Arm(S3Profile(), TOOL)
    pose = arm.pose(degrees(0, 10, 20, 0, 40, 190))
    assert arm.nearest(*pose, degrees(0, 10, 20, 0, 40, 199)) == pytest.approx(degrees(0, 10, 20, 0, 40, 190))
    assert arm.nearest(*pose, degrees(0, 10, 20, 0, 40, -160)) == pytest.approx(
        degrees(0, 10, 20, 0, 40, -170)
    )
    # Beyond the end of the range it comes round from the other side.
    for beyond, near, wound in ((205, 199, -155), (-205, -199, 155)):
        pose = arm.pose(degrees(0, 10, 20, 0, 40, beyond))
        unflipped, flipped = arm.postures(*pose, degrees(0, 10, 20, 0, 40, near))
        assert unflipped == pytest.approx(degrees(0, 10, 20, 0, 40, wound))
        assert flipped[4] == pytest.approx(math.radians(-40))


@pytest.mark.parametrize("kept", [-120.0, 0.0, 77.0])
def test_straight_wrist_keeps_axis_4(kept: float) -> None:
    arm = Arm(S3Profile(), TOOL)
    pose = arm.pose(degrees(0, 10, 20, 30, 0, 15))
    assert arm.nearest(*pose, degrees(0, 10, 20, kept, 1, 0)) == pytest.approx(
        degrees(0, 10, 20, kept, 0, 45 - kept)
    )


def test_wrist_above_base_keeps_axis_1() -> None:
    arm = Arm(S3Profile(), TOOL)
    # Tool up: flange and wrist on axis 1.
    joints = arm.nearest((0.0, 0.0, 2.2), (1.0, 0.0, 0.0, 0.0), degrees(33, 0, 0, 0, -90, 0))
    assert joints is not None
    assert math.degrees(joints[0]) == pytest.approx(33.0)


def test_ranges_are_centred_on_middles() -> None:
    shifted = Arm(S3Profile(axis_middles_deg=(90.0, 0.0, 0.0, 0.0, 0.0, 0.0)), TOOL)
    pose = shifted.pose(degrees(200, 10, 20, 0, 40, 0))
    assert shifted.nearest(*pose, shifted.middles) == pytest.approx(degrees(200, 10, 20, 0, 40, 0))
    narrow = S3Profile(axis_ranges_deg=(5.0, 100.0, 60.0, 200.0, 120.0, 200.0))
    with pytest.raises(OutsideWorkArea, match="axis_ranges_deg"):
        WorkArea(narrow, TOOL).joints(START, DOWN)


def test_default_cell_starts_mid_range_and_reaches_contours() -> None:
    area = WorkArea(S3Profile(), TOOL)
    joints = area.joints(START, DOWN)
    assert np.degrees(joints) == pytest.approx((-6.34, 17.4, 44.6, 0.0, 45.4, -6.34), abs=0.1)
    for height in (0.55, 0.605, 0.7):
        route = area.route(START, DOWN, joints, (0.9, 0.9, height), DOWN)
        assert not route.slowed(math.dist(START, (0.9, 0.9, height)) / 0.05)


# --- lines


def line(area: WorkArea, begin: Joints, end: Joints, arm: Arm) -> Route:
    return area.route(*arm.pose(begin), begin, *arm.pose(end))


def test_line_is_followed_between_poses() -> None:
    arm, area = Arm(S3Profile(), TOOL), WorkArea(S3Profile(), TOOL)
    begin, end = degrees(-20, 10, 20, 10, 40, 0), degrees(30, 25, 30, -20, 60, 50)
    route = line(area, begin, end, arm)
    assert route.joints[0] == pytest.approx(begin)
    assert route.joints[-1] == pytest.approx(end)
    assert route.parts[0] == 0.0
    assert route.parts[-1] == 1.0
    (start, _), (stop, _) = arm.pose(begin), arm.pose(end)
    for part, joints in zip(route.parts, route.joints, strict=True):
        at = [a + (b - a) * part for a, b in zip(start, stop, strict=True)]
        assert arm.pose(joints)[0] == pytest.approx(at, abs=1e-9)
        assert route.at(part) == pytest.approx(joints)
    assert np.abs(np.diff(np.degrees(route.joints), axis=0)).max() <= 3.0


def test_line_to_back_is_refused_with_limited_axis_1() -> None:
    area = WorkArea(S3Profile(), TOOL)
    for there in ((-0.9, -0.1, 0.6), (-0.9, 0.1, 0.6)):
        area.joints(there, DOWN)
        with pytest.raises(OutsideWorkArea, match="no joint angles"):
            area.route(START, DOWN, area.joints(START, DOWN), there, DOWN)
    behind = area.joints((-0.9, -0.1, 0.6), DOWN)
    with pytest.raises(OutsideWorkArea, match="jump"):
        area.route((-0.9, -0.1, 0.6), DOWN, behind, (-0.9, 0.1, 0.6), DOWN)


def test_line_through_other_elbow_posture_is_refused() -> None:
    # Axis 2 leans no less than 60°: further up only the elbow hanging down reaches.
    profile = S3Profile(
        axis_ranges_deg=(180.0, 20.0, 180.0, 200.0, 120.0, 200.0),
        axis_middles_deg=(0.0, 80.0, 0.0, 0.0, 0.0, 0.0),
    )
    arm, area = Arm(profile, TOOL), WorkArea(profile, TOOL)
    begin, end = degrees(0, 65, -2, 0, 20, 0), degrees(0, 70, -27, 0, 20, 0)
    assert arm.bend(begin) > 0.2
    assert arm.bend(end) < -0.2
    assert area.joints(*arm.pose(end), begin) == pytest.approx(end)
    with pytest.raises(OutsideWorkArea, match="jump"):
        line(area, begin, end, arm)


def test_line_through_straight_wrist_keeps_axis_4() -> None:
    arm, area = Arm(S3Profile(), TOOL), WorkArea(S3Profile(), TOOL)
    route = line(area, degrees(0, 10, 20, 0, 25, 0), degrees(0, 10, 20, 0, -25, 0), arm)
    assert route.joints[-1] == pytest.approx(degrees(0, 10, 20, 0, -25, 0), abs=1e-9)
    assert np.abs(np.array(route.joints)[:, 3]).max() < 1e-9


def test_line_past_straight_wrist_is_slowed_by_axis_4() -> None:
    arm, area = Arm(S3Profile(), TOOL), WorkArea(S3Profile(), TOOL)
    begin = degrees(0, 10, 20, 10, 25, 0)
    position, _ = arm.pose(degrees(0, 10, 20, -10, -25, 0))
    route = line(area, begin, degrees(0, 10, 20, -10, -25, 0), arm)
    assert math.degrees(route.joints[-1][3]) == pytest.approx(170.0)
    # It passes 1.5° beside the straight wrist; at the nearest places, 0.2° apart, axis 4 turns 0.2/1.5 rad.
    assert np.abs(np.diff(np.degrees(route.joints), axis=0)).max() < 8.0
    even = math.dist(arm.pose(begin)[0], position) / 0.5
    times = route.slowed(even)
    assert times[-1] > 1.05 * even
    spans = np.diff(times) / (even * np.diff(route.parts))
    assert spans.min() == pytest.approx(1.0)
    assert spans.max() > 1.3


def test_wrist_flip_is_refined() -> None:
    # Less than 1° from place to place, half a degree beside the straight wrist: axis 4 must go round.
    arm, area = Arm(S3Profile(), TOOL), WorkArea(S3Profile(), TOOL)
    route = line(area, degrees(0, 0, 20, 6, 5, 0), degrees(0, 20, 20, -6, -5, 0), arm)
    assert math.degrees(route.joints[-1][3]) == pytest.approx(174.0)
    assert math.degrees(route.joints[-1][4]) == pytest.approx(5.0)


def test_leaving_straight_wrist_sideways_turns_90_degrees() -> None:
    arm, area = Arm(S3Profile(), TOOL), WorkArea(S3Profile(), TOOL)
    route = line(area, degrees(0, 10, 20, 0, 0, 0), degrees(0, 10, 20, 90, 25, -90), arm)
    assert abs(math.degrees(route.joints[-1][3])) == pytest.approx(90.0)
    assert route.slowed(0.0)[-1] >= 90.0 / 280.0


# --- speed


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(st.floats(-60, 60), st.floats(0, 30), st.floats(0, 40), st.floats(20, 80), st.floats(-90, 90)),
    st.floats(0.05, 8.0),
)
def test_set_point_joints_keep_speed_limits(angles: tuple[float, ...], speed: float) -> None:
    a, b, c, e, f = angles
    area, arm = WorkArea(S3Profile(), TOOL), Arm(S3Profile(), TOOL)
    joints = area.joints(START, DOWN)
    position, quaternion = arm.pose(degrees(a, b, c, 0, e, f))
    route = area.route(START, DOWN, joints, position, quaternion)
    servo = ServoProfile(interpolation_ms=10.0, transport_delay_ms=0.0, reorientation_deg_s=1000.0)
    motion = WaypointArm(servo, Pose(START, DOWN), T0, joints)
    motion.enqueue(Waypoint(position, quaternion, speed, route), T0)
    observed = np.degrees([motion.joints(now) for now in (T0 + 0.01 * np.arange(1, 400) + 0.001).tolist()])
    assert (np.abs(np.diff(observed, axis=0)) <= np.array(SPEEDS) * 0.01 * (1.0 + 1e-6)).all()
    assert motion.waiting(T0 + 60.0) == 0
    assert motion.joints(T0 + 61.0) == pytest.approx(route.joints[-1])


def test_true_joints_of_too_fast_line_keep_speed_limits() -> None:
    # A servo that follows the interpolator exactly, so that the true pose tells the joints again.
    servo = ServoProfile(
        interpolation_ms=1.0,
        transport_delay_ms=0.0,
        natural_frequency_rad_s=10_000.0,
        resolution_mm=1e-6,
        reorientation_deg_s=1e6,
    )
    for x, y, z, turn in ((0.9, 0.9, 0.6, 0.0), (1.2, -0.4, 0.9, 1.0), (0.6, 0.3, 0.7, -0.6)):
        robot, area = controller(servo), WorkArea(S3Profile(), TOOL)
        turned = (0.0, math.cos(turn), math.sin(turn), 0.0)
        route = area.route(START, DOWN, robot.joints(T0), (x, y, z), turned)
        robot.motion.enqueue(Waypoint((x, y, z), turned, AT_ONCE, route), T0)
        times = T0 + 0.02 * np.arange(0, 60)
        rates = np.abs(np.diff(np.degrees([robot.joints(now) for now in times.tolist()]), axis=0)) / 0.02
        used = (rates / SPEEDS).max(axis=1)
        assert used.max() < 1.05
        moving = used > 0.0
        assert used[moving][1:-1].min() > 0.9, "some joint is at its speed all along"
        assert moving.sum() == pytest.approx(sum(route.least_times) / 0.02, abs=1.5)


def test_slowed_line_takes_time_of_slowest_joint() -> None:
    # Axis 1 alone: a quarter circle's chord, far too fast.
    arm, area = Arm(S3Profile(), TOOL), WorkArea(S3Profile(), TOOL)
    begin = degrees(-20, 20, 30, 0, 60, -20)
    position, quaternion = arm.pose(begin)
    route = area.route(position, quaternion, begin, position, arm.pose(degrees(-20, 20, 30, 0, 60, 70))[1])
    # 90° of axis 6 at 300°/s.
    assert route.slowed(0.1)[-1] == pytest.approx(0.3)
    assert route.slowed(0.31) == ()


# --- reports of a cell


def controller(servo: ServoProfile | None = None) -> S3Controller:
    return S3Controller(S3Profiles(servo=servo or ServoProfile()), StartPose(START, DOWN, TOOL), T0, 1)


def true_joints(cell: PaperCell, now: float) -> Joints:
    joints = cell.true_state(now).joints
    assert joints is not None
    a, b, c, d, e, f = joints
    return a, b, c, d, e, f


def test_true_joints_hold_true_pose() -> None:
    cell, arm = s3_jr3_cell(PaperCellProfile(), T0, 1), Arm(S3Profile(), TOOL)
    area = WorkArea(S3Profile(), TOOL)
    there = (0.8, 0.3, 0.9)
    turned = (0.0, math.cos(0.3), math.sin(0.3), 0.0)
    route = area.route(START, DOWN, area.joints(START, DOWN), there, turned)
    cell.robot.motion.enqueue(Waypoint(there, turned, 0.3, route), T0)
    for now in (T0, T0 + 0.4, T0 + 0.9, T0 + 5.0):
        truth = cell.true_state(now)
        position, quaternion = arm.pose(true_joints(cell, now))
        assert position == pytest.approx(truth.position, abs=1e-12)
        assert tool_frame(quaternion) == pytest.approx(tool_frame(truth.quaternion), abs=1e-9)
    assert true_joints(cell, now) == pytest.approx(route.joints[-1], abs=1e-3)
    assert len({true_joints(cell, now)[0] for now in (T0, T0 + 0.4, T0 + 0.9)}) == 3


def test_past_joints_are_kept() -> None:
    robot, area = controller(), WorkArea(S3Profile(), TOOL)
    route = area.route(START, DOWN, area.joints(START, DOWN), (0.9, 0.5, 0.6), DOWN)
    robot.motion.enqueue(Waypoint((0.9, 0.5, 0.6), DOWN, 0.2, route), T0)
    once = robot.joints(T0 + 1.0)
    robot.joints(T0 + 4.0)
    assert robot.joints(T0 + 1.0) == once
    late = robot.joints(T0 + 3600.0)
    assert robot.motion.joints(T0 + 3597.0) == route.joints[-1]
    assert late == robot.joints(T0 + 7200.0) == pytest.approx(route.joints[-1], abs=1e-3)


def test_joints_out_of_reach_are_those_of_set_point() -> None:
    robot = controller(ServoProfile(damping_ratio=0.2))
    forward = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
    edge = (0.71 + math.hypot(0.125, 0.85) + REACH - 1e-4, 0.0, 0.78)
    area = WorkArea(S3Profile(), TOOL)
    route = area.route(START, DOWN, area.joints(START, DOWN), edge, forward)
    robot.motion.enqueue(Waypoint(edge, forward, AT_ONCE, route), T0)
    times = T0 + np.arange(0.0, 4.0, 0.01)
    beyond = times[robot.motion.path.trajectory(times)[0][:, 0] > edge[0] + 2e-4]
    assert len(beyond)
    assert all(robot.joints(now) == robot.motion.joints(now) for now in beyond.tolist())


def test_points_without_joints_keep_joints() -> None:
    motion = WaypointArm(ServoProfile(), Pose(START, DOWN), T0, degrees(1, 2, 3, 4, 5, 6))
    motion.enqueue(Waypoint((0.9, 0.0, 0.6), DOWN, 0.1), T0)
    assert motion.goal(T0) == ((0.9, 0.0, 0.6), DOWN, degrees(1, 2, 3, 4, 5, 6))
    assert motion.joints(T0 + 5.0) == degrees(1, 2, 3, 4, 5, 6)


def test_goal_after_halt_is_interpolator_position() -> None:
    area = WorkArea(S3Profile(), TOOL)
    joints = area.joints(START, DOWN)
    motion = WaypointArm(ServoProfile(), Pose(START, DOWN), T0, joints)
    route = area.route(START, DOWN, joints, (0.9, 0.3, 0.6), DOWN)
    motion.enqueue(Waypoint((0.9, 0.3, 0.6), DOWN, 0.1, route), T0)
    assert motion.goal(T0) == ((0.9, 0.3, 0.6), DOWN, route.joints[-1])
    motion.halt(T0 + 2.001)
    position, quaternion, posture = motion.goal(T0 + 2.1)
    assert position == pytest.approx((0.9, 0.1, 0.6))
    assert posture == pytest.approx(area.joints(position, quaternion), abs=1e-4)
