"""JR3 board whose samples are on the sensor's grid, and which keeps its offsets."""

from collections.abc import Callable

import numpy as np

from emulators.devices.jr3.board import Board, BoardProfile
from emulators.devices.jr3.sensor import Jr3Sensor, SensorProfile
from emulators.sensing import KnownWrench
from tests.emulation.jr3_board_host import QUIET, Floats, get

Wrench = Callable[[Floats], Floats]
POWERED = 1000.0
"""Time of power-up on the sensor's grid, so that the board's sample j is at POWERED + j / 8000."""
NEVER_ZEROED = BoardProfile(offsets_zeroed_s=10.0)
FULL = np.array([115.0, 111.0, 185.0, 5.6, 5.2, 6.1])


def board_of(
    wrench_at: Wrench,
    profile: BoardProfile = NEVER_ZEROED,
    sensor: SensorProfile = QUIET,
    committed_until: Callable[[float], float] | None = None,
) -> Board:
    return Board(profile, Jr3Sensor(sensor, KnownWrench(wrench_at, committed_until), 7), POWERED)


def do(board: Board, code: int, now: float) -> float:
    done = board.command(code, now)
    assert get(board, "command_word0", done) == (0,)
    return done
