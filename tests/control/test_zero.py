"""Checks of a sensor before its reading is used as the zero."""

import math

import pytest

from hil_bridge.control import Wrist, lift_fault, reading, weight_fault, weight_reading

DOWN = (0.0, 1.0, 0.0, 0.0)
TOOL = Wrist(mass=0.5, centre_of_gravity=(0.0, 0.0, 0.08))
WEIGHT = 0.5 * 9.80665


def fault(*forces: float, moments: tuple[float, ...] = (0.0, 0.0, 0.0)) -> str:
    return weight_fault((*forces, *moments), weight_reading(TOOL, DOWN), 1.0, 0.2)


def test_weight_of_vertical_tool_is_on_fz_only() -> None:
    assert weight_reading(TOOL, DOWN) == pytest.approx((0.0, 0.0, WEIGHT, 0.0, 0.0, 0.0), abs=1e-12)


def test_weight_of_horizontal_tool_is_on_force_and_moment() -> None:
    level = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)  # tool z along base x
    fx, fy, fz, mx, my, mz = weight_reading(TOOL, level)
    assert (abs(fx), fy, fz) == pytest.approx((WEIGHT, 0.0, 0.0), abs=1e-9)
    assert (mx, abs(my), mz) == pytest.approx((0.0, WEIGHT * 0.08, 0.0), abs=1e-9)


def test_weight_reading_uses_sensor_axes() -> None:
    bias = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    turned = Wrist(orientation=(0.0, 1.0, 0.0, 0.0), flip=True, bias=bias, mass=0.5)
    assert weight_reading(turned, DOWN) == pytest.approx((1.0, 2.0, 3.0 - WEIGHT, 0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("forces", "message"),
    [
        ((0.0, 0.0, 4.2), ""),
        ((0.9, -0.9, 5.8), ""),
        ((0.0, 0.0, 0.0), "Fz is dead or scaled wrongly, or the tool is gone"),
        ((0.0, 0.0, -4.9), "or Fz is mirrored"),
        ((4.9, 0.0, 0.0), "or Fz and Fx are swapped"),
        ((0.0, -4.9, 0.1), "or Fz and Fy are swapped"),
        ((0.0, 0.0, 9.8), "or an axis is scaled wrongly"),
        ((0.0, 0.0, math.nan), "Fz reads nan N"),
    ],
)
def test_weight_fault_names_force_axis(forces: tuple[float, ...], message: str) -> None:
    text = fault(*forces)
    assert message in text
    assert bool(text) is bool(message)
    assert not text or "the tool touches something" in text


def test_weight_fault_names_moment_axis() -> None:
    assert fault(0.0, 0.0, WEIGHT, moments=(0.0, 0.3, 0.0)).startswith("My reads 0.30 N·m where")


def test_reading_with_equal_halves_is_steady() -> None:
    still = reading([(0.1 * (-1) ** k, 0.0, 5.0, 0.0, 0.0, 0.0) for k in range(10)])
    assert still.unsteady(0.5) == ""
    drifting = reading([(0.0, 0.2 * k, 5.0, 0.0, 0.0, 0.0) for k in range(10)])
    assert drifting.mean == pytest.approx((0.0, 0.9, 5.0, 0.0, 0.0, 0.0))
    assert drifting.drift == pytest.approx((0.0, 1.0, 0.0, 0.0, 0.0, 0.0))
    assert drifting.unsteady(0.5) == "Fy drifts by +1.00 N"
    turning = reading([(0.0,) * 5 + (0.02 * k,) for k in range(10)])
    assert turning.unsteady(0.5) == "Mz drifts by +0.10 N·m"


@pytest.mark.parametrize(
    ("change", "before", "after", "message"),
    [
        (0.4, 0.0, 0.4, ""),
        (4.0, 10.0, 6.0, "the tool was touching: the contact force fell from 10.0 to 6.0 N"),
        (4.0, 0.1, 4.1, "away is not away: the contact force rose from 0.1 to 4.1 N"),
        (4.0, None, None, "the tool was touching, or frame.approach points the wrong way"),
    ],
)
def test_lift_with_changing_force_forbids_zero(
    change: float, before: float | None, after: float | None, message: str
) -> None:
    text = lift_fault(change, before, after, 0.5, 0.125)
    assert bool(text) is bool(message)
    assert message in text
