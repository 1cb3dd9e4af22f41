"""Pushes by hand on sensors that are mounted in every way: the axis named, and what is to be set."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import Wrist
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import read_config
from hil_bridge.site.push import Answer, expect_push, judge_push, mounting_of, push_threshold

QUIET = (0.01,) * 6
BEFORE = (3.0, -40.0, 120.0, 1.0, 2.0, 3.0)
"""A tool's weight and the sensor's bias: only the change counts."""


def pushed(sits: Wrist, axis: int, force_n: float = 20.0, askew_deg: float = 0.0) -> Answer:
    """A push along an axis of the tool, tilted towards the next one, as a sensor that sits so reads it."""
    force = np.zeros(3)
    force[axis] = math.cos(math.radians(askew_deg))
    force[(axis + 1) % 3] = math.sin(math.radians(askew_deg))
    reading = [*(sits.alignment().T @ force * force_n), 9.0, 9.0, 9.0]
    answer = judge_push(BEFORE, [a + b for a, b in zip(BEFORE, reading, strict=True)], QUIET)
    assert answer is not None
    return answer


def sitting(**sensor: object) -> Wrist:
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
def test_the_axis_that_answers_is_named_with_its_sign(sensor: dict[str, object], answers: list[str]) -> None:
    found = [pushed(sitting(**sensor), axis) for axis in range(3)]
    assert [answer.text[:3] for answer in found] == answers
    assert all(answer.sure and answer.force_n == pytest.approx(20.0) for answer in found)
    for axis, answer in enumerate(found):
        assert expect_push(sitting(**sensor), axis).direction == pytest.approx(answer.direction)


def test_a_push_too_weak_for_the_noise_tells_nothing() -> None:
    assert judge_push((0.0,) * 6, (4.9, 0.0, 0.0, 0.0, 0.0, 0.0), QUIET) is None
    assert judge_push((0.0,) * 6, (5.1, 0.0, 0.0, 0.0, 0.0, 0.0), QUIET) is not None
    noisy = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    assert push_threshold(noisy) == pytest.approx(10.0 * math.sqrt(3.0))
    assert judge_push((0.0,) * 6, (17.0, 0.0, 0.0, 0.0, 0.0, 0.0), noisy) is None
    assert judge_push((0.0,) * 6, (math.nan, 90.0, 0.0, 0.0, 0.0, 0.0), QUIET) is None


def test_a_push_between_two_axes_is_not_sure() -> None:
    assert pushed(sitting(), 0, askew_deg=25.0).sure
    askew = pushed(sitting(), 0, askew_deg=35.0)
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
def test_three_pushes_say_what_to_set(sensor: dict[str, object], askew_deg: float) -> None:
    """Settings are equal when they align the sensor's axes alike; a hand may be 15° off."""
    sits = sitting(**sensor)
    found = mounting_of({axis: pushed(sits, axis, askew_deg=askew_deg) for axis in range(3)})
    assert found is not None
    again = sitting(flip_fx_mx=found.flip_fx_mx, mounting_deg=found.mounting_deg, quaternion=found.quaternion)
    np.testing.assert_allclose(again.alignment(), sits.alignment(), atol=1e-9)
    assert found.off_deg == pytest.approx(askew_deg, abs=1e-4)
    if tuple(sensor["quaternion"]) == (1.0, 0.0, 0.0, 0.0):  # type: ignore[arg-type]
        assert found.quaternion == (1.0, 0.0, 0.0, 0.0)
        assert found.flip_fx_mx is sensor["flip_fx_mx"]
        assert math.cos(math.radians(found.mounting_deg)) == pytest.approx(
            math.cos(math.radians(sensor["mounting_deg"]))  # type: ignore[arg-type]
        )


def test_the_settings_are_lines_of_a_configuration(tmp_path: object) -> None:
    found = mounting_of(
        {axis: pushed(sitting(flip_fx_mx=True, mounting_deg=90.0), axis) for axis in range(3)}
    )
    assert found is not None
    assert found.settings == ("flip_fx_mx = true", "mounting_deg = 90.0", "quaternion = [1.0, 0.0, 0.0, 0.0]")


@given(st.floats(-180.0, 180.0), st.booleans())
def test_any_angle_about_z_is_told_to_the_degree(deg: float, flip: bool) -> None:
    sits = sitting(flip_fx_mx=flip, mounting_deg=deg)
    found = mounting_of({axis: pushed(sits, axis) for axis in range(3)})
    assert found is not None
    assert found.flip_fx_mx is flip
    from_right_angle = abs((deg + 45.0) % 90.0 - 45.0)
    allowed = 20.5 if from_right_angle <= 20.5 else 0.51
    assert abs((found.mounting_deg - deg + 180.0) % 360.0 - 180.0) <= allowed


def test_pushes_that_are_missing_or_alike_say_nothing() -> None:
    one = pushed(sitting(), 0)
    assert mounting_of({0: one, 1: pushed(sitting(), 1)}) is None
    assert mounting_of({0: one, 1: one, 2: pushed(sitting(), 2)}) is None
