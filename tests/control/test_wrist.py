"""From the sensor's wrench to the contact wrench on the tool."""

import math

import numpy as np
import pytest

from hil_bridge.control import Wrist

DOWN = (0.0, 1.0, 0.0, 0.0)
LEVEL = (math.cos(math.pi / 4), 0.0, math.sin(math.pi / 4), 0.0)  # tool z along base x
WRENCH = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)


def test_a_plain_sensor_is_taken_as_it_is() -> None:
    assert Wrist().contact_wrench(WRENCH, DOWN, DOWN).tolist() == pytest.approx(WRENCH)


def test_a_sensor_mounted_at_ninety_degrees_reads_the_tools_y_as_its_x() -> None:
    turned = Wrist(mounting=math.pi / 2).contact_wrench(WRENCH, DOWN, DOWN)
    assert turned.tolist() == pytest.approx([-2.0, 1.0, 3.0, -0.2, 0.1, 0.3])


def test_a_left_handed_sensor_is_flipped_before_it_is_turned() -> None:
    flipped = Wrist(flip=True).contact_wrench(WRENCH, DOWN, DOWN)
    assert flipped.tolist() == pytest.approx([-1.0, 2.0, 3.0, -0.1, 0.2, 0.3])
    both = Wrist(flip=True, mounting=math.pi / 2).contact_wrench(WRENCH, DOWN, DOWN)
    assert both.tolist() == pytest.approx([-2.0, -1.0, 3.0, -0.2, -0.1, 0.3])


def test_only_the_change_of_weight_since_the_zero_is_taken_off() -> None:
    """2 kg, 0.1 m below the sensor. The zero was taken pointing down, where the weight lies along tool z; held
    level it pulls along tool x and bends about tool y.
    """
    wrist = Wrist(mass=2.0, centre_of_gravity=(0.0, 0.0, 0.1))
    weight = 2.0 * 9.80665
    assert wrist.contact_wrench(np.zeros(6), DOWN, DOWN).tolist() == [0.0] * 6
    felt_level, felt_down = np.array([weight, 0, 0, 0, 0.1 * weight, 0]), np.array([0, 0, weight, 0, 0, 0])
    contact = wrist.contact_wrench(felt_level - felt_down, LEVEL, DOWN)
    assert contact.tolist() == pytest.approx([0.0] * 6, abs=1e-9)
