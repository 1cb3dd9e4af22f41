"""Test of the cost of the emulated receiver board in processor time, which other work hardly changes."""

import time

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.jr3 import Board, BoardProfile, Jr3Sensor, SensorProfile
from emulators.sensing import KnownWrench

pytestmark = pytest.mark.live


def test_one_minute_of_all_filters_takes_less_than_1_s() -> None:
    def wrench_at(times: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.outer(np.sin(7.0 * times), [50.0, -40.0, 100.0, 2.0, -1.0, 3.0])

    board = Board(BoardProfile(), Jr3Sensor(SensorProfile(), KnownWrench(wrench_at), 1), 100.0)
    before = board.read(0x90, 56, 101.0)
    began = time.process_time()
    after = board.read(0x90, 56, 161.0)
    duration = time.process_time() - began
    assert len(before) == len(after) == 7 * 8
    assert all(a != b for a, b in zip(before[48:54], after[48:54], strict=True))
    assert duration < 1.0
