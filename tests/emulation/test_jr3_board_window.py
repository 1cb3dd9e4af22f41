"""Tests of words that a host reads repeatedly within one block of samples."""

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.jr3 import Jr3Sensor, SensorProfile
from emulators.devices.jr3.board import Board, BoardProfile
from emulators.sensing import KnownWrench
from protocol.devices.jr3.board import REGISTERS, pack_words

POWERED = 1000.0003
"""Time of power-up, not on the sensor's grid."""
STEADY = POWERED + 4.0
"""Time after the board has zeroed its offsets."""


def board() -> Board:
    """Return a board on an oscillating sensor, read ahead in blocks of 50 ms."""

    def wrench_at(times: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.outer(np.sin(40.0 * times), (11.5, -22.2, 37.0, 0.56, -1.04, 1.22))

    return Board(
        BoardProfile(), Jr3Sensor(SensorProfile(), KnownWrench(wrench_at, lambda now: now + 0.05), 7), POWERED
    )


@pytest.mark.parametrize(("address", "count"), [(0x98, 92), (0x00, 256), (0x90, 24), (0xF0, 8)])
def test_repeated_reads_match_a_single_read(address: int, count: int) -> None:
    """A second read of the same words in a block uses a different code path than the first."""
    streamed, reference = board(), board()
    for k in range(400):
        now = STEADY + 0.00105 * k
        expected = reference.read(address, count, now)
        reference.read(address + 1, count - 1, now)
        assert streamed.read(address, count, now) == expected
        assert streamed.burst(address, count, now) == pack_words(expected)
        assert streamed.burst(address, count, now) == pack_words(expected)


def test_regular_reader_sees_host_writes() -> None:
    """Precomputed bursts are dropped when any word of the memory changes."""
    streamed, reference = board(), board()
    slot = REGISTERS["load_envelope1"].address
    for k in range(200):
        now = STEADY + 0.001 * k
        if k % 37 == 5:
            for each in (streamed, reference):
                each.write(slot + 3, (k,), now)
        if k % 50 == 20:
            for each in (streamed, reference):
                each.unplug(now) if k < 100 else each.plug_in(now)
        assert streamed.burst(0x90, 256, now) == pack_words(reference.read(0x90, 256, now)), k


@pytest.mark.parametrize("period", [1, 4, 8, 80, 400])
def test_every_burst_matches_a_single_read(period: int) -> None:
    streamed, reference = board(), board()
    for k in range(-50, 300):
        now = POWERED + max(0, k) * period / 8000
        assert streamed.burst(0xA0, 82, now) == pack_words(reference.read(0xA0, 82, now)), k
