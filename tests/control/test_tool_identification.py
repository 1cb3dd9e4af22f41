"""Mass, centre of gravity and bias from poses: known truth, noise, and insufficient poses."""

import math
import statistics
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import (
    ToolPose,
    Wrist,
    identify_tool,
    tool_gravity_wrench,
)
from hil_bridge.errors import ConfigError
from protocol.geometry import product, turn_about

DOWN = (0.0, 1.0, 0.0, 0.0)
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
BIAS = (3.0, -2.0, 5.0, 0.1, -0.2, 0.05)
CENTRE = (0.01, -0.02, 0.08)


def turned(axis, degrees):
    """Orientation of a downward tool after a rotation about an axis of the base."""
    return product(turn_about(axis, math.radians(degrees)), DOWN)


CROSS = (DOWN, turned(X, 30), turned(X, -30), turned(Y, 30), turned(Y, -30))


def pose(quaternion, wrist=Wrist(), mass=0.5, centre=CENTRE, bias=BIAS, noise=lambda: 0.0, scatter=0.0):  # noqa: B008
    weight = tool_gravity_wrench(quaternion, mass, centre)
    back = wrist.alignment().T
    read = np.concatenate([back @ weight[:3], back @ weight[3:]]) + bias
    return ToolPose(quaternion, tuple(value + noise() for value in read.tolist()), (scatter,) * 6)


def refusal(*poses, wrist=Wrist()):  # noqa: B008
    with pytest.raises(ConfigError) as caught:
        identify_tool(poses, wrist)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@given(
    st.floats(-180, 180),
    st.booleans(),
    st.floats(0.1, 10),
    st.tuples(*[st.floats(-0.2, 0.2)] * 3),
    st.tuples(*[st.floats(-20, 20)] * 6),
)
def test_identify_tool_from_exact_readings_is_exact(mounting, flip, mass, centre, bias) -> None:
    wrist = Wrist(product(turn_about(X, 0.3), turn_about(Z, mounting)), flip=flip)
    result = identify_tool([pose(q, wrist, mass, centre, bias) for q in CROSS], wrist)
    assert result.mass == pytest.approx(mass, abs=1e-9)
    assert result.centre_of_gravity == pytest.approx(centre, abs=1e-8)
    assert result.bias == pytest.approx(bias, abs=1e-8)
    assert result.force_residual < 1e-9
    assert result.moment_residual < 1e-9
    assert math.degrees(result.turned) == pytest.approx(60.0)


def test_identify_tool_accepts_three_poses() -> None:
    result = identify_tool([pose(q) for q in CROSS[:2] + CROSS[3:4]], Wrist())
    assert result.centre_of_gravity == pytest.approx(CENTRE)


def test_identify_tool_uncertainty_matches_errors() -> None:
    """Over many draws of noise the standard deviation of each result is what its uncertainty says."""
    random = Random(4)
    drawn = [
        identify_tool([pose(q, noise=lambda: random.gauss(0.0, 0.01)) for q in CROSS], Wrist())
        for _ in range(300)
    ]

    def agree(values, uncertainties):
        assert statistics.stdev(values) == pytest.approx(
            math.sqrt(statistics.fmean(u * u for u in uncertainties)), rel=0.15
        )

    agree([d.mass for d in drawn], [d.mass_uncertainty for d in drawn])
    for axis in range(3):
        agree(
            [d.centre_of_gravity[axis] for d in drawn],
            [d.centre_of_gravity_uncertainty[axis] for d in drawn],
        )
    for axis in range(6):
        agree([d.bias[axis] for d in drawn], [d.bias_uncertainty[axis] for d in drawn])


def test_identify_tool_uncertainty_grows_with_scatter() -> None:
    quiet, loud = (identify_tool([pose(q, scatter=s) for q in CROSS], Wrist()) for s in (0.0, 0.05))
    assert quiet.mass_uncertainty < 1e-9
    # Four of five poses lie 30° off. So the weight's directions are (g sin 30°)² four times about their mean, and
    # (g (1 − cos 30°))² · 4/5 along it.
    spread = 9.80665 * math.sqrt(4 * 0.25 + 0.8 * (1 - math.cos(math.radians(30))) ** 2)
    assert loud.mass_uncertainty == pytest.approx(0.05 / spread, rel=1e-6)


def test_identify_tool_pose_in_contact_has_large_residual() -> None:
    touched = list(map(pose, CROSS))
    wrench = touched[3].wrench
    touched[3] = ToolPose(CROSS[3], (wrench[0], wrench[1], wrench[2] + 0.5, *wrench[3:]))
    result = identify_tool(touched, Wrist())
    worst = max(range(5), key=lambda k: math.hypot(*result.residuals[k][:3]))
    assert worst == 3
    assert result.mass_uncertainty > 0.005


def test_identify_tool_names_insufficient_poses() -> None:
    assert "too few poses to identify the tool: 2 of at least 3;" in refusal(*map(pose, CROSS[:2]))
    near = [pose(turned(axis, angle)) for axis in (X, Y) for angle in (-6, 6)]
    assert refusal(*near).startswith(
        "the poses differ by 12° at most in the direction of gravity; "
        "turn the tool by 60° or more about two horizontal axes"
    )
    # A turn about the vertical, however large, does not change the weight.
    spun = [pose(turned(Z, angle)) for angle in (0, 40, 80, 120)]
    assert "differ by 0° at most" in refusal(*spun)
    one_axis = [pose(turned(X, angle)) for angle in (-40, -20, 0, 20, 40)]
    assert "up to 80° about one axis, and hardly about another" in refusal(*one_axis)


def test_identify_tool_without_weight_has_no_centre() -> None:
    random = Random(1)
    poses = [pose(q, mass=0.0, noise=lambda: random.gauss(0.0, 0.01)) for q in CROSS]
    assert "the weight does not follow the turning of the tool" in refusal(*poses)


def test_identify_tool_refuses_nan_reading() -> None:
    wrong = [*map(pose, CROSS), ToolPose(DOWN, (math.nan,) * 6)]
    assert "not a number" in refusal(*wrong)
