"""Set points of the tool within the limits of the joints."""

import itertools
import math

import pytest
from hil_fanuc.arms import MODELS, FanucArm
from hil_fanuc.limits import AxisLimits, find_breach
from hil_fanuc.path_limiter import PathLimiter

from emulators.arm.chain import straight_tool
from protocol.geometry import Pose, Quaternion, angle_between, product, turn_about

CYCLE = 0.008
DOWN: Quaternion = (0.0, 1.0, 0.0, 0.0)
HOME = Pose((0.9, -0.1, 0.6), DOWN)


def moved(goals: list[Pose], model: str = "crx-10ia/l") -> list[Pose]:
    """Return the set points for these goals. Fail if a joint exceeds its limits."""
    arm = FanucArm(model, straight_tool(0.2))
    own = MODELS[model]
    limits = [
        AxisLimits(*values)
        for values in zip(own.speeds_deg_s, own.accelerations_deg_s2, own.jerks_deg_s3, strict=True)
    ]
    joints = arm.at_rest(HOME)
    assert joints is not None
    limiter, poses = PathLimiter(arm, joints, CYCLE), []
    for goal in goals:
        before = limiter._limiter.states
        limiter.aim(goal)
        assert limiter.step(limits)
        assert find_breach(before, limiter._limiter.states, limits, CYCLE) is None
        poses.append(arm.pose(limiter.joints))
    return poses


@pytest.mark.parametrize("model", MODELS)
def test_leap_is_followed_without_overshoot(model: str) -> None:
    goal = Pose((0.85, 0.0, 0.55), product(turn_about((0.0, 1.0, 0.0), 0.3), DOWN))
    poses = moved([goal] * 300, model)
    assert math.dist(poses[-1].position, goal.position) < 1e-8
    assert angle_between(poses[-1].quaternion, goal.quaternion) < 1e-8
    assert min(pose.position[2] for pose in poses) > 0.55 - 1e-5


def test_motion_across_does_not_change_the_depth() -> None:
    poses = moved([Pose((0.9, -0.1 + 0.0002 * min(k, 100), 0.6), DOWN) for k in range(200)])
    depths = [pose.position[2] for pose in poses]
    assert max(depths) - min(depths) < 1e-8
    assert poses[-1].position[1] == pytest.approx(-0.08, abs=1e-8)


def test_tool_turns_by_more_than_half_a_turn() -> None:
    """In small steps about its axis, as a rotation vector cannot count it."""
    about = (0.0, 0.0, 1.0)
    goals = [
        Pose(HOME.position, product(turn_about(about, math.radians(0.4 * min(k, 500))), DOWN))
        for k in range(700)
    ]
    poses = moved(goals)
    steps = [angle_between(a.quaternion, b.quaternion) for a, b in itertools.pairwise(poses)]
    assert max(steps) < math.radians(0.5)
    assert angle_between(poses[-1].quaternion, goals[-1].quaternion) < 1e-8
    assert max(math.dist(pose.position, HOME.position) for pose in poses) < 1e-8
