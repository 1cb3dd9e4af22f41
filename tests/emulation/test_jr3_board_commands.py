"""Tests of the board's commands from a host: times, memory, full scales, offsets, vectors."""

import numpy as np
import pytest

from emulators.devices.jr3.board import BoardProfile
from emulators.devices.jr3.sensor import SensorProfile
from protocol.devices.jr3.board import COMMANDS, REGISTERS, Errors, Link, LinkType, encode_transform
from tests.emulation.jr3_board_host import (
    LOAD,
    LOAD_COUNTS,
    STEADY,
    board_of,
    constant,
    do,
    get,
    loaded_from,
    put,
)


@pytest.mark.parametrize("which", ["typical", "maximum"])
def test_command_times_match_manual(which: str) -> None:
    board = board_of(profile=BoardProfile(command_times=which))  # type: ignore[arg-type]
    now = STEADY
    for code, info in COMMANDS.items():
        _, _, done = do(board, code, now, 0x40)
        assert done - now == pytest.approx(info.typical if which == "typical" else info.maximum)
        now = done + 0.01


def test_memory_commands_read_and_write() -> None:
    board = board_of()
    now = STEADY
    assert do(board, 0x0100, now, 0xF9)[:2] == (0, 1)
    assert do(board, 0x0200, now + 1, 0x1234, 0x00F0)[:2] == (0, 0)
    assert do(board, 0x0300, now + 2, 0x1234, 0x0F01)[:2] == (0, 0x00F0)
    assert do(board, 0x0400, now + 3, 0x1234, 0x0011)[:2] == (0, 0x0FF1)
    assert board.read_word(0x1234, now + 4) == 0x0FE0
    assert do(board, 0x0200, now + 5, REGISTERS["offsets"].address, 50)[0] == 0
    assert get(board, "filter0", now + 5.1)[0] == -50


@pytest.mark.parametrize(
    ("code", "word1"), [(0x0D00, 0), (0x0001, 0), (0x0510, 0), (0x8000, 0), (0x0100, 0x4000), (0x0200, 0xF9)]
)
def test_invalid_commands_answer_minus_one(code: int, word1: int) -> None:
    board = board_of()
    assert do(board, code, STEADY, word1)[0] == -1
    assert do(board, 0x0100, STEADY + 1, 0xF9)[0] == 0


def test_command_during_another_is_lost() -> None:
    board = board_of()
    done = board.command(0x0500, STEADY)
    assert board.command(0x0603, STEADY + 1e-3) == done
    assert get(board, "command_word0", done) == (0,)
    assert get(board, "offset_num", done + 0.1) == (0,)


def test_board_is_busy_during_transform_or_full_scales() -> None:
    board = board_of(constant(*LOAD))
    put(board, "transform2", encode_transform([Link(LinkType.TRANSLATE_X, 0)] * 4), STEADY)
    done = board.command(0x0502, STEADY)
    assert done - STEADY == pytest.approx(2.25e-3 + 4 * 0.75e-3)
    count = get(board, "count1", STEADY + 1e-3)
    assert get(board, "errors", STEADY + 1e-3)[0] == Errors.SYSTEM_BUSY
    assert get(board, "count1", done - 1e-4) == count
    assert get(board, "errors", done) == (0,)
    assert get(board, "transform_num", done) == (2,)
    assert get(board, "count1", done + 1e-3)[0] == count[0] + 8
    later = done + 0.1
    assert board.command(0x0A00, later) - later == pytest.approx(3.4e-3 + 4 * 0.75e-3)


def test_full_scales_change_counts_and_vectors() -> None:
    at = STEADY + 1.0
    board = board_of(loaded_from(at))
    put(board, "full_scale", (230, 222, 370, 112, 104, 122), STEADY)
    assert do(board, 0x0A00, STEADY)[0] == 0
    assert get(board, "full_scale", at) == (230, 222, 370, 112, 104, 122, 370, 122)
    assert get(board, "filter0", at + 0.1)[:6] == (819, -1638, 1638, 819, -1638, 1638)
    assert get(board, "min_full_scale", at) == (115, 111, 185, 56, 52, 61)
    assert get(board, "max_full_scale", at) == (115, 111, 185, 56, 52, 61)


