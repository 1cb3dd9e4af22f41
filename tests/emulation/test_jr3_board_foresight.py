"""Tests that a board with prediction has the same words as one without."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from emulators.devices.jr3 import Jr3Sensor, SensorProfile
from emulators.devices.jr3.board import Board, BoardProfile
from emulators.sensing import KnownWrench
from protocol.devices.jr3.board import REGISTERS, CommandCode, pack_words

POWERED = 1000.0003
"""Time of power-up, not on the sensor's grid."""
TICK, DELAY, FORESIGHT = 0.04, 0.01, 0.16

FULL_SCALES: dict[str, Any] = {"full_scales_n": (20.0, 20.0, 20.0), "full_scales_nm": (0.5, 0.5, 0.5)}
PROFILES: tuple[tuple[dict[str, Any], dict[str, Any]], ...] = (
    ({}, {}),
    ({"rate_divisor": 37, "rate_address": 0x9C, "peak_address": 0xE0}, FULL_SCALES),
    (
        {"rate_divisor": 0, "unplugged_data": "zero", "adoption_samples": 1},
        {"adc_bits": 12, "noise_counts": 9.0},
    ),
    ({"rate_divisor": 1, "rate_address": 0xF0, "peak_address": 0xA4, "idle_hz": 12345.6}, FULL_SCALES),
)
ENVELOPE = REGISTERS["load_envelope0"].address
WRITES = (
    *("errors", "rate_count", "threshold_bits", "offsets", "vect_axes", "rate_address", "rate_divisor"),
    *("peak_address", "near_sat_value", "sat_value", "full_scale"),
)
VALUES = (0, 1, 5, 37, 0x90, 0xA8, 0xF0, 300, 6000, 0xFFFF)


class Swing:
    """Oscillating wrench whose amplitude changes with every order, once it is no longer committed."""

    def __init__(self) -> None:
        self._from = [-math.inf]
        self._amplitudes = [1.0]
        self.on_change: Callable[[float], object] = lambda committed_until: None

    def order(self, amplitude: float, now: float) -> None:
        """Change the amplitude."""
        self._from.append(self.committed_until(now))
        self._amplitudes.append(amplitude)
        self.on_change(self.committed_until(now))

    def committed_until(self, now: float) -> float:
        """Return the end of the next tick, that moment excluded."""
        return (math.floor(now / TICK) + 1) * TICK + DELAY - 1e-9

    def predicted_until(self, now: float) -> float:
        """Return the time up to which the wrench is valid unless an order comes."""
        return self.committed_until(now) + FORESIGHT

    def wrench(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the wrench (n, 6)."""
        amplitudes = np.array(self._amplitudes)[np.searchsorted(self._from, times, side="right") - 1]
        return np.outer(amplitudes * np.sin(40.0 * times), (11.5, -22.2, 37.0, 0.56, -1.04, 1.22))


class Pair:
    """Two boards with the same inputs: one with prediction, one without."""

    def __init__(self, profile: int) -> None:
        board, sensor = PROFILES[profile]
        self.swings = Swing(), Swing()
        self.boards: list[Board] = []
        looking, other = self.swings
        for source in (looking, KnownWrench(other.wrench, other.committed_until)):
            read = Jr3Sensor(SensorProfile(**sensor), source, 7)
            self.boards.append(Board(BoardProfile(**board), read, POWERED))
        self.now = POWERED

    def do(self, what: str, value: int, seconds: float) -> None:
        """Apply one operation; return the state of both boards after it."""
        self.now += seconds
        match what:
            case "order":
                for source in self.swings:
                    source.order(value / 3.0, self.now)
            case "stream":
                for _ in range(10 * value):
                    self.now += (1 + value) / 8000.0
                    looking, not_looking = (board.burst(0x90, 100, self.now) for board in self.boards)
                    assert looking == not_looking
            case _:
                for board in self.boards:
                    self._act(board, what, value)
        looking, not_looking = (pack_words(board.read(0, 256, self.now)) for board in self.boards)
        assert looking == not_looking

    def _act(self, board: Board, what: str, value: int) -> None:
        match what:
            case "write":
                board.write_word(REGISTERS[WRITES[value % len(WRITES)]].address, VALUES[value], self.now)
            case "envelope":
                board.write(ENVELOPE, (0x0003, 1, 1, 0x92, 900 * value, 1, 0xA1, -500, 6), self.now)
            case "command":
                code, word1 = list(CommandCode)[value + 2] | value % 4, 0xF1 if value % 2 else 0xA0
                board.command(code, self.now, word1, value)
            case "reset":
                board.reset(self.now)
            case "unplug":
                board.unplug(self.now)
            case "plug in":
                board.plug_in(self.now)


Steps = list[tuple[str, int, float]]
KINDS = (
    "order",
    "order",
    "order",
    "stream",
    "stream",
    "write",
    "envelope",
    "command",
    "reset",
    "unplug",
    "plug in",
)


PEAKS: Steps = [
    ("order", 9, 0.013),
    ("command", 8, 0.1),
    ("order", 0, 0.0007),
    ("command", 9, 0.1),
    ("stream", 1, 0.1),
]
"""Peaks that were predicted and did not occur."""


@pytest.mark.full
@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, len(PROFILES) - 1),
    st.sampled_from((0.0, 0.1, 2.5)),
    st.lists(
        st.tuples(st.sampled_from(KINDS), st.integers(0, 9), st.sampled_from((0.0, 0.0007, 0.013, 0.1, 0.5))),
        min_size=1,
        max_size=25,
    ),
)
@example(
    1,
    2.5,
    [("stream", 9, 0.0), ("order", 9, 0.001), ("command", 9, 0.1), ("order", 0, 0.0), ("stream", 7, 0.0)],
)
@example(
    3, 0.1, [("stream", 3, 0.0), ("order", 5, 0.0), ("order", 2, 0.0), ("reset", 0, 0.0), ("stream", 9, 0.0)]
)
@example(0, 2.5, PEAKS * 4)
def test_words_are_independent_of_prediction(profile: int, start_after: float, steps: Steps) -> None:
    pair = Pair(profile)
    pair.do("nothing", 0, start_after)
    for what, value, seconds in steps:
        pair.do(what, value, seconds)


def test_words_already_read_stay_after_invalidation() -> None:
    source = Swing()
    sensors = [Jr3Sensor(SensorProfile(), source, 7) for _ in range(2)]
    forgetful, steady = (Board(BoardProfile(), sensor, POWERED) for sensor in sensors)
    for k in range(600):
        now = POWERED + 0.00125 * k
        if k % 50 == 30:
            sensors[0].invalidate(now - 0.3)
        assert forgetful.burst(0x90, 100, now) == steady.burst(0x90, 100, now), k
