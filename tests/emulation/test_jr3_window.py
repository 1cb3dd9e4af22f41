"""Tests of the board's words in plain memory, as a host's driver reads and writes them."""

import mmap

import numpy as np
import pytest

from emulators.devices.jr3 import Board
from protocol.devices.jr3.board import REGISTERS, Errors, to_signed
from tests.driver.jr3_window import NOT_RESET, RESET_AT, WINDOW_BYTES, WORDS_AT, Window
from tests.paper_cell import BOARD, PaperCellProfile, s3_jr3_cell

COMMAND, ERRORS, MODEL = (REGISTERS[name].address for name in ("command_word0", "errors", "model_no"))
FULL_SCALES, OFFSETS = REGISTERS["full_scale"].address, REGISTERS["offsets"].address
STEADY = 4.0
"""Time after the board has zeroed its offsets, s."""


class Host:
    """Board with its window at a time that a test sets, and the memory as its driver sees it."""

    def __init__(self) -> None:
        memory = mmap.mmap(-1, WINDOW_BYTES)
        self.now = STEADY
        board = s3_jr3_cell(PaperCellProfile(), 0.0, seed=7, receiver=BOARD).sensor
        assert isinstance(board, Board)
        self.board = board
        self.window = Window(self.board, memory, lambda: self.now)
        self.cells = np.frombuffer(memory, np.uint32)
        self.words = self.cells[WORDS_AT:]

    def after(self, seconds: float) -> None:
        """Run the window's next update."""
        self.now += seconds
        self.window.exchange()


@pytest.fixture
def host() -> Host:
    return Host()


def test_driver_reads_words_of_board(host: Host) -> None:
    assert host.words[MODEL] == 0
    host.after(0.01)
    assert tuple(host.words[:768]) == host.board.read(0, 768, host.now)
    count1 = REGISTERS["count1"].address
    before = int(host.words[count1])
    host.after(0.01)
    assert int(host.words[count1]) - before == 80


def test_command_uses_preceding_words(host: Host) -> None:
    host.after(0.01)
    host.words[FULL_SCALES : FULL_SCALES + 6] = 230, 222, 370, 112, 104, 122
    host.words[COMMAND] = 0x0A00
    host.after(0.0)
    assert host.window.commands == [0x0A00]
    assert host.words[COMMAND] == 0x0A00
    host.after(0.02)
    assert host.words[COMMAND] == 0
    assert tuple(host.words[FULL_SCALES : FULL_SCALES + 6]) == (230, 222, 370, 112, 104, 122)
    host.after(0.02)
    assert host.window.commands == [0x0A00]


def test_zero_offsets_show_weight_of_tool(host: Host) -> None:
    host.after(0.01)
    host.words[OFFSETS : OFFSETS + 6] = 0
    host.after(0.01)
    host.after(0.5)
    counts = to_signed(int(host.words[REGISTERS["filter2"].address + 2]))
    assert counts * 185.0 / 16384 == pytest.approx(0.5 * 9.80665, abs=0.05)


def test_read_only_word_is_restored(host: Host) -> None:
    host.after(0.01)
    host.words[MODEL] = 77
    host.after(0.01)
    assert host.words[MODEL] == host.board.read_word(MODEL, host.now) != 77


def test_reset_restarts_board_once(host: Host) -> None:
    host.after(0.01)
    host.cells[RESET_AT] = 0
    host.after(0.01)
    assert host.window.resets == 1
    assert host.cells[RESET_AT] == NOT_RESET
    assert host.words[MODEL] == 0
    host.after(0.2)
    assert host.window.resets == 1
    assert host.words[MODEL] != 0


def test_driver_detects_unplugged_sensor(host: Host) -> None:
    host.window.at_board(Board.unplug)
    host.after(0.1)
    assert host.words[ERRORS] & Errors.WATCH_DOG


def test_error_in_thread_is_raised_at_end_of_window(host: Host) -> None:
    host.window._words = host.words[:1]  # too few
    with pytest.raises(IndexError), host.window:
        host.window._thread.join(10.0)