@pytest.mark.parametrize(
    ("span", "largest"),
    [
        (1.0, (115, 111, 185, 56, 52, 61)),
        (2.5, (287, 277, 462, 140, 130, 152)),
        (4.0, (460, 444, 740, 224, 208, 244)),
        (16.0, (460, 444, 740, 224, 208, 244)),
    ],
)
def test_max_full_scale_keeps_converter_resolution(span: float, largest: tuple[int, ...]) -> None:
    sensor = SensorProfile(noise_counts=0.0, adc_bits=14)
    board = board_of(sensor=sensor, profile=BoardProfile(full_scale_span=span))
    assert get(board, "min_full_scale", STEADY) == (115, 111, 185, 56, 52, 61)
    assert get(board, "max_full_scale", STEADY) == largest
    assert get(board, "sat_value", STEADY) == (32768 - 4,)


@pytest.mark.parametrize("wrong", [0, -1, -32768])
def test_invalid_full_scale_is_refused(wrong: int) -> None:
    board = board_of(constant(*LOAD))
    put(board, "full_scale", (115, 111, wrong), STEADY)
    assert do(board, 0x0A00, STEADY)[0] == -1
    assert get(board, "errors", STEADY + 1) == (0,)


def test_small_full_scales_saturate_and_smaller_ones_overflow() -> None:
    at = STEADY + 1.0
    sensor = SensorProfile(full_scales_n=(1000.0, 1000.0, 1000.0), noise_counts=0.0, adc_bits=16)
    board = board_of(loaded_from(at, (100.0, -100.0, 10.0, 0.0, 0.0, 0.0)), sensor=sensor)
    put(board, "full_scale", (10, 10, 3), STEADY)
    do(board, 0x0A00, STEADY)
    fx, fy, fz = get(board, "filter0", at + 0.1)[:3]
    assert (fx, fy) == (32767, -32768)
    # 0.3 % of min_full_scale: 10 N are 54613 counts, which wrap.
    assert fz == pytest.approx(10 / 3 * 16384 - 65536, abs=70)


def test_offsets_are_stored_in_slots() -> None:
    at = STEADY + 1.0
    board = board_of(loaded_from(at))
    now = at + 1.0
    assert do(board, 0x0800, now)[0] == 0
    assert get(board, "offsets", now + 0.1) == LOAD_COUNTS
    assert get(board, "filter0", now + 0.1)[:6] == (0,) * 6
    assert do(board, 0x0700, now + 0.1)[0] == 0
    assert do(board, 0x060F, now + 0.2)[0] == 0
    assert get(board, "offset_num", now + 0.3) == (15,)
    assert get(board, "offsets", now + 0.3) == (0,) * 6
    assert get(board, "filter0", now + 0.3)[:6] == LOAD_COUNTS
    do(board, 0x0600, now + 0.4)
    assert get(board, "offsets", now + 0.5) == LOAD_COUNTS
    assert do(board, 0x0800, now + 1.0)[0] == 0
    assert get(board, "offsets", now + 1.1) == LOAD_COUNTS


def test_vector_axes_are_selectable() -> None:
    board = board_of(loaded_from(STEADY + 1.0))

    def vectors(code: int, now: float) -> tuple[int, ...]:
        assert do(board, code, now)[0] == 0
        assert get(board, "vect_axes", now + 0.1) == (code & 0xFF,)
        return (*get(board, "filter0", now + 0.1)[6:], *get(board, "full_scale", now + 0.1)[6:])

    fx, fy, fz, mx, my, mz = 11.5, 22.2, 37.0, 0.56, 1.04, 1.22
    now = STEADY + 2.0

    def counts(value: float, scale: float) -> int:
        return pytest.approx(value / scale * 16384, abs=1)  # type: ignore[return-value]

    assert vectors(0x093F, now) == (
        counts(np.hypot(np.hypot(fx, fy), fz), 185),
        counts(np.hypot(np.hypot(mx, my), mz), 6.1),
        *(185, 61),
    )
    assert vectors(0x0900 | 0x03 | 0x28, now + 1) == (
        counts(np.hypot(fx, fy), 115),
        counts(np.hypot(mx, mz), 6.1),
        *(115, 61),
    )
    assert vectors(0x0900 | 0x40 | 0x3F, now + 2)[2:] == (185, 185)
    assert vectors(0x0900 | 0x80 | 0x11, now + 3) == (counts(mx, 5.6), counts(my, 5.2), 56, 52)
    assert vectors(0x0900, now + 4) == (0, 0, 0, 0)
