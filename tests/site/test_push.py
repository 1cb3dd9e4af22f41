"""Pushes by hand on sensors in every mounting: the identified axis, and the suggested settings."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import Wrist
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import read_config
from hil_bridge.site.push import PushResponse, expect_push, judge_push, mounting_of, push_threshold

QUIET = (0.01,) * 6
BEFORE = (3.0, -40.0, 120.0, 1.0, 2.0, 3.0)
"""Weight of a tool plus the bias of the sensor; only the change matters."""


def push_response(mounting: Wrist, axis: int, force_n: float = 20.0, askew_deg: float = 0.0) -> PushResponse:
    """Return a push along a tool axis, tilted towards the next one, as measured by a sensor in this mounting."""
    force = np.zeros(3)
    force[axis] = math.cos(math.radians(askew_deg))
    force[(axis + 1) % 3] = math.sin(math.radians(askew_deg))
    reading = [*(mounting.alignment().T @ force * force_n), 9.0, 9.0, 9.0]
    answer = judge_push(BEFORE, [a + b for a, b in zip(BEFORE, reading, strict=True)], QUIET)
    assert answer is not None
    return answer


def mounting_from(**sensor: object) -> Wrist:
    return wrist(read_config({"sensor": sensor}))


@pytest.mark.parametrize(
    ("sensor", "answers"),
    [
        ({}, ["+Fx", "+Fy", "+Fz"]),
        ({"flip_fx_mx": True}, ["−Fx", "+Fy", "+Fz"]),
        ({"mounting_deg": 90.0}, ["−Fy", "+Fx", "+Fz"]),
        ({"quaternion": (0.0, 1.0, 0.0, 0.0)}, ["+Fx", "−Fy", "−Fz"]),
    ],
)
def test_push_names_responding_axis_with_sign(sensor: dict[str, object], answers: list[str]) -> None:
    result = [push_response(mounting_from(**sensor), axis) for axis in range(3)]
    assert [answer.text[:3] for answer in result] == answers
    assert all(answer.sure and answer.force_n == pytest.approx(20.0) for answer in result)
    for axis, answer in enumerate(result):
        assert expect_push(mounting_from(**sensor), axis).direction == pytest.approx(answer.direction)


def test_push_below_noise_threshold_is_none() -> None:
    assert judge_push((0.0,) * 6, (4.9, 0.0, 0.0, 0.0, 0.0, 0.0), QUIET) is None
    assert judge_push((0.0,) * 6, (5.1, 0.0, 0.0, 0.0, 0.0, 0.0), QUIET) is not None
    noisy = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    assert push_threshold(noisy) == pytest.approx(10.0 * math.sqrt(3.0))
    assert judge_push((0.0,) * 6, (17.0, 0.0, 0.0, 0.0, 0.0, 0.0), noisy) is None
    assert judge_push((0.0,) * 6, (math.nan, 90.0, 0.0, 0.0, 0.0, 0.0), QUIET) is None


def test_push_between_two_axes_is_not_sure() -> None:
    assert push_response(mounting_from(), 0, askew_deg=25.0).sure
    askew = push_response(mounting_from(), 0, askew_deg=35.0)
    assert not askew.sure
    assert askew.text.startswith("not sure: +Fx has 82% of 20.0 N")


SQUARE = [
    {"flip_fx_mx": flip, "mounting_deg": deg, "quaternion": quaternion}
    for flip, deg, quaternion in itertools.product(
        (False, True),
        (0.0, 90.0, 180.0, -90.0),
        ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0), (1.0, 0.0, -1.0, 0.0)),
    )
]


@pytest.mark.parametrize("sensor", SQUARE)
@pytest.mark.parametrize("askew_deg", [0.0, 15.0])
def test_three_pushes_determine_mounting(sensor: dict[str, object], askew_deg: float) -> None:
    """Settings are equal if they align the sensor's axes alike; a push may be 15° off."""
    mounting = mounting_from(**sensor)
    result = mounting_of({axis: push_response(mounting, axis, askew_deg=askew_deg) for axis in range(3)})
    assert result is not None
    again = mounting_from(
        flip_fx_mx=result.flip_fx_mx, mounting_deg=result.mounting_deg, quaternion=result.quaternion
    )
    np.testing.assert_allclose(again.alignment(), mounting.alignment(), atol=1e-9)
    assert result.off_deg == pytest.approx(askew_deg, abs=1e-4)
    if tuple(sensor["quaternion"]) == (1.0, 0.0, 0.0, 0.0):  # type: ignore[arg-type]
        assert result.quaternion == (1.0, 0.0, 0.0, 0.0)
        assert result.flip_fx_mx is sensor["flip_fx_mx"]
        assert math.cos(math.radians(result.mounting_deg)) == pytest.approx(
            math.cos(math.radians(sensor["mounting_deg"]))  # type: ignore[arg-type]
        )


def test_mounting_settings_are_configuration_lines(tmp_path: object) -> None:
    result = mounting_of(
        {axis: push_response(mounting_from(flip_fx_mx=True, mounting_deg=90.0), axis) for axis in range(3)}
    )
    assert result is not None
    assert result.settings == (
        "flip_fx_mx = true",
        "mounting_deg = 90.0",
        "quaternion = [1.0, 0.0, 0.0, 0.0]",
    )


@given(st.floats(-180.0, 180.0), st.booleans())
def test_mounting_angle_about_z_is_exact_to_one_degree(deg: float, flip: bool) -> None:
    mounting = mounting_from(flip_fx_mx=flip, mounting_deg=deg)
    result = mounting_of({axis: push_response(mounting, axis) for axis in range(3)})
    assert result is not None
    assert result.flip_fx_mx is flip
    from_right_angle = abs((deg + 45.0) % 90.0 - 45.0)
    allowed = 20.5 if from_right_angle <= 20.5 else 0.51
    assert abs((result.mounting_deg - deg + 180.0) % 360.0 - 180.0) <= allowed


def test_missing_or_equal_pushes_give_no_mounting() -> None:
    one = push_response(mounting_from(), 0)
    assert mounting_of({0: one, 1: push_response(mounting_from(), 1)}) is None
    assert mounting_of({0: one, 1: one, 2: push_response(mounting_from(), 2)}) is None
