"""Tests of the emulated arm of Universal Robots: external forces, kinematics, servoing and the path."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.devices.rtde import RtdeProfile, RtdeRobot
from emulators.devices.rtde.arm import JointArm, Paces, Servo
from emulators.devices.rtde.kinematics import ARMS, USUAL, flange, nearest, solutions
from protocol.devices.rtde import packets
from protocol.devices.rtde.packets import Kind
from protocol.devices.rtde.program import force_program_text
from protocol.devices.rtde.rotation import six_of
from protocol.devices.rtde.states import Runtime
from protocol.geometry import Pose
from tests.emulation.exact_arm import EXACT
from tests.emulation.rtde_desk import DT, START, T0, Desk, inputs_of, outputs_of, ready, values_of

# --- external forces


def test_external_force_is_reported_along_base_axes() -> None:
    desk = Desk()
    feeder, reader = desk.plug(), desk.plug()
    recipe = inputs_of(feeder, "external_force_torque")
    desk.upload(force_program_text(hold=True))
    desk.run(0.06)
    displayed = outputs_of(reader, "actual_TCP_force", "ft_raw_wrench", "tcp_force_scalar")
    reader.ask(packets.encode(Kind.START))
    for _ in range(10):
        feeder.send(recipe.pack(1.0, 2.0, -12.5, 0.1, 0.2, 0.3))
        desk.run(DT)
    last = values_of(reader, displayed)[-1]
    assert last["actual_TCP_force"] == pytest.approx((1.0, -2.0, 12.5, 0.5, 0.0, -0.3), abs=1e-9)
    assert last["ft_raw_wrench"] == (1.0, 2.0, -12.5, 0.1, 0.2, 0.3)
    desk.run(0.2)
    assert desk.controller.player.runtime == Runtime.PAUSED, "the stream has stopped"
    feeder.send(recipe.pack(0.0, 0.0, -300.0, 0.0, 0.0, 0.0))
    desk.run(2 * DT)
    assert desk.controller.counts["protective stop: the force is too large"] == 1
    feeder.send(recipe.pack(math.nan, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert desk.controller.io.inputs["external_force_torque"] == (0.0, 0.0, -300.0, 0.0, 0.0, 0.0)


def test_pure_force_at_tip_has_no_moment_about_tip() -> None:
    desk = Desk(replace(EXACT, force_point="tcp"))
    feeder, reader = desk.plug(), desk.plug()
    recipe = inputs_of(feeder, "external_force_torque")
    desk.upload(force_program_text(hold=False))
    desk.run(0.06)
    displayed = outputs_of(reader, "actual_TCP_force")
    reader.ask(packets.encode(Kind.START))
    force, arm = (3.0, 4.0, -5.0), (0.0, 0.0, 0.2)
    moment = np.cross(arm, force).tolist()
    feeder.send(recipe.pack(*force, *moment))
    desk.run(2 * DT)
    assert values_of(reader, displayed)[-1]["actual_TCP_force"] == pytest.approx(
        (3.0, -4.0, 5.0, 0, 0, 0), abs=1e-9
    )


# --- arm and kinematics


def test_poses_match_independent_calculation() -> None:
    arm = ARMS["ur5e"]
    pose = six_of(flange(arm, (0.1, -1.2, 1.6, -1.9, -1.5, 0.3)))
    assert pose == pytest.approx((-0.590618, -0.200310, 0.299733, 2.358483, 1.923433, 0.030280), abs=1e-6)
    assert six_of(flange(arm, (0.0,) * 6)) == pytest.approx((-0.8172, -0.2329, 0.0628, math.pi / 2, 0, 0))


@given(st.sampled_from(sorted(ARMS)), st.tuples(*[st.floats(-3.0, 3.0)] * 6))
def test_every_solution_holds_pose(model: str, joints: tuple[float, ...]) -> None:
    arm = ARMS[model]
    a, b, c, d, e, f = joints
    near = (a, b, c, d, e, f)
    pose = flange(arm, near)
    for result in solutions(arm, pose, near):
        again = flange(arm, result)
        assert math.dist(again.position, pose.position) < 1e-6
        dot = sum(p * q for p, q in zip(again.quaternion, pose.quaternion, strict=True))
        assert abs(dot) == pytest.approx(1.0, abs=1e-9)
    assert nearest(arm, Pose((9.0, 0.0, 0.0), pose.quaternion), USUAL) is None


@given(
    st.sampled_from(sorted(ARMS)),
    st.tuples(*[st.floats(-3.0, 3.0)] * 6),
    st.tuples(*[st.floats(-1.2, 1.2)] * 6),
)
def test_nearest_solution_is_minimal(
    model: str, joints: tuple[float, ...], displacement: tuple[float, ...]
) -> None:
    arm = ARMS[model]
    a, b, c, d, e, f = (joint + part**5 for joint, part in zip(joints, displacement, strict=True))
    near = (a, b, c, d, e, f)
    pose = flange(arm, joints)
    result = nearest(arm, pose, near)
    distances = [math.dist(each, near) for each in solutions(arm, pose, near)]
    assert (result is None) == (not distances)
    assert result is None or math.dist(result, near) == min(distances)


# Times and places that the specification's model gives: 20, 50, 100, 200 and 400 ms after a step of 1.
STEPS = [
    (0.10, 300.0, (0.0548, 0.2388, 0.5711, 0.9231, 1.0028)),
    (0.03, 300.0, (0.0619, 0.3183, 0.9097, 1.4157, 0.8353)),
    (0.03, 2000.0, (0.2928, 0.8388, 1.0472, 0.9979, 1.0000)),
    (0.20, 300.0, (0.0466, 0.1704, 0.3652, 0.6324, 0.8769)),
]


@pytest.mark.parametrize(("lookahead", "gain", "places"), STEPS)
def test_servoj_step_response_matches_model(lookahead: float, gain: float, places: tuple[float, ...]) -> None:
    arm = JointArm((0.0,) * 6, DT, 1.0, 4.0)
    at = []
    for _ in range(200):
        arm.take(Servo((1.0,) * 6, lookahead, gain, 1))
        arm.step(Paces())
        at.append(arm.joints[0])
    assert [at[round(ms / 2) - 1] for ms in (20, 50, 100, 200, 400)] == pytest.approx(places, abs=1e-4)


def test_start_out_of_reach_is_refused() -> None:
    with pytest.raises(ValueError, match="a ur5e cannot hold its tool at the start"):
        RtdeRobot(replace(EXACT, model="ur5e"), START, T0, 7)


@pytest.mark.parametrize("model", ["ur5e", "ur5"])
def test_refused_start_suggests_reachable_one(model: str) -> None:
    profile = RtdeProfile(model=model)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="set start_position_mm") as refused:
        RtdeRobot(profile, START, T0, 7)
    text = str(refused.value).partition("[")[2].partition("]")[0]
    x, y, z = (float(part) / 1e3 for part in text.split(","))
    robot = RtdeRobot(profile, START._replace(position=(x, y, z)), T0, 7)
    assert robot.path.trajectory(np.array([T0]))[0][0] == pytest.approx((x, y, z), abs=1e-6)
    with pytest.raises(ValueError, match="choose another start_position_mm, start_quaternion or model"):
        RtdeRobot(profile, START._replace(position=(0.9, -0.1, 3.0)), T0, 7)


def test_path_is_independent_of_reads() -> None:
    def path(read: bool) -> list[list[float]]:
        pair = ready(RtdeProfile())
        pair.begin(dx=-0.05)

        def step_and_read() -> None:
            pair.step()
            if read:
                pair.robot.path.trajectory(np.linspace(pair.now - 0.02, pair.now, 7))

        pair.run(0.3, step_and_read)
        times = np.arange(T0, pair.now, 0.0007)
        places, speeds = pair.robot.path.trajectory(times)
        assert np.abs(np.diff(places, axis=0)).max() < 0.2 * 0.0007
        assert sum(part.stop - part.start for part, _ in pair.robot.path.orientations(times)) == len(times)
        return [*places.tolist(), *speeds.tolist()]

    assert path(True) == path(False)
