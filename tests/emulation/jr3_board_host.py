"""Noiseless JR3 board that a host reads, writes and commands by the names of its registers."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from emulators.devices.jr3.board import Board, BoardProfile
from emulators.devices.jr3.sensor import Jr3Sensor, SensorProfile
from emulators.sensing import KnownWrench
from protocol.devices.jr3.board import REGISTERS, to_signed

Floats = NDArray[np.float64]
POWERED = 1000.0003
"""Time of power-up, not on the sensor's grid."""
STEADY = POWERED + 4.0
"""Time after the board has zeroed its offsets."""
QUIET = SensorProfile(noise_counts=0.0, adc_bits=16)
LOAD = (11.5, -22.2, 37.0, 0.56, -1.04, 1.22)
"""A tenth, a fifth of full scale: 1638, −3277, 3277, 1638, −3277, 3277 counts."""
LOAD_COUNTS = (1638, -3277, 3277, 1638, -3277, 3277)


def constant(*wrench: float) -> Callable[[Floats], Floats]:
    return lambda times: np.tile(np.array(wrench), (len(times), 1))


def loaded_from(time: float, wrench: tuple[float, ...] = LOAD) -> Callable[[Floats], Floats]:
    return lambda times: np.outer(times >= time, wrench)


UNLOADED = constant(*[0.0] * 6)


def board_of(
    wrench_at: Callable[[Floats], Floats] = UNLOADED,
    profile: BoardProfile | None = None,
    sensor: SensorProfile = QUIET,
    filter_number: int = 0,
) -> Board:
    return Board(
        profile or BoardProfile(), Jr3Sensor(sensor, KnownWrench(wrench_at), 7), POWERED, filter_number
    )


def get(board: Board, name: str, now: float) -> tuple[int, ...]:
    register = REGISTERS[name]
    return register.values(board.read(register.address, register.count, now))


def put(board: Board, name: str, values: tuple[int, ...], now: float) -> None:
    board.write(REGISTERS[name].address, values, now)


def do(board: Board, code: int, now: float, word1: int = 0, word2: int = 0) -> tuple[int, int, float]:
    """Give a command; return command_word0 and command_word2 when it is done, and the time."""
    done = board.command(code, now, word1, word2)
    assert done > now
    assert get(board, "command_word0", done - 1e-6)[0] == to_signed(code)
    return get(board, "command_word0", done)[0], board.read_word(0xE5, done), done
